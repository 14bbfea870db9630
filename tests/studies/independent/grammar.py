"""Effects that no plugin has, drawn from a grammar: direction x power of alpha x Mach number x turning rate.

direction   in the plane of alpha or across it, along or across the transverse rates, fixed in the body, in lobes
power       alpha^k, or alpha (1 - (alpha / a)^2), which changes sign at a; times rates, or fixed in the body, one less
Mach        throughout, or a hat about a Mach number of the flight
turning     a moment fixed in the body may turn slowly in it

What a baseline has already (C_malpha, its cube, C_mq, trim) is left out. Sizes are 3 to 30 detection limits in the
record (`record_oracle`), log-uniform.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from tests.studies.independent.dynamics import PAD
from tests.studies.independent.flights import Made, draw_flight, make_flight
from tests.studies.independent.mechanisms import GRAMMAR, Planted
from tests.studies.independent.oracle import DETECTED
from tests.studies.independent.record_oracle import f_ratios_in_record
from tests.studies.independent.vehicles import Craft

FAMILY = {
    "plane": "stiffness",
    "side": "side",
    "along": "rate",
    "across": "rate",
    "body": "body",
    "two lobes": "harmonic",
    "three lobes": "harmonic",
}
POWERS = dict.fromkeys(FAMILY, (1, 2, 3, -1)) | {"two lobes": (1, 2), "three lobes": (1, 2)}
POWERS["body"] = (1, 2)
TIMES = (3.0, 30.0)  # detection limits
FIRST = 0.003  # of the static moment, at which the limit is calculated
LARGEST = 0.5  # of it
ROUNDS = 2  # of sizing: what is planted changes the motion that decides its limit
HAT = (0.1, 0.4)  # of the range of Mach numbers, half width
TURNING = (0.3, 2.0)  # rad/s
_STREAM = 17


@dataclass(frozen=True)
class Kind:
    """One sentence of the grammar; a power of -1 is alpha (1 - (alpha / a)^2)."""

    direction: str
    power: int
    hat: bool
    turns: bool

    @property
    def name(self) -> str:
        """In a few words."""
        shape = "ring" if self.power < 0 else f"alpha^{self.power}"
        return " ".join([self.direction, shape, *["hat"] * self.hat, *["turning"] * self.turns])

    @property
    def family(self) -> str:
        """That of the processes of its shape."""
        return FAMILY[self.direction]


def _is_baseline(kind: Kind) -> bool:
    in_baseline = {"plane": (1, 3, -1), "along": (1,), "body": (1,)}
    return not kind.hat and not kind.turns and kind.power in in_baseline.get(kind.direction, ())


KINDS = tuple(
    kind
    for direction, powers in POWERS.items()
    for kind in itertools.starmap(
        Kind, itertools.product((direction,), powers, (False, True), (False, True)[: 1 + (direction == "body")])
    )
    if not _is_baseline(kind)
)


def sized(seed: int, kind: Kind, **vehicle: Craft) -> tuple[Made, float]:
    """The flight of a seed with an effect of this kind, and at how many detection limits in its record; `vehicle`: what
    flies it.

    Raises RuntimeError or ValueError where none can be flown, or no effect so large.
    """
    rng, plain = np.random.default_rng([seed, _STREAM]), draw_flight(seed, truth="none", **vehicle)
    true, wanted = plain.true, float(np.exp(rng.uniform(*np.log(TIMES))))
    low, high = float(true.mach.min()), float(true.mach.max())
    largest = float(np.quantile(true.alpha, 0.95))
    values = {
        "direction": kind.direction,
        "power": kind.power,
        "at": float(rng.uniform(0.4, 0.8)) * largest,
        "scale": largest,
        "mach": float(rng.uniform(low, high)) if kind.hat else None,
        "width": float(rng.uniform(*HAT)) * (high - low),
        "angle": float(rng.uniform(-np.pi, np.pi)),
        "turning": float(rng.uniform(*TURNING)) * kind.turns,
    }
    span, sign = true.craft.duration, float(rng.choice([-1.0, 1.0]))
    unit = Planted(GRAMMAR, 1.0, -2.0 * PAD, span + 2.0 * PAD, values)
    claim = make_flight(true.craft, seed=seed, start=true.start, planted=replace(unit, amplitude=1e-9)).true.claim
    most = np.sqrt(np.mean(true.static(true.alpha) ** 2) / np.mean(np.abs(claim / 1e-9) ** 2))

    def flown(share: float) -> tuple[Made, float]:
        made = make_flight(
            true.craft, seed=seed, start=true.start, planted=replace(unit, amplitude=sign * share * most)
        )
        (f_ratio,) = f_ratios_in_record(made)
        return made, float(np.sqrt(f_ratio / DETECTED))

    share = FIRST
    made, times = flown(share)
    for _ in range(ROUNDS):
        share = min(wanted * share / times, LARGEST)
        made, times = flown(share)
    if times < 0.8 * TIMES[0]:
        raise ValueError(f"at most {times:.1f} detection limits on this record")
    return made, times
