"""The physics that each built-in mechanism claims (Table 2.1, Sections 5.3.1 and 5.3.2, errata)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from brv_hypo.mechanisms import find
from brv_hypo.mechanisms.conformance import sample_motion
from brv_hypo.motion.motion import body_from_plane

TIME = np.linspace(0.5, 5.5, 400)
MOTION = sample_motion(TIME)
angles = st.floats(-np.pi, np.pi)
delays = st.floats(0.01, 0.3)


def body_moment(term, motion=MOTION):
    """C_m + i C_n of a column."""
    return body_from_plane(term.in_plane, term.out_of_plane, motion.windward_meridian)


def steady_turn(rate):
    """The sample motion with constant alpha, C_mw and meridian rate."""

    def at(time):
        motion = sample_motion(time)
        level = np.ones_like(time)
        return replace(
            motion,
            alpha=0.05 * level,
            alpha_rate=0.0 * level,
            windward_meridian=rate * time,
            windward_meridian_rate=rate * level,
            in_plane_moment=-0.02 * level,
            history=lambda tau: at(time - tau),
        )

    return at(TIME)


class TestDamping:
    def test_is_the_damping_moment_in_plane_and_nothing_out_of_plane(self):
        (term,) = find("damping").terms(MOTION, {})
        expected = MOTION.alpha_rate * MOTION.reference_length / (2.0 * MOTION.velocity)
        np.testing.assert_allclose(term.in_plane, expected, rtol=1e-12)
        assert not np.any(term.out_of_plane)

    def test_complete_form_damps_the_precession_out_of_plane(self):
        (term,) = find("damping", {"form": "complete"}).terms(MOTION, {})
        precession = MOTION.p - MOTION.windward_meridian_rate
        np.testing.assert_allclose(term.out_of_plane, MOTION.alpha * precession * MOTION.rate_factor, rtol=1e-12)

    def test_complete_form_acts_along_the_turning_crossflow_in_axes_that_do_not_roll(self):
        """A viscous moment: c d / 2V times the rate of change of alpha as a vector."""
        (term,) = find("damping", {"form": "complete"}).terms(MOTION, {})

        def unrolled(moment, time):
            return moment * np.exp(1j * (12.0 * time + 0.05 * time**2))  # the roll angle of the sample motion

        def alpha_vector(time):
            motion = sample_motion(time)
            return unrolled(body_from_plane(motion.alpha, 0.0 * time, motion.windward_meridian), time)

        step = 1e-4
        change = (alpha_vector(TIME + step) - alpha_vector(TIME - step)) / (2.0 * step)
        found = unrolled(body_moment(term), TIME)
        np.testing.assert_allclose(found, change * MOTION.rate_factor, atol=1e-4 * np.max(np.abs(found)))


class TestInPlane:
    def test_is_offset_and_slope_in_plane_and_nothing_out_of_plane(self):
        offset, slope = find("inplane").terms(MOTION, {})
        np.testing.assert_array_equal(offset.in_plane, 1.0)
        np.testing.assert_array_equal(slope.in_plane, MOTION.alpha)
        assert not np.any(offset.out_of_plane)
        assert not np.any(slope.out_of_plane)

    def test_jumps_and_ramps_at_knots(self):
        assert find("inplane").time_variation == ("jump", "ramp")


class TestBodyFixed:
    @given(size=st.floats(1e-4, 1e-2), phi_b=angles)
    def test_is_one_constant_vector_in_body_axes(self, size, phi_b):
        cosine, sine = find("bodyfixed").terms(MOTION, {})
        moment = size * (np.cos(phi_b) * body_moment(cosine) + np.sin(phi_b) * body_moment(sine))
        np.testing.assert_allclose(moment, size * np.exp(-1j * phi_b), rtol=1e-9)

    @given(phi_b=angles)
    def test_is_the_printed_form_with_erratum_e7(self, phi_b):
        cosine, sine = find("bodyfixed").terms(MOTION, {})
        in_plane = np.cos(phi_b) * cosine.in_plane + np.sin(phi_b) * sine.in_plane
        out_of_plane = np.cos(phi_b) * cosine.out_of_plane + np.sin(phi_b) * sine.out_of_plane
        phi_w = MOTION.windward_meridian
        np.testing.assert_allclose(in_plane, np.cos(phi_b - phi_w), atol=1e-12)
        np.testing.assert_allclose(out_of_plane, np.sin(phi_w - phi_b), atol=1e-12)

    @settings(max_examples=25)
    @given(size=st.floats(1e-3, 1e-2), phi_b=angles, correlation=st.floats(-0.8, 0.8))
    def test_phi_b_has_the_uncertainty_of_random_draws(self, size, phi_b, correlation):
        """20,000 draws give a standard deviation to 0.5 %; the rest of the 4 % is the linearisation."""
        sigma_cos, sigma_sin = 0.03 * size, 0.02 * size
        mixed = correlation * sigma_cos * sigma_sin
        covariance = np.array([[sigma_cos**2, mixed], [mixed, sigma_sin**2]])
        mean = size * np.array([np.cos(phi_b), np.sin(phi_b)])
        names = ("C_b cos(phi_b)", "C_b sin(phi_b)")
        size_found, angle_found = find("bodyfixed").derived(dict(zip(names, mean, strict=True)), covariance)
        draws = np.random.default_rng(5).multivariate_normal(mean, covariance, size=20_000)
        turned = (draws[:, 0] + 1j * draws[:, 1]) * np.exp(-1j * phi_b)
        assert size_found.value == pytest.approx(size)
        assert np.exp(1j * angle_found.value) == pytest.approx(np.exp(1j * phi_b))
        assert size_found.std_error == pytest.approx(np.std(np.abs(turned)), rel=0.04)
        assert angle_found.std_error == pytest.approx(np.std(np.angle(turned)), rel=0.04)

    def test_per_cycle_variant_has_a_knot_at_every_turn_of_the_meridian(self):
        knots = find("bodyfixed", {"variant": "per_cycle"}).knots(MOTION)
        turned = np.abs(MOTION.windward_meridian - MOTION.windward_meridian[0])
        assert knots.size == int(turned[-1] // (2.0 * np.pi))
        np.testing.assert_allclose(
            np.interp(knots, TIME, turned), 2.0 * np.pi * np.arange(1, knots.size + 1), atol=12.0 * np.diff(TIME)[0]
        )

    def test_regions_variant_leaves_the_knots_to_the_engine(self):
        assert find("bodyfixed").knots(MOTION) is None


class TestSticking:
    @given(tau=delays)
    def test_printed_form_is_equation_5_1(self, tau):
        (term,) = find("sticking").terms(MOTION, {"delay": tau})
        past = sample_motion(TIME - tau)
        turned = MOTION.windward_meridian - past.windward_meridian
        np.testing.assert_allclose(term.out_of_plane, past.in_plane_moment * np.sin(turned), atol=1e-15)
        assert not np.any(term.in_plane)

    @given(tau=delays)
    def test_complete_form_leaves_the_moment_behind_at_the_delayed_meridian(self, tau):
        """In body axes: C_mw(t - tau) e_in(phi_w(t - tau)), less C_mw(t) e_in(phi_w(t))."""
        (term,) = find("sticking", {"form": "complete"}).terms(MOTION, {"delay": tau})
        past = sample_motion(TIME - tau)
        left_behind = past.in_plane_moment * np.exp(-1j * past.windward_meridian)
        no_longer = MOTION.in_plane_moment * np.exp(-1j * MOTION.windward_meridian)
        np.testing.assert_allclose(body_moment(term), left_behind - no_longer, atol=1e-14)

    @pytest.mark.parametrize("form", ["printed", "complete"])
    def test_nothing_sticks_without_delay(self, form):
        (term,) = find("sticking", {"form": form}).terms(MOTION, {"delay": 0.0})
        np.testing.assert_allclose(term.out_of_plane, 0.0, atol=1e-15)
        np.testing.assert_allclose(term.in_plane, 0.0, atol=1e-15)


class TestLag:
    @given(tau=delays)
    def test_is_what_the_lag_changes(self, tau):
        (term,) = find("lag").terms(MOTION, {"delay": tau})
        lagged = sample_motion(TIME - tau).in_plane_moment
        phi_lag = tau * MOTION.windward_meridian_rate
        np.testing.assert_allclose(MOTION.in_plane_moment + term.in_plane, lagged * np.cos(phi_lag), atol=1e-14)
        np.testing.assert_allclose(term.out_of_plane, lagged * np.sin(phi_lag), atol=1e-14)

    @given(tau=delays, rate=st.floats(-12.0, 12.0))
    def test_is_complete_sticking_where_the_meridian_turns_steadily(self, tau, rate):
        """DESIGN: the two are nearly the same thing there, and the verdict has to be able to say so."""
        motion = steady_turn(rate)
        (lag,) = find("lag").terms(motion, {"delay": tau})
        (sticking,) = find("sticking", {"form": "complete"}).terms(motion, {"delay": tau})
        np.testing.assert_allclose(lag.in_plane, sticking.in_plane, atol=1e-12)
        np.testing.assert_allclose(lag.out_of_plane, sticking.out_of_plane, atol=1e-12)

    def test_differs_from_sticking_where_the_meridian_rate_changes(self):
        (lag,) = find("lag").terms(MOTION, {"delay": 0.2})
        (sticking,) = find("sticking", {"form": "complete"}).terms(MOTION, {"delay": 0.2})
        difference = np.sqrt(np.mean((lag.out_of_plane - sticking.out_of_plane) ** 2))
        assert difference > 0.05 * np.sqrt(np.mean(sticking.out_of_plane**2))
