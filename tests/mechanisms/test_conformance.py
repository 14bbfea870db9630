"""The conformance kit passes the built-ins and catches each way of breaking the contract."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms import Derived, Mechanism, Parameter, RecordEffect, Term, installed
from brv_hypo.mechanisms.conformance import EFFECT_CHECKS, MECHANISM_CHECKS, conformance, sample_motion, uniform_time
from brv_hypo.motion.motion import Motion


def installed_as(kind):
    return [entry.item for entry in installed().values() if isinstance(entry.item, kind)]


@pytest.mark.parametrize("check", MECHANISM_CHECKS)
@pytest.mark.parametrize("mechanism", installed_as(Mechanism), ids=lambda mechanism: mechanism.name)
def test_the_installed_mechanisms_conform(mechanism, check):
    check(mechanism)


@pytest.mark.parametrize("check", EFFECT_CHECKS)
@pytest.mark.parametrize("effect", installed_as(RecordEffect), ids=lambda effect: effect.name)
def test_the_installed_effects_conform(effect, check):
    check(effect)


class Sound(Mechanism):
    """C_Z' += k alpha: conforms, and is broken in one way at a time below."""

    name = "sound"
    title = "a sound mechanism"
    claims = "an out-of-plane moment proportional to alpha"
    source = "this test"

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One term: the slope."""
        return (Term("k", np.zeros_like(motion.alpha), motion.alpha, "1/rad"),)


def term(in_plane, out_of_plane=None, *, name="k", units="1"):
    return Term(name, in_plane, np.zeros_like(in_plane) if out_of_plane is None else out_of_plane, units)


class Nameless(Sound):
    """Broken."""

    name = "No Name"


class Reserved(Sound):
    """Broken."""

    name = "none"


class Undocumented(Sound):
    """Broken."""

    def terms(self, motion, theta):
        return (term(motion.alpha),)


class Averaging(Sound):
    """Broken: uses the mean over the record."""

    def terms(self, motion, theta):
        """One term."""
        return (term(motion.alpha - np.mean(motion.alpha)),)


class ShapeLosing(Sound):
    """Broken: gives a vector whatever the shape."""

    def terms(self, motion, theta):
        """One term."""
        return (term(motion.alpha.ravel()),)


class Scalar(Sound):
    """Broken: gives a number for a vector."""

    def terms(self, motion, theta):
        """One term."""
        return (term(np.asarray(1.0)),)


class Infinite(Sound):
    """Broken: divides by zero."""

    def terms(self, motion, theta):
        """One term."""
        with np.errstate(divide="ignore"):
            return (term(1.0 / (motion.time - motion.time[..., :1])),)


class Writing(Sound):
    """Broken: changes its input."""

    def terms(self, motion, theta):
        """One term."""
        motion.alpha[...] *= 2.0
        return (term(motion.alpha),)


class Unwrapping(Sound):
    """Broken: uses the meridian as a number."""

    def terms(self, motion, theta):
        """One term."""
        return (term(motion.windward_meridian),)


class Unitless(Sound):
    """Broken: a unit that cannot be read."""

    def terms(self, motion, theta):
        """One term."""
        return (term(motion.alpha, units="furlongs per jiffy"),)


class Idle(Sound):
    """Broken: does nothing."""

    def terms(self, motion, theta):
        """One term."""
        return (term(np.zeros_like(motion.alpha)),)


class Twins(Sound):
    """Broken: two terms of one name."""

    def terms(self, motion, theta):
        """Two terms."""
        return (term(motion.alpha), term(motion.alpha**2))


class UnflaggedDelay(Sound):
    """Broken: a delay that is not flagged."""

    def parameters(self):
        return (Parameter("tau", "s", (0.1, 0.2), (0.05, 0.3), "delay"),)

    def terms(self, motion, theta):
        """One term."""
        return (term(motion.delayed(theta["tau"]).alpha),)


class FalseDelay(Sound):
    """Broken: a parameter flagged as a delay that delays nothing."""

    def parameters(self):
        return (Parameter("scale", "s", (0.1, 0.2), (0.05, 0.3), "no delay", is_delay=True),)

    def terms(self, motion, theta):
        """One term."""
        return (term(motion.alpha ** theta["scale"]),)


class OutOfBounds(Sound):
    """Broken: the grid leaves the bounds."""

    def parameters(self):
        return (Parameter("power", "1", (1.0, 4.0), (1.0, 3.0), "power of alpha"),)

    def terms(self, motion, theta):
        """One term."""
        return (term(motion.alpha ** theta["power"]),)


class NamedLikeAKnot(Sound):
    """Broken: a parameter that is called what times of change are called."""

    def parameters(self):
        return (Parameter("start", "1", (1.0, 2.0), (1.0, 3.0), "power of alpha"),)


class NamedByAPath(Sound):
    """Broken: a parameter whose name is two in a path."""

    def parameters(self):
        return (Parameter("a.b", "1", (1.0, 2.0), (1.0, 3.0), "power of alpha"),)


class TurningDelay(Sound):
    """Broken: a delay in a unit of angle."""

    def parameters(self):
        return (Parameter("tau", "rad", (0.1, 0.2), (0.05, 0.3), "delay", is_delay=True),)


class MistimedDelay(Sound):
    """Broken: a delay that is declared in ms and taken for seconds."""

    def parameters(self):
        return (Parameter("tau", "ms", (0.1, 0.2), (0.05, 0.3), "delay", is_delay=True),)

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One term."""
        return (term(motion.delayed(theta["tau"]).alpha),)


class Shifting(Sound):
    """Broken: the name of the term follows theta."""

    def parameters(self):
        return (Parameter("power", "1", (1.0, 2.0), (1.0, 3.0), "power of alpha"),)

    def terms(self, motion, theta):
        """One term."""
        return (term(motion.alpha ** theta["power"], name=f"alpha^{theta['power']}"),)


class LateKnots(Sound):
    """Broken: a knot after the end."""

    def knots(self, motion):
        return np.array([motion.time[-1] + 1.0])


class OddVariation(Sound):
    """Broken: a variation in time that the engine does not know."""

    time_variation = ("wiggle",)


class ConstantSigma(Sound):
    """Broken: a sigma that forgets the covariance."""

    def derived(self, values, covariance):
        return (Derived("k again", values["k"], 0.1, "1"),)


class HalfKnown(Sound):
    """Broken: a tolerance of two coefficients for one term."""

    def tolerance(self, flight):
        return (0.1, 0.2)


class BentTolerance(Sound):
    """Broken: a tolerance of what is not linear."""

    def parameters(self):
        return (Parameter("power", "1", (1.0, 2.0), (1.0, 3.0), "power of alpha"),)

    def tolerance(self, flight):
        return (0.1,)


class Raising(Sound):
    """Broken: raises."""

    def terms(self, motion, theta):
        """One term."""
        raise RuntimeError("no lift today")


def failed(item):
    return {outcome.check: outcome.detail for outcome in conformance(item) if not outcome.passed}


def test_a_sound_mechanism_passes_every_check():
    outcomes = conformance(Sound())
    assert [outcome.check for outcome in outcomes] == [check.__name__ for check in MECHANISM_CHECKS]
    assert failed(Sound()) == {}


@pytest.mark.parametrize(
    ("broken", "check"),
    [
        (Nameless, "is_declared"),
        (Reserved, "is_declared"),
        (Undocumented, "documents_its_terms"),
        (Averaging, "is_elementwise"),
        (ShapeLosing, "keeps_the_shape"),
        (Scalar, "keeps_the_shape"),
        (Infinite, "is_finite"),
        (Writing, "is_pure"),
        (Unwrapping, "takes_the_meridian_as_an_angle"),
        (Unitless, "states_its_units"),
        (Idle, "acts_on_the_moments"),
        (Twins, "has_the_same_terms_for_every_theta"),
        (Shifting, "has_the_same_terms_for_every_theta"),
        (UnflaggedDelay, "flags_its_delays"),
        (FalseDelay, "flags_its_delays"),
        (OutOfBounds, "has_sane_parameters"),
        (NamedLikeAKnot, "has_sane_parameters"),
        (NamedByAPath, "has_sane_parameters"),
        (TurningDelay, "has_sane_parameters"),
        (MistimedDelay, "flags_its_delays"),
        (LateKnots, "has_sane_knots"),
        (OddVariation, "varies_in_known_ways"),
        (ConstantSigma, "derives_with_uncertainty"),
        (HalfKnown, "has_a_sane_tolerance"),
        (BentTolerance, "has_a_sane_tolerance"),
        (Raising, "is_finite"),
    ],
)
def test_each_breach_is_caught_by_its_check_with_a_reason(broken, check):
    found = failed(broken())
    assert check in found
    assert len(found[check]) > 10


class GyroBias(RecordEffect):
    """A constant added to the roll gyro."""

    name = "bias_for_test"
    title = "roll gyro bias"
    claims = "a constant offset of the roll rate"
    source = "this test"
    kind = "instrument"

    def components(self, flight):
        return (("p", "rad/s", 1e-3),)

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        return replace(flight, p=flight.p + value)


class Deaf(GyroBias):
    """Broken: ignores its value."""

    def perturb(self, flight, component, value):
        return flight


class Offset(GyroBias):
    """Broken: zero is not nothing."""

    def perturb(self, flight, component, value):
        return replace(flight, p=flight.p + value + 1e-3)


class Squared(GyroBias):
    """Broken: not linear."""

    def perturb(self, flight, component, value):
        return replace(flight, p=flight.p + 1e6 * value**2)


class InPlaceBias(GyroBias):
    """Broken: writes into the record that it was given."""

    def perturb(self, flight, component, value):
        flight.p[...] += value
        return flight


def test_a_sound_effect_passes_every_check():
    assert [outcome.check for outcome in conformance(GyroBias())] == [check.__name__ for check in EFFECT_CHECKS]
    assert failed(GyroBias()) == {}


@pytest.mark.parametrize(
    ("broken", "check"),
    [
        (Deaf, "changes_the_record"),
        (Offset, "leaves_the_record_alone_at_zero"),
        (Squared, "is_linear_for_small_values"),
        (InPlaceBias, "leaves_its_input_alone"),
    ],
)
def test_each_breach_of_an_effect_is_caught(broken, check):
    assert check in failed(broken())


@pytest.mark.parametrize("angle", ["alpha", "windward_meridian"])
def test_the_sample_motion_agrees_with_its_rates(angle):
    time, step = uniform_time(), 1e-3

    def at(steps: int):
        return getattr(sample_motion(time + steps * step), angle)

    five_point = (8.0 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12.0 * step)
    np.testing.assert_allclose(getattr(sample_motion(time), f"{angle}_rate"), five_point, atol=2e-6)


def test_the_past_of_the_sample_motion_is_exact():
    time = uniform_time()
    late, early = sample_motion(time + 0.25).delayed(0.25), sample_motion(time)
    np.testing.assert_allclose(late.windward_meridian, early.windward_meridian, rtol=1e-12)
