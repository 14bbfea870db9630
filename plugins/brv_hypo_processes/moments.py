"""Moments of known shape and unknown history: what a baseline with constant coefficients lacks of any real body.

static moment   alpha                              stiffness that changes along the flight
bend            alpha^2, alpha^3                   stiffness by angle of attack
side moment     i alpha                            asymmetry across the plane of alpha
damping         the transverse rates               damping that changes along the flight
cross damping   i times these                      Magnus-like moments
damping bend    alpha^2 times the rates            damping by angle of attack
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

    def shapes(self, motion: Motion) -> Sequence[ComplexArray]:
        """One, in the plane of alpha."""
        return (np.asarray(motion.alpha, dtype=complex),)


class Bend(MomentProcess):
    """Static moment that is not linear in alpha."""

    name, family, splines = "static_bend", "stiffness", 5
    title = "static moment that bends with the angle of attack"

    def shapes(self, motion: Motion) -> Sequence[ComplexArray]:
        """Square and cube."""
        return np.asarray(motion.alpha**2, dtype=complex), np.asarray(motion.alpha**3, dtype=complex)


class Side(MomentProcess):
    """C_n,side proportional to alpha."""

    name, family, splines = "side_change", "side", 16
    title = "side moment that changes along the flight"

    def shapes(self, motion: Motion) -> Sequence[ComplexArray]:
        """One, across the plane of alpha."""
        return (np.asarray(1j * motion.alpha),)


class Damping(MomentProcess):
    """C_mq(t) times the transverse rates."""

    name, family, splines = "damping_change", "rate", 12
    title = "damping that changes along the flight"

    def shapes(self, motion: Motion) -> Sequence[ComplexArray]:
        """The rates."""
        return (_rates(motion),)


class CrossDamping(MomentProcess):
    """The rates turned by a right angle."""

    name, family, splines = "cross_damping_change", "rate", 12
    title = "cross-damping moment that changes along the flight"

    def shapes(self, motion: Motion) -> Sequence[ComplexArray]:
        """The rates, a quarter turn on."""
        return (1j * _rates(motion),)


class DampingBend(MomentProcess):
    """Damping by angle of attack."""

    name, family, splines = "damping_bend", "rate", 1
    title = "damping that changes with the angle of attack"

    def shapes(self, motion: Motion) -> Sequence[ComplexArray]:
        """Square of alpha times the rates."""
        return (_rates(motion) * motion.alpha**2,)


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
        *(Static(), Bend(), Side(), Damping(), CrossDamping()),
        *(DampingBend(), Body(), Flow(), TwoLobes(), ThreeLobes()),
    ]
