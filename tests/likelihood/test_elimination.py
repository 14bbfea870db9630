"""The elimination against dense algebra, and its stability."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.elimination import (
    BlockRows,
    Coupling,
    Eliminated,
    Quadratic,
    condense,
    eliminate,
    log_determinant,
    solve_saddle,
)


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


def every(found: Eliminated, columns: int = 4) -> tuple[FloatArray, FloatArray]:
    """States and multipliers by 1 and each parameter, (n, n_states, 1 + p)."""
    units = np.eye(columns)
    return (
        np.stack([found.states(unit) for unit in units], axis=2),
        np.stack([found.multipliers(unit) for unit in units], axis=2),
    )


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
    right = np.concatenate([problem.residual[:, :, None], problem.by_parameter], axis=2).reshape(j.shape[0], -1)
    c = np.concatenate([problem.defect[:, :, None], problem.defect_by_parameter], axis=2)
    if held:
        d, q, c = (np.concatenate([first, d]), np.concatenate([np.zeros(n_states), q]), c.reshape(n * n_states, -1))
    else:
        c = c[1:].reshape((n - 1) * n_states, -1)
    matrix = np.block([[j.T @ j, d.T], [d, -np.diag(q)]])
    return matrix, -np.concatenate([j.T @ right, c])


@given(seed=st.integers(0, 10_000), n=st.integers(8, 14), n_states=st.integers(1, 3), reach=st.integers(0, 6))
@settings(max_examples=30)
def test_it_solves_the_same_system_as_dense_algebra(seed: int, n: int, n_states: int, reach: int) -> None:
    for variance in (0.0, 0.3):
        problem = random_problem(seed, n, n_states, reach, variance)
        matrix, right = dense_matrix(problem)
        expected = np.linalg.solve(matrix, right)
        found = eliminate(problem)
        assert found is not None
        x, multiplier = every(found)
        states = x.reshape(n * n_states, -1)
        np.testing.assert_allclose(states, expected[: n * n_states], rtol=1e-7, atol=1e-9 * np.abs(states).max())
        multipliers = multiplier[1:].reshape((n - 1) * n_states, -1)
        size = np.abs(multipliers).max()
        np.testing.assert_allclose(multipliers, expected[n * n_states :], rtol=1e-6, atol=1e-8 * size)


@pytest.mark.parametrize("variance", [0.0, 0.3])
@pytest.mark.parametrize("held", [True, False])
def test_the_factors_and_their_determinant_are_those_of_dense_algebra(variance: float, held: bool) -> None:
    problem = random_problem(5, 8, 2, 0, variance)
    if held:
        problem = started(problem, 0.0)
    matrix, right = dense_matrix(problem, held)
    found = solve_saddle(problem)
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
    np.testing.assert_allclose(found.states(np.ones(1)), truth, atol=1e-10)


def test_a_state_that_no_output_sees_is_reported() -> None:
    problem = random_problem(1, 10, 2, 0, 0.0)
    blocks = np.tile(np.stack([-np.eye(2), np.eye(2)]), (9, 1, 1, 1))
    by_state = problem.by_state.blocks.copy()
    by_state[..., 1] = 0.0
    unseen = Quadratic(
        **{**problem.__dict__, "defect_by_state": BlockRows(0, blocks), "by_state": BlockRows(0, by_state)}
    )
    assert eliminate(unseen) is None


def assert_same(found: Eliminated | None, expected: Eliminated | None) -> None:
    assert found is not None
    assert expected is not None
    (x, multiplier), (x_expected, multiplier_expected) = every(found), every(expected)
    triangle, triangle_expected = found.triangle, expected.triangle
    for one, other, digits in (
        (x, x_expected, 1e-9),
        (multiplier, multiplier_expected, 1e-6),  # only their size matters
        (found.residuals(), expected.residuals(), 1e-9),
        (triangle.T @ triangle, triangle_expected.T @ triangle_expected, 1e-9),
    ):
        np.testing.assert_allclose(one, other, rtol=100 * digits, atol=digits * np.abs(other).max())


def started(problem: Quadratic, start: float) -> Quadratic:
    variance = problem.variance.copy()
    variance[0] = start
    return replace(problem, variance=variance)


def delayed_problem(n: int, delay: float, growth: float = 1.0, coupling: float = 0.05) -> Quadratic:
    """Dynamics that look `delay` samples back through interpolation between six."""
    problem = random_problem(3, n, 3, 0, 0.0)
    rng = np.random.default_rng(4)
    blocks = problem.defect_by_state.blocks.copy()
    blocks[:, 0] -= (growth - 1.0) * np.eye(3)
    at = np.arange(1, n) - delay
    index = np.clip(np.floor(at).astype(int) - 2, 0, n - 6)[:, None] + np.arange(6)
    weight = np.where(at[:, None] > 0, rng.standard_normal(6), 0.0)
    late = Coupling(index, weight, coupling * rng.standard_normal((n - 1, 3, 3)))
    return replace(problem, defect_by_state=BlockRows(0, blocks, (late,)))


@pytest.mark.parametrize("start", [np.inf, 0.0, 0.4])
def test_far_looking_dynamics_are_eliminated_alike_by_substitution_and_by_the_whole_matrix(start: float) -> None:
    problem = started(random_problem(11, 60, 3, 9, 0.0), start)
    assert_same(condense(problem), solve_saddle(problem))


@pytest.mark.parametrize("start", [np.inf, 0.0, 0.4])
def test_a_delay_is_eliminated_alike_by_substitution_and_by_the_whole_matrix(start: float) -> None:
    problem = started(delayed_problem(100, 17.3), start)
    assert_same(condense(problem), solve_saddle(problem))


def test_motion_that_outgrows_its_digits_is_not_condensed() -> None:
    """At a growth of 1.6 a sample substitution would lose 1e20."""
    problem = started(delayed_problem(100, 17.3, growth=1.6), 0.4)
    assert condense(problem) is None
    assert_same(eliminate(problem), solve_saddle(problem))


def test_what_a_delay_needs_does_not_grow_with_its_length() -> None:
    near, far = (condense(delayed_problem(1000, delay, coupling=1e-3)) for delay in (20.0, 400.0))
    assert near is not None
    assert far is not None
    assert far.dynamics.nnz <= near.dynamics.nnz


def test_a_block_row_with_couplings_is_its_matrix() -> None:
    rows = delayed_problem(40, 5.5).defect_by_state
    x = np.random.default_rng(0).standard_normal((40, 3, 2))
    expected = (rows.matrix(40) @ x.reshape(120, 2)).reshape(39, 3, 2)
    np.testing.assert_allclose(rows.dot(x), expected, atol=1e-12)
    np.testing.assert_allclose(rows.turned(np.full(3, 2.0), np.ones(3)).dot(x), 2.0 * expected, atol=1e-12)
