"""The banded elimination against dense algebra, and its stability."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.collocation import BlockRows
from brv_hypo.likelihood.condensation import condense
from brv_hypo.likelihood.elimination import eliminate, log_determinant
from brv_hypo.likelihood.quadratic import Quadratic


def dense(rows: BlockRows, n: int) -> FloatArray:
    """The block rows as one dense matrix acting on n stacked states."""
    count, width, m, n_states = rows.blocks.shape
    matrix = np.zeros((count * m, n * n_states))
    for k in range(count):
        for w in range(width):
            column = k + rows.offset + w
            if 0 <= column < n:
                matrix[k * m : (k + 1) * m, column * n_states : (column + 1) * n_states] = rows.blocks[k, w]
    return matrix


def random_problem(seed: int, n: int, n_states: int, reach: int, variance: float) -> Quadratic:
    rng = np.random.default_rng(seed)
    n_outputs, p = n_states, 3
    blocks = 0.1 * rng.standard_normal((n - 1, reach + 2, n_states, n_states))
    blocks[:, reach] -= np.eye(n_states)
    blocks[:, reach + 1] += np.eye(n_states)
    for k in range(n - 1):
        for w in range(reach + 2):
            if k - reach + w < 0:
                blocks[k, w] = 0.0
    spread = np.full((n, n_states), variance)
    spread[0] = np.inf
    return Quadratic(
        residual=rng.standard_normal((n, n_outputs)),
        by_state=BlockRows(0, 30 * rng.standard_normal((n, 1, n_outputs, n_states))),
        by_parameter=rng.standard_normal((n, n_outputs, p)),
        defect=rng.standard_normal((n, n_states)),
        defect_by_state=BlockRows(-reach, blocks),
        defect_by_parameter=rng.standard_normal((n, n_states, p)),
        variance=spread,
    )


def dense_matrix(problem: Quadratic, held: bool = False) -> tuple[FloatArray, FloatArray]:
    """K of the module's docstring and the right-hand side, states before multipliers, initial state free or
    held.
    """
    n, n_states = problem.defect.shape
    j = dense(problem.by_state, n)
    d = dense(problem.defect_by_state, n)
    first = np.eye(n_states, n * n_states)
    q = problem.variance[1:].ravel()
    right = np.concatenate([problem.residual[:, :, None], problem.by_parameter], axis=2).reshape(
        j.shape[0], -1
    )
    c = np.concatenate([problem.defect[:, :, None], problem.defect_by_parameter], axis=2)
    if held:
        d, q, c = (
            np.concatenate([first, d]),
            np.concatenate([np.zeros(n_states), q]),
            c.reshape(n * n_states, -1),
        )
    else:
        c = c[1:].reshape((n - 1) * n_states, -1)
    matrix = np.block([[j.T @ j, d.T], [d, -np.diag(q)]])
    return matrix, -np.concatenate([j.T @ right, c])


@given(seed=st.integers(0, 10_000), n=st.integers(8, 14), n_states=st.integers(1, 3), reach=st.integers(0, 6))
@settings(max_examples=30, deadline=None)
def test_it_solves_the_same_system_as_dense_algebra(seed: int, n: int, n_states: int, reach: int) -> None:
    for variance in (0.0, 0.3):
        problem = random_problem(seed, n, n_states, reach, variance)
        matrix, right = dense_matrix(problem)
        expected = np.linalg.solve(matrix, right)
        found = eliminate(problem)
        assert found is not None
        states = found.x.reshape(n * n_states, -1)
        np.testing.assert_allclose(
            states, expected[: n * n_states], rtol=1e-7, atol=1e-9 * np.abs(states).max()
        )
        multipliers = found.multiplier[1:].reshape((n - 1) * n_states, -1)
        size = np.abs(multipliers).max()
        np.testing.assert_allclose(multipliers, expected[n * n_states :], rtol=1e-6, atol=1e-8 * size)


@pytest.mark.parametrize("variance", [0.0, 0.3])
def test_the_determinant_is_that_of_the_dense_matrix(variance: float) -> None:
    problem = random_problem(5, 8, 2, 2, variance)
    held = problem.variance.copy()
    held[0] = 0.0
    held_problem = Quadratic(**{**problem.__dict__, "variance": held})
    matrix, _ = dense_matrix(problem, held=True)
    assert log_determinant(held_problem) == pytest.approx(np.linalg.slogdet(matrix)[1], rel=1e-10)


@pytest.mark.parametrize("rate", [-40.0, 40.0])
def test_it_stays_accurate_where_the_motion_grows_or_decays_beyond_the_range_of_numbers(rate: float) -> None:
    """Over 2,000 samples a sensitivity grows, or its inverse, by e^3200: forward recursion would overflow."""
    n, h = 2000, 0.04
    blocks = np.zeros((n - 1, 2, 1, 1))
    blocks[:, 0], blocks[:, 1] = -(1 + rate * h / 2), 1 - rate * h / 2
    truth = np.sin(np.arange(n) * h)[:, None]
    rows = BlockRows(0, blocks)
    variance = np.zeros((n, 1))
    variance[0] = np.inf
    problem = Quadratic(
        residual=-truth,
        by_state=BlockRows(0, np.ones((n, 1, 1, 1))),
        by_parameter=np.zeros((n, 1, 0)),
        defect=np.concatenate([[[0.0]], -rows.dot(truth)]),
        defect_by_state=rows,
        defect_by_parameter=np.zeros((n, 1, 0)),
        variance=variance,
    )
    found = eliminate(problem)
    assert found is not None
    np.testing.assert_allclose(found.x[:, :, 0], truth, atol=1e-10)


def test_a_state_that_no_output_sees_is_reported() -> None:
    problem = random_problem(1, 10, 2, 0, 0.0)
    blocks = np.tile(np.stack([-np.eye(2), np.eye(2)]), (9, 1, 1, 1))
    by_state = problem.by_state.blocks.copy()
    by_state[..., 1] = 0.0
    unseen = Quadratic(
        **{
            **problem.__dict__,
            "defect_by_state": BlockRows(0, blocks),
            "by_state": BlockRows(0, by_state),
        }
    )
    assert eliminate(unseen) is None


@pytest.mark.parametrize("start", [np.inf, 0.0, 0.4])
def test_far_looking_dynamics_are_eliminated_alike_by_recursion_and_by_the_band(
    start: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = random_problem(11, 60, 3, 9, 0.0)
    variance = problem.variance.copy()
    variance[0] = start
    problem = replace(problem, variance=variance)
    recursion = condense(problem)
    monkeypatch.setattr("brv_hypo.likelihood.elimination.condense", lambda problem: None)
    band = eliminate(problem)
    assert recursion is not None
    assert band is not None
    for found, expected in ((recursion.x, band.x), (recursion.multiplier, band.multiplier)):
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-8 * np.abs(expected).max())


def test_recursion_refuses_motion_that_grows_beyond_its_digits() -> None:
    problem = random_problem(11, 60, 1, 5, 0.0)
    blocks = problem.defect_by_state.blocks.copy()
    blocks[:, -2] *= 2.0
    assert condense(replace(problem, defect_by_state=BlockRows(-5, blocks))) is None
