"""What may be wrong with a record's signs, axes and units, each as the correction that undoes it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray

_DEGREES = 180.0 / np.pi  # deg in a rad
_G = 9.80665  # m/s^2, standard gravity (CGPM 1901)
_FEET = 0.3048  # m in a foot (international, 1959)
_PSF = 47.88026  # Pa in a lbf/ft^2

_TRIADS = {"gyros": ("p", "q", "r"), "accelerometers": ("ax", "ay", "az")}
_TRIAD_UNITS = (
    ("gyros", _DEGREES, "rad/s tagged deg/s", "deg/s tagged rad/s"),
    ("accelerometers", _G, "g tagged m/s^2", "m/s^2 tagged g"),
    ("accelerometers", 1.0 / _FEET, "m/s^2 tagged ft/s^2", "ft/s^2 tagged m/s^2"),
)
_AIR = ("velocity", "dynamic_pressure", "altitude")
_AIR_UNITS = (
    (("velocity",), 1.0 / _FEET, "m/s tagged ft/s", "ft/s tagged m/s"),
    (("dynamic_pressure",), _PSF, "lbf/ft^2 tagged Pa", "Pa tagged lbf/ft^2"),
    (("altitude",), 1.0 / _FEET, "m tagged ft", "ft tagged m"),
    (("velocity", "altitude"), 1.0 / _FEET, "metres tagged feet", "feet tagged metres"),
)

Matrix = tuple[tuple[float, float, float], ...]
_IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True)
class Correction:
    """What undoes a mistake: the factors from what a record reads to what it should read."""

    channels: tuple[str, ...]
    """Those at fault."""
    fault: str
    """Its kind: sign, axes or units."""
    words: str
    """How the channels read, in a sentence."""
    gyros: Matrix = _IDENTITY
    """(3, 3), times p, q, r."""
    accelerometers: Matrix = _IDENTITY
    """(3, 3), times ax, ay, az."""
    air: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Times velocity, dynamic pressure and altitude."""
    changes: int = 1
    """How many separate mistakes would have been made."""

    @property
    def channel(self) -> str:
        """The channels at fault, joined by commas."""
        return ", ".join(self.channels)


AS_IT_IS = Correction((), "", "", changes=0)


def corrections() -> tuple[Correction, ...]:
    """Every mistake that is tried, the simplest first."""
    return (*_signs(), *_exchanges(), *_units(), *_turned_gyros())


def _signs() -> Iterator[Correction]:
    for triad, names in _TRIADS.items():
        for i, name in enumerate(names):
            words = f"{name} reads as if its sign were flipped"
            yield _of_triad(triad, (name,), "sign", words, _scaled(i, -1.0))


def _exchanges() -> Iterator[Correction]:
    for triad, names in _TRIADS.items():
        for i, j in ((1, 2), (0, 1), (0, 2)):
            matrix = np.eye(3)
            matrix[[i, j]] = matrix[[j, i]]
            words = f"{names[i]} and {names[j]} read as if they were exchanged"
            yield _of_triad(triad, (names[i], names[j]), "axes", words, matrix)


def _units() -> Iterator[Correction]:
    for triad, factor, too_small, too_large in _TRIAD_UNITS:
        names = _TRIADS[triad]
        for value, mislabel in ((factor, too_small), (1.0 / factor, too_large)):
            for i, name in enumerate(names):
                words = f"{name} reads as if it were {mislabel}"
                yield _of_triad(triad, (name,), "units", words, _scaled(i, value))
            words = f"{', '.join(names)} read as if they were {mislabel}"
            yield _of_triad(triad, names, "units", words, value * np.eye(3))
    for chosen, factor, too_small, too_large in _AIR_UNITS:
        for value, mislabel in ((factor, too_small), (1.0 / factor, too_large)):
            velocity, pressure, altitude = (value if name in chosen else 1.0 for name in _AIR)
            verb = "read as if they were" if len(chosen) > 1 else "reads as if it were"
            words = f"{' and '.join(chosen)} {verb} {mislabel}"
            yield Correction(chosen, "units", words, air=(velocity, pressure, altitude))


def _turned_gyros() -> Iterator[Correction]:
    """The other ways in which the transverse gyros can stand to the transverse accelerometers.

    Signs and an exchange of y and z make 16 ways, counted with the sign of p; those of a single mistake are
    above. Turning both triads together changes nothing that can be seen.
    """
    for swapped, p, q, r in product((False, True), (1.0, -1.0), (1.0, -1.0), (1.0, -1.0)):
        names = _TRIADS["gyros"]
        flipped = [name for name, sign in zip(names, (p, q, r), strict=True) if sign < 0.0]
        changes = len(flipped) + swapped
        if changes < 2:
            continue
        mistakes = ["q and r were exchanged"] if swapped else []
        if flipped:
            mistakes.append(f"the sign of {' and '.join(flipped)} flipped")
        at_fault = tuple(name for name in names if name in flipped or (swapped and name != "p"))
        words = f"axes and signs of the gyros are in doubt: they read as if {', and '.join(mistakes)}"
        matrix = np.diag([p, q, r])[:, [0, 2, 1] if swapped else [0, 1, 2]]
        yield _of_triad("gyros", at_fault, "axes", words, matrix, changes)


def _scaled(axis: int, factor: float) -> FloatArray:
    matrix = np.eye(3)
    matrix[axis, axis] = factor
    return matrix


def _of_triad(
    triad: str, channels: tuple[str, ...], fault: str, words: str, matrix: FloatArray, changes: int = 1
) -> Correction:
    values: Matrix = tuple((float(row[0]), float(row[1]), float(row[2])) for row in matrix)
    factors: dict[str, Any] = {triad: values}
    return Correction(channels, fault, words, changes=changes, **factors)
