"""What may be wrong with a record's signs, axes and units, each as the correction that undoes it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from brv_hypo.arrays import FloatArray

_DEGREES = 180.0 / np.pi  # deg in a rad
_G = 9.80665  # m/s^2, standard gravity (CGPM 1901)
_FEET = 0.3048  # m in a foot (international, 1959)
_PSF = 47.88026  # Pa in a lbf/ft^2

_GYROS = ("p", "q", "r")
_ACCELEROMETERS = ("ax", "ay", "az")
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
    """Gyros and accelerometers as they should read are `gyros` and `accelerometers` (3, 3) times those read.

    `air` multiplies velocity, dynamic pressure and altitude. `channels` are at fault; `fault` names the kind
    and `words` say it. `changes` counts how many separate mistakes would have been made.
    """

    channels: tuple[str, ...]
    fault: str
    words: str
    gyros: Matrix = _IDENTITY
    accelerometers: Matrix = _IDENTITY
    air: tuple[float, float, float] = (1.0, 1.0, 1.0)
    changes: int = 1

    @property
    def channel(self) -> str:
        """The channels at fault, joined by commas."""
        return ", ".join(self.channels)


AS_IT_IS = Correction((), "", "", changes=0)


def corrections() -> tuple[Correction, ...]:
    """Every mistake that is tried, the simplest first."""
    return (*_signs(), *_exchanges(), *_units(), *_turned_gyros())


def _signs() -> list[Correction]:
    found = []
    for triad, names in (("gyros", _GYROS), ("accelerometers", _ACCELEROMETERS)):
        for i, name in enumerate(names):
            factors = np.ones(3)
            factors[i] = -1.0
            words = f"{name} reads as if its sign were flipped"
            found.append(_of_triad(triad, (name,), "sign", words, np.diag(factors)))
    return found


def _exchanges() -> list[Correction]:
    found = []
    for triad, names in (("gyros", _GYROS), ("accelerometers", _ACCELEROMETERS)):
        for i, j in ((1, 2), (0, 1), (0, 2)):
            matrix = np.eye(3)
            matrix[[i, j]] = matrix[[j, i]]
            pair = (names[i], names[j])
            words = f"{names[i]} and {names[j]} read as if they were exchanged"
            found.append(_of_triad(triad, pair, "axes", words, matrix))
    return found


def _units() -> list[Correction]:
    found = []
    kinds = (
        ("gyros", _GYROS, _DEGREES, "rad/s tagged deg/s", "deg/s tagged rad/s"),
        ("accelerometers", _ACCELEROMETERS, _G, "g tagged m/s^2", "m/s^2 tagged g"),
        ("accelerometers", _ACCELEROMETERS, 1.0 / _FEET, "m/s^2 tagged ft/s^2", "ft/s^2 tagged m/s^2"),
    )
    for triad, names, factor, too_small, too_large in kinds:
        for value, mislabel in ((factor, too_small), (1.0 / factor, too_large)):
            for i, name in enumerate(names):
                factors = np.ones(3)
                factors[i] = value
                words = f"{name} reads as if it were {mislabel}"
                found.append(_of_triad(triad, (name,), "units", words, np.diag(factors)))
            words = f"{', '.join(names)} read as if they were {mislabel}"
            found.append(_of_triad(triad, names, "units", words, value * np.eye(3)))
    for chosen, factor, too_small, too_large in _AIR_UNITS:
        for value, mislabel in ((factor, too_small), (1.0 / factor, too_large)):
            air = tuple(value if name in chosen else 1.0 for name in _AIR)
            verb = "read as if they were" if len(chosen) > 1 else "reads as if it were"
            words = f"{' and '.join(chosen)} {verb} {mislabel}"
            found.append(Correction(chosen, "units", words, air=(air[0], air[1], air[2])))
    return found


def _turned_gyros() -> list[Correction]:
    """The other ways in which the transverse gyros can stand to the transverse accelerometers.

    Signs and an exchange of y and z make 16 ways, counted with the sign of p; those of a single mistake are
    above. Turning both triads together changes nothing that can be seen.
    """
    found = []
    for swapped, p, q, r in product((False, True), (1.0, -1.0), (1.0, -1.0), (1.0, -1.0)):
        flipped = [name for name, sign in zip(_GYROS, (p, q, r), strict=True) if sign < 0.0]
        changes = len(flipped) + swapped
        if changes < 2:
            continue
        rows = [[p, 0.0, 0.0], [0.0, q, 0.0], [0.0, 0.0, r]]
        if swapped:
            rows = [[p, 0.0, 0.0], [0.0, 0.0, q], [0.0, r, 0.0]]
        mistakes = ["q and r were exchanged"] if swapped else []
        if flipped:
            mistakes.append(f"the sign of {' and '.join(flipped)} flipped")
        at_fault = tuple(name for name in _GYROS if name in flipped or (swapped and name != "p"))
        words = f"axes and signs of the gyros are in doubt: they read as if {', and '.join(mistakes)}"
        matrix = np.array(rows)
        found.append(_of_triad("gyros", at_fault, "axes", words, matrix, changes))
    return found


def _of_triad(
    triad: str, channels: tuple[str, ...], fault: str, words: str, matrix: FloatArray, changes: int = 1
) -> Correction:
    values: Matrix = tuple((float(row[0]), float(row[1]), float(row[2])) for row in matrix)
    if triad == "gyros":
        return Correction(channels, fault, words, gyros=values, changes=changes)
    return Correction(channels, fault, words, accelerometers=values, changes=changes)
