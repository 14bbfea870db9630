"""Moments of known shape and unknown history: what a baseline with constant coefficients lacks of any real body.

static moment   alpha                              stiffness that changes along the flight
bend            alpha^2, alpha^3                   stiffness by angle of attack
side moment     i alpha                            asymmetry across the plane of alpha
side bend       i alpha^2, i alpha^3               side moment by angle of attack
damping         the transverse rates               damping that changes along the flight
cross damping   i times these                      Magnus-like moments
damping bends   alpha^2 times either               these by angle of attack
body            fixed in the body                  c.g. drift, nose tip; and, faster, a random moment of the flow
harmonics       alpha turning two and three times  lobes of the cross-section
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from brv_hypo.arrays import ComplexArray
from brv_hypo.mechanisms import MomentProcess, hookimpl
from brv_hypo.motion.motion import Motion


def _rates(motion: Motion) -> ComplexArray:
    """The rates of the axis across the wind times d / 2V, in the plane of alpha and across it (n,)."""
    across = motion.alpha * (motion.p - motion.windward_meridian_rate)
    return np.asarray((motion.alpha_rate + 1j * across) * motion.rate_factor)


class Static(MomentProcess):
    """C_malpha(t) alpha."""

    name, family, splines = "static_change", "stiffness", 16
    title = "static moment that changes along the flight"
    turn: ClassVar[complex] = 1.0
    powers: ClassVar[tuple[int, ...]] = (1,)

    def shapes(self, motion: Motion) -> Sequence[ComplexArray]:
        """Powers of alpha, in its plane, or across it by `turn`."""
        return tuple(np.asarray(self.turn * motion.alpha**power) for power in self.powers)


class Bend(Static):
    """Static moment that is not linear in alpha."""

    name, splines, powers = "static_bend", 5, (2, 3)
    title = "static moment that bends with the angle of attack"


class Side(Static):
    """C_n,side proportional to alpha."""

    name, family, turn = "side_change", "side", 1j
    title = "side moment that changes along the flight"


class SideBend(Bend):
    """C_n,side that is not linear in alpha."""

    name, family, turn = "side_bend", "side", 1j
    title = "side moment that bends with the angle of attack"


class Damping(MomentProcess):
    """C_mq(t) times the transverse rates, or these turned by a right angle."""

    name, family, splines = "damping_change", "rate", 12
    title = "damping that changes along the flight"
    turn: ClassVar[complex] = 1.0

    def shapes(self, motion: Motion) -> Sequence[ComplexArray]:
        """The rates."""
        return (np.asarray(self.turn * _rates(motion)),)


class CrossDamping(Damping):
    """The rates turned by a right angle."""

    name, turn = "cross_damping_change", 1j
    title = "cross-damping moment that changes along the flight"


class DampingBend(Damping):
    """Damping by angle of attack."""

    name, splines = "damping_bend", 5
    title = "damping that changes with the angle of attack"

    def shapes(self, motion: Motion) -> Sequence[ComplexArray]:
        """The rates, by the square of alpha."""
        return tuple(motion.alpha**2 * shape for shape in super().shapes(motion))


class CrossDampingBend(DampingBend):
    """Cross-damping moment by angle of attack."""

    name, turn = "cross_damping_bend", 1j
    title = "cross-damping moment that changes with the angle of attack"


class Body(MomentProcess):
    """A moment in body axes that changes slowly: the centre of gravity, the nose tip."""

    name, family, splines = "body_change", "body", 16
    title = "moment fixed in the body that grows or fades"

    def shapes(self, motion: Motion) -> Sequence[ComplexArray]:
        """Pitch and yaw, as the plane of alpha has them."""
        turn = np.exp(1j * motion.windward_meridian)
        return turn, 1j * turn


class Flow(Body):
    """The same, faster: separated flow, transition front, slosh."""

    name, splines = "flow", 40
    title = "random moment of the flow"


class TwoLobes(MomentProcess):
    """Unequal stiffness in pitch and yaw."""

    name, family, splines = "two_lobes", "harmonic", 5
    title = "moment of a two-lobed cross-section"
    lobes: ClassVar[int] = 2

    def shapes(self, motion: Motion) -> Sequence[ComplexArray]:
        """Cosine and sine of so many times the meridian."""
        turn = motion.alpha * np.exp(1j * self.lobes * motion.windward_meridian)
        return turn, 1j * turn


class ThreeLobes(TwoLobes):
    """The next harmonic of the cross-section."""

    name, lobes = "three_lobes", 3
    title = "moment of a three-lobed cross-section"


@hookimpl
def brv_hypo_mechanisms() -> Sequence[MomentProcess]:
    """Every process of the moment."""
    return [
        *(Static(), Bend(), Side(), SideBend(), Damping(), CrossDamping()),
        *(DampingBend(), CrossDampingBend(), Body(), Flow(), TwoLobes(), ThreeLobes()),
    ]
