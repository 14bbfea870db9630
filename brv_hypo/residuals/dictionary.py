"""Generic terms for what no plugin describes, and the words that an analyst uses for them.

An entry is one vector or one scalar: terms that enter together. Entries with a position (a rate of turning,
a Mach number) are laid on a grid and can be moved.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from brv_hypo.constants import (
    DESCRIBED_GRADUAL,
    DESCRIBED_HATS,
    DESCRIBED_SHARP,
    DESCRIBED_SLOW,
    DESCRIBED_STEPS,
    TURNING_RATES,
)
from brv_hypo.mechanisms.yaml_mechanism import Axis, Factor, Quantity, Turn, YamlTerm, values_of
from brv_hypo.motion.motion import Motion
from brv_hypo.regression.unmodelled import fastest_turning

Wave = Literal["cos", "sin"]

# Widths of a step, of the way to the next place: where it is gradual, a sharp one leaves what several jumps in time
# would describe better.
_WIDTHS = {DESCRIBED_SHARP: "", DESCRIBED_GRADUAL: " that is gradual", DESCRIBED_SLOW: " that is slow"}
_ORDINAL = {1: "first", 2: "second", 3: "third", 4: "fourth"}
_POWER = {0: "", 1: " times alpha", 2: " times alpha squared", 3: " times alpha cubed"}
_QUANTITY = {"mach": "Mach", "log_reynolds": "log10 of Reynolds number", "time": "time"}


@dataclass(frozen=True)
class Entry:
    """Terms that enter together, in words; `spacing` is that of the grid which `position` lies on.

    `at(position)` is the same entry elsewhere. What `may_change` may begin, end and jump in time; the others are
    courses in a quantity themselves, `follows`, of a `form` wherever they lie.
    """

    words: str
    terms: tuple[YamlTerm, ...]
    position: float = 0.0
    spacing: float = 0.0
    at: Callable[[float], Entry] | None = None
    may_change: bool = False
    follows: Quantity | None = None
    form: str = ""


# What tells a single flight alike comes in this order: a slope that changes along an entry is first of all a function
# of Mach number, and nothing that follows the record's time can be asked of another flight.
QUANTITIES: tuple[Quantity, ...] = ("mach", "log_reynolds", "time")


def entries(motions: Sequence[Motion]) -> tuple[Entry, ...]:
    """The dictionary for these flights; quantities that a record lacks or that stand still are left out.

    Of several flights, what all share: nothing that follows the record's time.
    """
    one = len(motions) == 1
    found = [*(_turning(motions[0]) if one else ()), *_harmonics(), *_round_the_body(), *_powers()]
    for quantity in QUANTITIES if one else QUANTITIES[:-1]:
        values = np.concatenate([values_of(motion, quantity) for motion in motions])
        low, high = float(np.min(values)), float(np.max(values))
        if np.isfinite(low) and np.isfinite(high) and high - low > 1e-6 * abs(high):
            found += [*_steps(quantity, low, high), *_smooth(quantity, low, high)]
    return tuple(found)


def _turning(motion: Motion) -> list[Entry]:
    """Body-fixed moments of constant size that turn in the body at a constant rate."""
    duration = float(motion.time[-1] - motion.time[0])
    top = fastest_turning(motion)
    step = max(np.pi / duration, 2.0 * top / TURNING_RATES)
    rates = step * np.arange(-int(top / step), int(top / step) + 1)
    near = float(np.mean(motion.p))

    def entry(rate: float) -> Entry:
        roll = ", the roll rate" if abs(abs(rate) - abs(near)) < 0.5 * np.pi / duration else ""
        name = f"turns at {rate:.12g} rad/s"
        terms = tuple(YamlTerm(name=f"{name}, {axis}", axis=axis, turn=Turn(of="time", rate=rate)) for axis in _BODY)
        return Entry(
            f"a body-fixed moment that turns at {rate:.3g} rad/s ({rate / 2 / np.pi:.3g} Hz{roll})",
            terms,
            rate,
            step,
            entry,
            may_change=True,
        )

    return [entry(float(rate)) for rate in rates if abs(rate) > 0.5 * step]


_BODY: tuple[Axis, Axis] = ("body_y", "body_z")


def _harmonics() -> list[Entry]:
    """Harmonics of the windward meridian, in and out of plane, constant or with alpha."""
    found = []
    for harmonic in (1, 2, 3, 4):
        for power in (0, 1):
            for axis in _PLANE:
                terms = tuple(
                    YamlTerm(
                        name=f"{axis} {function} {harmonic} phi_w{_POWER[power]}",
                        axis=axis,
                        factors=(
                            Factor(of="windward_meridian", function=function, rate=float(harmonic)),
                            *_alpha(power),
                        ),
                        units="1/rad" if power else "1",
                    )
                    for function in WAVES
                )
                side = "in-plane" if axis == "in_plane" else "out-of-plane"
                found.append(
                    Entry(
                        f"an {side} moment with the {_ORDINAL[harmonic]} harmonic of the windward meridian"
                        f"{_POWER[power]}",
                        terms,
                        may_change=True,
                    )
                )
    return found


def _round_the_body() -> list[Entry]:
    """Moments of any direction that turn with the windward meridian: in plane and out of plane harmonics together.

    Once round is fixed in the body.
    """
    found = []
    for times in (-3, -2, -1, 2, 3, 4):
        for power in (0, 1):
            way = "against" if times < 0 else "with"
            found.append(
                Entry(
                    f"a moment that turns {_TIMES[abs(times)]} {way} the windward meridian in the plane of alpha"
                    f"{_POWER[power]}",
                    tuple(
                        YamlTerm(
                            name=f"{axis} turned by {times} phi_w{_POWER[power]}",
                            axis=axis,
                            turn=Turn(of="windward_meridian", rate=float(times)),
                            factors=_alpha(power),
                            units="1/rad" if power else "1",
                        )
                        for axis in _PLANE
                    ),
                    may_change=True,
                )
            )
    return found


_TIMES = {1: "once", 2: "twice", 3: "three times", 4: "four times"}
_PLANE: tuple[Axis, Axis] = ("in_plane", "out_of_plane")
WAVES: tuple[Wave, Wave] = ("cos", "sin")


def _powers() -> list[Entry]:
    """Powers of alpha, in and out of plane and times the rates, that the baseline lacks."""
    chosen: list[tuple[Axis, int]] = [("in_plane", 2), ("in_plane", 3), *(("out_of_plane", k) for k in range(4))]
    chosen += [("along_rates", 1), ("along_rates", 2), *(("across_rates", k) for k in range(3))]
    return [
        Entry(
            f"{_SIDES[_AXES.index(axis)]} moment" + (_POWER[power].replace(" times", " with") or ", constant"),
            (
                YamlTerm(
                    name=f"{axis}{_POWER[power]}",
                    axis=axis,
                    factors=_alpha(power),
                    units=f"1/rad^{power}" if power else "1",
                ),
            ),
            may_change=True,
        )
        for axis, power in chosen
    ]


def _steps(quantity: Quantity, low: float, high: float) -> list[Entry]:
    """Steps of the stiffness, in and out of plane, at a value of the quantity, sharp or gradual."""
    spacing = (high - low) / (DESCRIBED_STEPS + 1)

    def maker(axis: Axis, share: float) -> Callable[[float], Entry]:
        what = "a step of the stiffness" if axis == "in_plane" else "an out-of-plane moment with alpha that steps"

        def entry(value: float) -> Entry:
            factor = Factor(of=quantity, function="step", at=value, width=share * spacing)
            name = f"{axis} alpha, step{_WIDTHS[share]} at {quantity} {value:.12g}"
            return Entry(
                f"{what} at {_QUANTITY[quantity]} {value:.5g}{_WIDTHS[share]}",
                (YamlTerm(name=name, axis=axis, factors=(factor, *_alpha(1)), units="1/rad"),),
                value,
                spacing,
                entry,
                follows=quantity,
                form=f"{what}{_WIDTHS[share]}",
            )

        return entry

    makers = [maker(axis, share) for axis in _PLANE for share in _WIDTHS]
    return [make(low + k * spacing) for make in makers for k in range(1, DESCRIBED_STEPS + 1)]


def _smooth(quantity: Quantity, low: float, high: float) -> list[Entry]:
    """Splines: stiffness, out-of-plane slope and body-fixed moment around a value of the quantity."""
    width = (high - low) / (DESCRIBED_HATS - 1)
    found = []
    for k in range(DESCRIBED_HATS):
        at = low + k * width
        hat = Factor(of=quantity, function="bump", at=at, width=width)
        where = f"around {_QUANTITY[quantity]} {at:.4g}"
        label = f"hat at {quantity} {at:.12g}"
        slopes = (
            *(YamlTerm(name=f"{a} alpha, {label}", axis=a, factors=(hat, *_alpha(1)), units="1/rad") for a in _PLANE),
            YamlTerm(name=f"rates, {label}", axis="along_rates", factors=(hat,)),
        )
        fixed = tuple(YamlTerm(name=f"{axis}, {label}", axis=axis, factors=(hat,)) for axis in _BODY)
        for form, terms in zip(_FORMS, (*((slope,) for slope in slopes), fixed), strict=True):
            found.append(Entry(f"{form} {where}", terms, follows=quantity, form=form))
    return found


_AXES = ("in_plane", "out_of_plane", "along_rates", "across_rates")
_SIDES = ("an in-plane", "an out-of-plane", "a damping", "a cross-damping")
_FORMS = (
    "a change of the stiffness",
    "an out-of-plane moment with alpha",
    "a change of damping",
    "a body-fixed moment",
)


def _alpha(power: int) -> tuple[Factor, ...]:
    return (Factor(of="alpha", power=power),) if power else ()
