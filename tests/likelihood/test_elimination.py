"""The elimination against dense algebra, and its stability."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_array, eye_array, kron

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.elimination import Quadratic, block_rows, eliminate, log_determinant


def random_problem(seed: int, n: int, n_states: int, variance: float) -> Quadratic:
    rng = np.random.default_rng(seed)
    n_outputs, p = n_states, 3
    blocks = 0.1 * rng.standard_normal((n - 1, 2, n_states, n_states))
    blocks[:, 0] -= np.eye(n_states)
    blocks[:, 1] += np.eye(n_states)
    spread = np.full((n, n_states), variance)
    spread[0] = np.inf
    return Quadratic(
        own=np.arange(p),
        residual=rng.standard_normal((n, n_outputs)),
        by_state=block_rows(30 * rng.standard_normal((n, 1, n_outputs, n_states))),
        by_parameter=rng.standard_normal((n, n_outputs, p)),
        defect=rng.standard_normal((n, n_states)),
        defect_by_state=block_rows(blocks),
        defect_by_parameter=rng.standard_normal((n, n_states, p)),
        variance=spread,
    )


def dense_matrix(problem: Quadratic, fixed: bool = False) -> tuple[FloatArray, FloatArray]:
    """K of the module's docstring and the right-hand side, states before multipliers, initial state free or
    fixed.
    """
    n, n_states = problem.defect.shape
    j, d = problem.by_state.toarray(), problem.defect_by_state.toarray()
    first = np.eye(n_states, n * n_states)
    q = problem.variance[1:].ravel()
    right = np.concatenate([problem.residual[:, :, None], problem.by_parameter], axis=2).reshape(j.shape[0], -1)
    c = np.concatenate([problem.defect[:, :, None], problem.defect_by_parameter], axis=2)
    if fixed:
        d, q, c = (np.concatenate([first, d]), np.concatenate([np.zeros(n_states), q]), c.reshape(n * n_states, -1))
    else:
        c = c[1:].reshape((n - 1) * n_states, -1)
    matrix = np.block([[j.T @ j, d.T], [d, -np.diag(q)]])
    return matrix, -np.concatenate([j.T @ right, c])


@given(seed=st.integers(0, 10_000), n=st.integers(8, 14), n_states=st.integers(1, 3))
@settings(max_examples=30)
def test_it_solves_the_same_system_as_dense_algebra(seed: int, n: int, n_states: int) -> None:
    for variance in (0.0, 0.3):
        problem = random_problem(seed, n, n_states, variance)
        matrix, right = dense_matrix(problem)
        expected = np.linalg.solve(matrix, right)
        found = eliminate(problem)
        assert found is not None
        states = found.x.reshape(n * n_states, -1)
        np.testing.assert_allclose(states, expected[: n * n_states], rtol=1e-7, atol=1e-9 * np.abs(states).max())
        multipliers = found.multiplier[1:].reshape((n - 1) * n_states, -1)
        size = np.abs(multipliers).max()
        np.testing.assert_allclose(multipliers, expected[n * n_states :], rtol=1e-6, atol=1e-8 * size)


@pytest.mark.parametrize("variance", [0.0, 0.3])
@pytest.mark.parametrize("fixed", [True, False])
def test_the_factors_and_their_determinant_are_those_of_dense_algebra(variance: float, fixed: bool) -> None:
    problem = random_problem(5, 8, 2, variance)
    if fixed:
        problem = started(problem, 0.0)
    matrix, right = dense_matrix(problem, fixed)
    found = eliminate(problem)
    assert found is not None
    np.testing.assert_allclose(found.x.reshape(16, -1), np.linalg.solve(matrix, right)[:16], rtol=1e-9, atol=1e-11)
    for log_det in (found.log_det, log_determinant(problem)):
        assert log_det == pytest.approx(np.linalg.slogdet(matrix)[1], rel=1e-10)


@pytest.mark.parametrize("rate", [-40.0, 40.0])
def test_it_stays_accurate_where_the_motion_grows_or_decays_beyond_the_range_of_numbers(rate: float) -> None:
    """Over 2,000 samples a sensitivity grows, or its inverse, by e^3200: forward recursion would overflow."""
    n, h = 2000, 0.04
    blocks = np.zeros((n - 1, 2, 1, 1))
    blocks[:, 0], blocks[:, 1] = -(1 + rate * h / 2), 1 - rate * h / 2
    truth = np.sin(np.arange(n) * h)[:, None]
    rows = block_rows(blocks)
    variance = np.zeros((n, 1))
    variance[0] = np.inf
    problem = Quadratic(
        own=np.arange(0),
        residual=-truth,
        by_state=block_rows(np.ones((n, 1, 1, 1))),
        by_parameter=np.zeros((n, 1, 0)),
        defect=np.concatenate([[[0.0]], -(rows @ truth)]),
        defect_by_state=rows,
        defect_by_parameter=np.zeros((n, 1, 0)),
        variance=variance,
    )
    found = eliminate(problem)
    assert found is not None
    np.testing.assert_allclose(found.x @ np.ones(1), truth, atol=1e-10)


def test_an_unobservable_state_cannot_be_eliminated() -> None:
    problem = random_problem(1, 10, 2, 0.0)
    blocks = np.tile(np.stack([-np.eye(2), np.eye(2)]), (9, 1, 1, 1))
    by_state = problem.by_state.toarray()
    by_state[:, 1::2] = 0.0
    unseen = replace(problem, defect_by_state=block_rows(blocks), by_state=csr_array(by_state))
    assert eliminate(unseen) is None


def started(problem: Quadratic, start: float) -> Quadratic:
    variance = problem.variance.copy()
    variance[0] = start
    return replace(problem, variance=variance)


def delayed_problem(n: int, delay: float) -> Quadratic:
    """Dynamics of the state `delay` samples before, through interpolation between six."""
    problem = random_problem(3, n, 3, 0.0)
    rng = np.random.default_rng(4)
    at = np.arange(1, n) - delay
    index = np.clip(np.floor(at).astype(int) - 2, 0, n - 6)[:, None] + np.arange(6)
    weight = np.where(at[:, None] > 0, rng.standard_normal(6), 0.0)
    past = csr_array((weight.ravel(), index.ravel(), 6 * np.arange(n)), shape=(n - 1, n))
    late = block_rows(0.05 * rng.standard_normal((n - 1, 1, 3, 3))) @ kron(past, eye_array(3), format="csr")
    return replace(problem, defect_by_state=csr_array(problem.defect_by_state + late), delayed=True)


def test_a_delay_is_eliminated_as_by_dense_algebra() -> None:
    problem = started(delayed_problem(60, 17.3), 0.0)
    matrix, right = dense_matrix(problem, fixed=True)
    found = eliminate(problem)
    assert found is not None
    states = found.x.reshape(180, -1)
    np.testing.assert_allclose(
        states, np.linalg.solve(matrix, right)[:180], rtol=1e-7, atol=1e-9 * np.abs(states).max()
    )


def test_rows_of_blocks_are_placed_as_their_samples() -> None:
    blocks = np.random.default_rng(0).standard_normal((4, 2, 3, 2))
    expected = np.zeros((12, 10))
    for k, (before, after) in enumerate(blocks):
        expected[3 * k : 3 * k + 3, 2 * k : 2 * k + 4] = np.hstack([before, after])
    np.testing.assert_array_equal(block_rows(blocks).toarray(), expected)
