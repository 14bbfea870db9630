"""Nodes of integrals between the samples, where the crossflow passes by zero."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import cumulative_trapezoid

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.motion.interpolation import lagrange, running_integral
from brv_hypo.motion.motion import Motion, at_nodes, body_from_plane, quadrature, with_crossflow

SIZE = 0.1  # rad
RATE = 12.0  # rad/s of the coning: 26 samples a quarter of a cycle
TIME = np.arange(0.0, 1.2, 0.005)
WHOLE = ((0, TIME.size),)


def crossflow_of(time: FloatArray | float, nearest: float) -> tuple[ComplexArray, ComplexArray]:
    """A planar coning that passes by zero at this distance (rad), and its rate."""
    phase = RATE * np.asarray(time, dtype=float) + 0.3
    return SIZE * np.cos(phase) + 1j * nearest, np.asarray(-SIZE * RATE * np.sin(phase), dtype=complex)


def motion_of(time: FloatArray, nearest: float) -> Motion:
    """The motion with that crossflow; all else is constant."""
    one = np.ones_like(time)
    still = Motion(time, *[one] * 12, reference_length=1.0)
    return with_crossflow(still, *crossflow_of(time, nearest))


def constant(motion: Motion) -> ComplexArray:
    return body_from_plane(np.ones_like(motion.time), np.zeros_like(motion.time), motion.windward_meridian)


def damping(motion: Motion) -> ComplexArray:
    return body_from_plane(motion.alpha_rate, np.zeros_like(motion.time), motion.windward_meridian)


@pytest.mark.parametrize("moment", [constant, damping])
@pytest.mark.parametrize("nearest", [0.0, 1e-5, 1e-4, 1e-3, 3e-3, 0.01])
def test_integrals_of_what_turns_abruptly_are_right(moment: Callable[[Motion], ComplexArray], nearest: float) -> None:
    """To 1e-4 of what acts, for a second."""
    motion = motion_of(TIME, nearest)
    nodes = quadrature(motion, WHOLE)
    size = float(np.sqrt(np.mean(np.abs(moment(motion)) ** 2)))
    found = running_integral(nodes.time, moment(at_nodes(motion, nodes)))[nodes.samples]
    np.testing.assert_allclose(found, _exactly(moment, nearest), atol=1e-4 * size, rtol=0.0)


@pytest.mark.parametrize(
    ("moment", "nearest"), [(constant, 0.0), (constant, 1e-4), (constant, 1e-3), (damping, 1e-3), (damping, 3e-3)]
)
def test_integrals_by_the_samples_alone_are_wrong(moment: Callable[[Motion], ComplexArray], nearest: float) -> None:
    motion = motion_of(TIME, nearest)
    size = float(np.sqrt(np.mean(np.abs(moment(motion)) ** 2)))
    assert np.max(np.abs(running_integral(TIME, moment(motion)) - _exactly(moment, nearest))) > 2e-3 * size


def _exactly(moment: Callable[[Motion], ComplexArray], nearest: float) -> ComplexArray:
    """Integrals up to the samples by the trapezoidal rule on times that are dense, and far denser about the passes."""
    passes = (np.pi * (np.arange(1, 6) - 0.5) - 0.3) / RATE
    close = np.geomspace(1e-8, 0.1, 4000)
    times = np.concatenate([TIME, *(each + sign * close for each in passes for sign in (-1.0, 1.0))])
    dense = np.unique(times[(times >= TIME[0]) & (times <= TIME[-1])])
    whole = cumulative_trapezoid(moment(motion_of(dense, nearest)), dense, initial=0)
    return np.asarray(whole[np.searchsorted(dense, TIME)])


def test_a_motion_whose_meridian_turns_slowly_keeps_its_samples() -> None:
    motion = motion_of(TIME, 0.05)
    nodes = quadrature(motion, WHOLE)
    assert nodes.spread is None
    assert at_nodes(motion, nodes) is motion


def test_nothing_is_added_in_a_gap() -> None:
    segments = ((0, 20), (40, TIME.size))
    nodes = quadrature(motion_of(TIME, 1e-4), segments)
    added = np.setdiff1d(nodes.time, TIME)
    assert added.size
    assert not np.any((added > TIME[19]) & (added < TIME[40]))
    rows = nodes.rows(*segments[1])
    np.testing.assert_array_equal(nodes.time[rows][[0, -1]], TIME[[40, -1]])


@given(nearest=st.floats(0.0, 0.2), seed=st.integers(0, 2**32 - 1))
def test_samples_stay_what_they_are(nearest: float, seed: int) -> None:
    motion = motion_of(TIME, nearest)
    nodes = quadrature(motion, WHOLE)
    np.testing.assert_array_equal(nodes.time[nodes.samples], TIME)
    values = np.random.default_rng(seed).standard_normal((TIME.size, 2))
    values[7, 1] = np.nan
    np.testing.assert_array_equal(nodes.of(values)[nodes.samples], values)
    finer = at_nodes(motion, nodes)
    np.testing.assert_allclose(finer.alpha[nodes.samples], motion.alpha, rtol=0.0, atol=1e-12)
    turned = finer.windward_meridian[nodes.samples] - motion.windward_meridian
    np.testing.assert_allclose(np.exp(1j * turned), 1.0, rtol=0.0, atol=1e-9)


@given(seed=st.integers(0, 2**32 - 1))
def test_a_crossflow_of_noise_alone_has_a_bounded_number_of_nodes(seed: int) -> None:
    parts = np.random.default_rng(seed).standard_normal((2, TIME.size))
    xi = 1e-4 * (parts[0] + 1j * parts[1])
    motion = with_crossflow(motion_of(TIME, 0.0), xi, np.gradient(xi, TIME))
    assert 2 * TIME.size < quadrature(motion, WHOLE).time.size <= 9 * TIME.size


@given(seed=st.integers(0, 2**32 - 1), count=st.integers(6, 40))
def test_polynomials_of_degree_five_are_interpolated_exactly(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    nodes = np.cumsum(rng.uniform(0.5, 1.5, count)) / count
    places = rng.uniform(nodes[0], nodes[-1], 30)
    powers = rng.standard_normal(6)
    weights = lagrange(nodes, places)
    np.testing.assert_allclose(weights @ np.polyval(powers, nodes), np.polyval(powers, places), rtol=0.0, atol=1e-8)
