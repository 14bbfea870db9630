"""Units, at the border only: every quantity that enters is converted here, once, to SI.

Pint does the work. A string that is SI already never starts it: building its registry takes about 0.25 s.
"""

from __future__ import annotations

import re
import unicodedata
from functools import cache
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import FlightRecordError
from brv_hypo.io.text import refusal

if TYPE_CHECKING:
    import pint

OfMotion = Literal["time", "angular rate", "acceleration", "speed", "angle", "dimensionless"]
Dimension = Literal[OfMotion, "pressure", "density", "length", "area", "mass", "moment of inertia"]

# Units that recorders write, by dimension: SI, then the likelier first, each with the words that end a column's name.
RECORDED: dict[Dimension, dict[str, tuple[str, ...]]] = {
    "time": {
        "s": ("s", "sec"),
        "ms": ("ms", "msec", "millis", "milliseconds"),
        "us": ("us", "usec", "micros", "microseconds"),
        "ns": ("ns", "nsec", "nanos", "nanoseconds"),
        "min": ("min", "mins", "minute", "minutes"),
        "hour": ("hour", "hours", "hr", "hrs", "h"),
        "day": ("day", "days", "d"),
    },
    "angular rate": {
        "rad/s": ("radps", "rads", "rad s", "rad"),
        "deg/s": ("dps", "degs", "degps", "deg s", "deg"),
        "rpm": ("rpm",),
        "revolution/s": ("rps", "hz"),
    },
    "acceleration": {
        "m/s^2": ("mps2", "ms2", "mpss", "m s2", "mps 2", "m s 2"),
        "ft/s^2": ("fps2", "ftps2", "fts2", "ft s2", "ft s 2"),
        "g": ("g", "gs", "gee"),
        "mg": ("mg",),
    },
    "speed": {
        "m/s": ("mps", "ms", "m s"),
        "ft/s": ("fps", "ftps", "ft s"),
        "km/s": ("kmps", "kms", "km s"),
        "kft/s": ("kftps", "kfts", "kft s"),
        "km/hour": ("kmh", "kph", "km h"),
        "knot": ("kt", "kts", "kn"),
        "mph": ("mph",),
    },
    "pressure": {unit: (unit.lower(),) for unit in ("Pa", "psf", "kPa", "hPa", "psi", "mbar")},
    "density": {"kg/m^3": ("kgm3", "kg m3"), "g/m^3": ("gm3", "g m3"), "slug/ft^3": ("slugft3", "slug ft3")},
    "length": {"m": ("m",), "ft": ("ft", "feet"), "km": ("km",), "kft": ("kft",)},
    "area": {"m^2": (), "ft^2": ()},
    "mass": {"kg": ("kg",), "slug": ("slug",), "lb": ("lb", "lbm"), "g": ("g",)},
    "moment of inertia": {"kg*m^2": ("kgm2", "kg m2", "kg m 2"), "slug*ft^2": ("slugft2", "slug ft2", "slug ft 2")},
    "angle": {"rad": ("rad",), "deg": ("deg", "degrees")},
    "dimensionless": {"dimensionless": (), "1": ()},
}
SI: dict[Dimension, str] = {dimension: next(iter(units)) for dimension, units in RECORDED.items()}
EXAMPLES = {dimension: ", ".join([*units][:3]) for dimension, units in RECORDED.items()}

# Field usage that pint reads otherwise: to pint, "g" is a gram.
SPELLINGS: dict[Dimension, dict[str, str]] = {
    "acceleration": {"g": "standard_gravity", "G": "standard_gravity", "mg": "millistandard_gravity"},
    "pressure": {"psf": "lbf/ft^2"},
    "dimensionless": {"": "dimensionless", "1": "dimensionless", "-": "dimensionless"},
}

LONGEST_UNITS = 80  # characters
# Pint calculates what it reads: a power of a power, or a long number, would keep it busy for hours.
ENDLESS_POWER = re.compile(r"(\*\*|\^)\s*[-+]?\s*([^\s\d.+-]|\d{3}|[\d.]*\s*(\*\*|\^)|\d*\.?\d*[eE])|\d{9}")


def to_si(values: ArrayLike, units: str, dimension: Dimension, dataset_name: str) -> FloatArray:
    """`values` in the SI unit of `dimension` (see `SI`), same shape. Raises FlightRecordError, naming `dataset_name`,
    where `units` is unknown, of another dimension, or no plain multiple of the SI unit.
    """
    array = np.asarray(values, dtype=np.float64)
    stripped = units.strip()
    spelling = SPELLINGS.get(dimension, {}).get(stripped, stripped)
    if spelling == SI[dimension]:
        return array
    from pint.util import to_units_container

    unit = _parsed(spelling, units, dimension, dataset_name)
    target = _registry().parse_units(SI[dimension])
    if not unit.is_compatible_with(target):
        found = f"units '{units}' ({unit.dimensionality})"
        expected = f"units of {dimension} ({target.dimensionality}), such as {EXAMPLES[dimension]}"
        cause = "the units of another channel, or a missing power or per-second"
        remedy = f"correct the units of '{dataset_name}'"
        raise refusal(dataset_name, found, expected, cause, remedy)
    # To pint an angle has no dimension, and Hz is rad/s: radians must be left in the root units.
    if dimension == "angular rate" and "radian" not in to_units_container(_registry().get_root_units(unit)[1]):
        found, expected = f"units '{units}', which hold no angle", f"an angle per time, such as {EXAMPLES[dimension]}"
        cause = "cycles per second and radians per second are both called 1/s"
        remedy = "say which: 'rad/s', 'deg/s', 'rpm' or 'revolution/s'"
        raise refusal(dataset_name, found, expected, cause, remedy)
    return array * float(_registry().Quantity(1.0, unit).to(target).magnitude)


def spelled(units: str) -> str:
    """Units in plain letters: m/s² as m/s2, °/s as deg/s, µs as us."""
    return unicodedata.normalize("NFKC", units).replace("°", "deg").replace("μ", "u")


def is_unit(units: str) -> bool:
    """True where `units` is a unit of any dimension that can be read, "1" included."""
    try:
        _parsed(SPELLINGS["dimensionless"].get(units.strip(), units), units, "dimensionless", "units")
    except FlightRecordError:
        return False
    return True


def _parsed(spelling: str, units: str, dimension: Dimension, dataset_name: str) -> pint.Unit:
    """The pint unit of a string; whatever pint makes of nonsense becomes one refusal."""
    try:
        if len(spelling) > LONGEST_UNITS or ENDLESS_POWER.search(spelling):
            raise ValueError("too long, or a power that no unit has")
        return _registry().parse_units(spelling)
    except Exception as error:  # pint lets errors of many kinds out of its parser
        found = f"units '{units}', which cannot be read ({error})"
        expected = f"units of {dimension}, such as {EXAMPLES[dimension]}"
        cause = "a misspelt unit, wrong upper or lower case, or 's2' written for 's^2'"
        remedy = f"correct the units of '{dataset_name}'; join units with '*' and '/'"
        raise refusal(dataset_name, found, expected, cause, remedy) from error


@cache
def _registry() -> pint.UnitRegistry[Any]:
    """Pint's registry, built at the first unit that is not SI."""
    import pint

    return pint.UnitRegistry()
