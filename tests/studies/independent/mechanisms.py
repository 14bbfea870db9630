"""What is planted: contributions C_N' + i C_Z' at the running state, after CONVENTIONS or outside its list.

`amplitude` is a coefficient, for `lag` the lag in s, for `wind_step` m/s. Every one acts in [start, stop).
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

LISTED = ("damping", "inplane", "bodyfixed", "lag", "sticking")
UNLISTED = ("rotating", "third_harmonic", "mach_step", "magnus", "vortex")
TRUTHS = ("none", *LISTED, *UNLISTED)
# Of the vehicle or its air, and so throughout a record; `magnus` may be as well.
THROUGHOUT = (
    "cubic_stiffness",
    "stiffness_asymmetry",
    "mach_stiffness",
    "reynolds_stiffness",
    "mach_damping",
    "reynolds_damping",
)
WIND_STEP = "wind_step"
GRAMMAR = "grammar"

ROTATION = 3.0  # rad/s at which the moment of `rotating` goes round the body


@dataclass(frozen=True)
class Running:
    """The motion at one time, air-relative; `spin` is p d / 2V, `reduced` d / 2V (s).

    `turning` is q + i r in plane axes (rad/s), `decades` log10 of the Reynolds number.
    """

    time: float
    alpha: float
    meridian: float
    alpha_rate: float
    meridian_rate: float
    mach: float
    spin: float
    reduced: float
    static: Callable[[float], float]
    past: Callable[[float], tuple[float, float]]  # alpha and meridian (to a turn) so many seconds ago
    turning: complex
    decades: float


@dataclass(frozen=True)
class Planted:
    """A mechanism with its values; what acts `beside` it adds to its contribution."""

    name: str = "none"
    amplitude: float = 0.0
    start: float = 0.0
    stop: float = 0.0
    values: dict[str, Any] = field(default_factory=dict)
    beside: Planted | None = None
    onset: float = 0.0
    """s over which it begins, about `start`; 0: a step."""

    @property
    def parts(self) -> tuple[Planted, ...]:
        """It and all that act beside it."""
        return (self, *(self.beside.parts if self.beside is not None else ()))

    @property
    def gust(self) -> tuple[float, np.ndarray] | None:
        """When the wind steps, s, and by how much (3,), m/s in earth axes."""
        step = next((part for part in self.parts if part.name == WIND_STEP), None)
        return None if step is None else (step.start, step.amplitude * np.array(step.values["across"]))

    @property
    def delay(self) -> float:
        """Its delay, s."""
        return self.amplitude if self.name == "lag" else float(self.values.get("delay", 0.0))

    @property
    def edges(self) -> tuple[float, ...]:
        """Times at which the moment or its first derivatives jump."""
        planted = [part for part in self.parts if part.name != "none"]
        found = {
            edge + k * part.delay
            for part in planted
            for edge in (part.start - 0.5 * part.onset, part.start + 0.5 * part.onset, part.stop)
            for k in range(3)
        }
        return tuple(sorted(found))

    def delay_at(self, time: float) -> float:
        """The longest delay of what acts then, s."""
        return max((part.delay for part in self.parts if part.acts(time)), default=0.0)

    def acts(self, time: float) -> bool:
        return self.start - 0.5 * self.onset <= time < self.stop

    def weight(self, time: float) -> float:
        """Its share at a time: 1 where it acts, on the way there a smooth step."""
        if not self.acts(time):
            return 0.0
        way = (time - self.start) / self.onset + 0.5 if self.onset else 1.0
        return 1.0 if way >= 1.0 else way * way * (3.0 - 2.0 * way)

    def contribution(self, now: Running) -> complex:
        return sum((part.weight(now.time) * part.claim(now) for part in self.parts if part.acts(now.time)), 0j)

    def claim(self, now: Running) -> complex:
        """Its own contribution, region or no."""
        return _FORMS[self.name](self, now) if self.amplitude != 0.0 else 0j


def _damping(planted: Planted, now: Running) -> complex:
    return complex(planted.amplitude * now.alpha_rate * now.reduced)


def _inplane(planted: Planted, now: Running) -> complex:
    return complex(planted.amplitude * (planted.values["offset"] + planted.values["slope"] * now.alpha))


def _bodyfixed(planted: Planted, now: Running) -> complex:
    angle = planted.values["angle"]
    return complex(
        planted.amplitude * math.cos(angle - now.meridian), planted.amplitude * math.sin(now.meridian - angle)
    )


def _lag(planted: Planted, now: Running) -> complex:
    before, _ = now.past(planted.delay)
    return now.static(before) * cmath.exp(1j * planted.delay * now.meridian_rate) - now.static(now.alpha)


def _sticking(planted: Planted, now: Running) -> complex:
    before, meridian = now.past(planted.delay)
    return 1j * planted.amplitude * now.static(before) * math.sin(now.meridian - meridian)


def _rotating(planted: Planted, now: Running) -> complex:
    angle = planted.values["angle"] + ROTATION * (now.time - planted.start)
    return planted.amplitude * cmath.exp(1j * (now.meridian - angle))


def _third_harmonic(planted: Planted, now: Running) -> complex:
    return planted.amplitude * now.alpha * cmath.exp(1j * (3.0 * now.meridian + planted.values["angle"]))


def _mach_step(planted: Planted, now: Running) -> complex:
    step = 0.5 * (1.0 + math.tanh((planted.values["mach"] - now.mach) / planted.values["width"]))
    return complex(planted.amplitude * step * now.alpha)


def _mach_band(planted: Planted, now: Running) -> complex:
    """The slope between two Mach numbers, and nothing beyond either."""
    low, high, width = (planted.values[name] for name in ("low", "high", "width"))
    inside = 0.5 * (math.tanh((now.mach - low) / width) - math.tanh((now.mach - high) / width))
    return complex(planted.amplitude * inside * now.alpha)


def _magnus(planted: Planted, now: Running) -> complex:
    return 1j * planted.amplitude * now.spin * now.alpha


def _vortex(planted: Planted, now: Running) -> complex:
    return 1j * planted.amplitude * now.alpha**2


def _cubic_stiffness(planted: Planted, now: Running) -> complex:
    return complex(planted.amplitude * now.alpha**3)


def _stiffness_asymmetry(planted: Planted, now: Running) -> complex:
    return planted.amplitude * now.alpha * cmath.exp(1j * (2.0 * now.meridian + planted.values["angle"]))


def _tens_of_mach(planted: Planted, now: Running) -> float:
    return (now.mach - float(planted.values["mach"])) / 10.0


def _decades(planted: Planted, now: Running) -> float:
    return now.decades - float(planted.values["decades"])


def _mach_stiffness(planted: Planted, now: Running) -> complex:
    return complex(planted.amplitude * _tens_of_mach(planted, now) * now.alpha)


def _reynolds_stiffness(planted: Planted, now: Running) -> complex:
    return complex(planted.amplitude * _decades(planted, now) * now.alpha)


def _mach_damping(planted: Planted, now: Running) -> complex:
    return planted.amplitude * _tens_of_mach(planted, now) * now.turning * now.reduced


def _reynolds_damping(planted: Planted, now: Running) -> complex:
    return planted.amplitude * _decades(planted, now) * now.turning * now.reduced


def _wind_step(planted: Planted, now: Running) -> complex:
    """No moment of its own: the air moves."""
    return 0j


def _grammar(planted: Planted, now: Running) -> complex:
    """A sentence of `grammar`: every shape is 1 at its scale of alpha."""
    value = planted.values
    alpha, power, direction = now.alpha / value["scale"], value["power"], value["direction"]
    powers = 1.0 if direction in ("along", "across", "body") else alpha
    powers *= 1.0 - (now.alpha / value["at"]) ** 2 if power < 0 else alpha ** (power - 1)
    if value["mach"] is not None:
        powers *= math.exp(-0.5 * ((now.mach - value["mach"]) / value["width"]) ** 2)
    lobes = {"two lobes": 2.0, "three lobes": 3.0}.get(direction, 1.0)
    turns = {
        "plane": 1.0 + 0j,
        "side": 1j,
        "along": now.turning * now.reduced,
        "across": 1j * now.turning * now.reduced,
    }
    angle = value["angle"] + value["turning"] * now.time
    return planted.amplitude * powers * turns.get(direction, cmath.exp(1j * (lobes * now.meridian - angle)))


_FORMS: dict[str, Callable[[Planted, Running], complex]] = {
    "damping": _damping,
    "inplane": _inplane,
    "bodyfixed": _bodyfixed,
    "lag": _lag,
    "sticking": _sticking,
    "rotating": _rotating,
    "third_harmonic": _third_harmonic,
    "mach_step": _mach_step,
    "mach_band": _mach_band,
    "magnus": _magnus,
    "vortex": _vortex,
    "cubic_stiffness": _cubic_stiffness,
    "stiffness_asymmetry": _stiffness_asymmetry,
    "mach_stiffness": _mach_stiffness,
    "reynolds_stiffness": _reynolds_stiffness,
    "mach_damping": _mach_damping,
    "reynolds_damping": _reynolds_damping,
    WIND_STEP: _wind_step,
    GRAMMAR: _grammar,
}


def body_components(contribution: np.ndarray, meridian: np.ndarray) -> np.ndarray:
    """C_m + i C_n of C_N' + i C_Z'."""
    return contribution * np.exp(-1j * meridian)
