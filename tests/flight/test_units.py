"""Units: exact sizes, field spellings, refusals."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from brv_hypo.errors import FlightRecordError
from brv_hypo.flight.units import EXAMPLES, SI, Dimension, to_si

# Exact by definition (NIST SP 811, appendix B), written out to the double.
EXACT: list[tuple[Dimension, str, float]] = [
    ("angular rate", "deg/s", 0.017453292519943295),
    ("angular rate", "rpm", 0.10471975511965977),
    ("acceleration", "g", 9.80665),
    ("acceleration", "mg", 0.00980665),
    ("acceleration", "ft/s^2", 0.3048),
    ("speed", "ft/s", 0.3048),
    ("pressure", "lbf/ft^2", 47.88025898033584),
    ("pressure", "psf", 47.88025898033584),
    ("density", "slug/ft^3", 515.3788183931961),
    ("mass", "slug", 14.593902937206364),
    ("mass", "g", 0.001),
    ("moment of inertia", "slug*ft^2", 1.3558179483314004),
    ("time", "ms", 0.001),
]


@pytest.mark.parametrize(("dimension", "units", "size"), EXACT)
def test_a_unit_has_its_exact_size(dimension: Dimension, units: str, size: float) -> None:
    np.testing.assert_allclose(to_si([1.0, -2.0], units, dimension, "x"), [size, -2.0 * size], rtol=1e-14)


@pytest.mark.parametrize("dimension", list(SI))
def test_every_example_that_a_message_gives_is_accepted(dimension: Dimension) -> None:
    for units in EXAMPLES[dimension].split(", "):
        assert np.all(to_si(np.ones(2), units, dimension, "x") > 0.0)


@pytest.mark.parametrize(
    ("dimension", "units", "says"),
    [
        ("angular rate", "Hz", "no angle"),
        ("angular rate", "1/s", "no angle"),
        ("angular rate", "rad", "angular rate"),
        ("acceleration", "m/s", "acceleration"),
        ("acceleration", "m/s2", "cannot be read"),
        ("moment of inertia", "slug-ft^2", "cannot be read"),
        ("length", "3*m", "cannot be read"),
        ("time", "", "time"),
    ],
)
def test_a_wrong_unit_is_refused_with_examples(dimension: Dimension, units: str, says: str) -> None:
    with pytest.raises(FlightRecordError) as caught:
        to_si([1.0], units, dimension, "some/channel")
    message = str(caught.value)
    assert says in message
    assert "'some/channel'" in message
    assert EXAMPLES[dimension] in message


def test_si_units_start_no_registry() -> None:
    code = (
        "import sys; from brv_hypo.flight.units import SI, to_si\n"
        "[to_si([1.0], units, name, 'x') for name, units in SI.items()]\n"
        "print(sorted({'pint', 'h5py', 'scipy', 'pandas', 'ambiance', 'yaml'} & set(sys.modules)))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"
