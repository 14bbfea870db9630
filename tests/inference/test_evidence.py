"""The evidence against the same Gaussian written out as matrices, and against data that its own model makes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from brv_hypo.arrays import FloatArray
from brv_hypo.inference import Evidence, Rows, evidence, maximised
from brv_hypo.inference.marginal import lower_factor
from brv_hypo.inference.rows import Terms
from brv_hypo.thresholds import MECHANISM_AMPLITUDE, NOISE_LEVEL
from tests.inference.small import Dense, Sizes, dense, small, without_prior

SIZES = st.builds(
    Sizes,
    flights=st.integers(1, 3),
    rows=st.integers(25, 45),
    baseline=st.integers(1, 3),
    allowed=st.integers(0, 2),
    terms=st.integers(0, 3),
    shifts=st.integers(0, 2),
    splines=st.lists(st.integers(1, 4), min_size=1, max_size=3).map(tuple),
    without_prior=st.integers(0, 2),
)
ONE_AND_TWO = pytest.mark.parametrize("sizes", [Sizes(), Sizes(flights=2)])
AGREE = 1e-8
"""Relative; two ways of some 100 rows through double precision."""


def found(sizes: Sizes, seed: int = 1) -> Evidence:
    return maximised(*small(sizes, seed))


# ---- The level, and where it is largest ----


@given(sizes=SIZES, seed=st.integers(0, 1000))
def test_the_level_is_the_log_density_of_the_whole_covariance(sizes: Sizes, seed: int) -> None:
    own = found(sizes, seed)
    assert own.level == pytest.approx(dense(own).log_evidence, rel=AGREE)


@ONE_AND_TWO
def test_hypotheses_of_one_problem_differ_by_what_their_densities_differ_by(sizes: Sizes) -> None:
    rows, terms = small(sizes, 2)
    null = maximised(rows, Terms(np.zeros((rows.y.size, 0)), np.zeros(0), np.zeros(0, dtype=bool)))
    own = maximised(rows, terms, null.at)
    assert own.level - null.level == pytest.approx(dense(own).log_evidence - dense(null).log_evidence, abs=1e-8)


class Cost(NamedTuple):
    """What is minimised, with its first and second derivatives."""

    value: Callable[[FloatArray], float]
    slope: Callable[[FloatArray], FloatArray]
    curvature: Callable[[FloatArray], FloatArray]


def cost_of(rows: Rows, terms: Terms, patch: pytest.MonkeyPatch) -> Cost:
    called: list[Cost] = []

    def stays(cost: Any, start: FloatArray, *, jac: Any, hess: Any, **options: Any) -> SimpleNamespace:
        called.append(Cost(cost, jac, hess))
        return SimpleNamespace(x=start, fun=cost(start), jac=jac(start), hess=hess(start))

    with patch.context() as context:
        context.setattr(evidence, "minimize", stays)
        maximised(rows, terms)
    return called[0]


def differences(of: Callable[[FloatArray], Any], at: FloatArray) -> FloatArray:
    """Central ones."""
    step = 1e-5
    return np.array([(of(at + one) - of(at - one)) / (2.0 * step) for one in step * np.eye(at.size)])


@settings(max_examples=10)
@given(sizes=SIZES, seed=st.integers(0, 1000))
def test_slope_and_curvature_are_those_of_central_differences(sizes: Sizes, seed: int) -> None:
    rows, terms = small(sizes, seed)
    with pytest.MonkeyPatch.context() as patch:
        cost = cost_of(rows, terms, patch)
    at = np.random.default_rng(seed).uniform(-1.0, 0.6, 1 + len(rows.groups) + (1 if sizes.terms else 0))
    assert cost.value(at) == pytest.approx(-Dense(rows, terms, at).log_evidence, rel=AGREE)
    assert cost.slope(at) == pytest.approx(differences(cost.value, at), rel=1e-6, abs=1e-6)
    assert np.allclose(cost.curvature(at), differences(cost.slope, at), rtol=1e-6, atol=1e-6)


@ONE_AND_TWO
@pytest.mark.parametrize("seed", range(3))
def test_no_other_amplitudes_are_more_probable(sizes: Sizes, seed: int) -> None:
    """As far as the maximisation goes: to a thousandth of a nat."""
    own = found(sizes, seed)
    rng = np.random.default_rng(seed)
    for scale in (0.01, 0.1, 0.5):
        for _ in range(20):
            moved = own.at + scale * rng.standard_normal(own.at.size)
            assert Dense(own.rows, own.terms, moved).log_evidence < own.level + 1e-3


def test_from_where_it_ends_a_maximisation_goes_no_further() -> None:
    rows, terms = small(Sizes(), 3)
    best = maximised(rows, terms)
    assert maximised(rows, terms, best.at[: 1 + len(rows.groups)]).level == pytest.approx(best.level, abs=1e-3)


# ---- Coefficients, processes and their errors ----


@given(sizes=SIZES, seed=st.integers(0, 1000))
def test_coefficients_and_their_covariance_are_those_of_the_normal_equations(sizes: Sizes, seed: int) -> None:
    own = found(sizes, seed)
    rows, whole = own.rows, dense(own)
    mean, covariance = whole.posterior()
    flat, known = whole.flat.shape[1], sizes.terms + sizes.shifts
    chosen = [*range(without_prior(rows).shape[1], flat), *range(flat + sizes.allowed, flat + sizes.allowed + known)]
    makes = np.eye(len(chosen))
    makes[: sizes.baseline, : sizes.baseline] = rows.coefficients
    scale = np.sqrt(np.diag(own.covariance))
    assert own.values == pytest.approx(makes @ mean[chosen], rel=1e-7, abs=1e-7 * float(scale.max()))
    expected = makes @ covariance[np.ix_(chosen, chosen)] @ makes.T
    assert own.covariance / np.outer(scale, scale) == pytest.approx(expected / np.outer(scale, scale), abs=1e-7)


@ONE_AND_TWO
def test_processes_and_their_errors_are_those_of_the_normal_equations(sizes: Sizes) -> None:
    own = found(sizes, 4)
    rows, whole = own.rows, dense(own)
    mean, covariance = whole.posterior()
    first = whole.flat.shape[1] + sizes.allowed + sizes.terms + sizes.shifts
    width = sum(sizes.splines)
    starts = [first + flight * width for flight in range(sizes.flights)]
    for process, group in enumerate(rows.groups):
        place = rows.blocks[0].columns[process]
        each = [np.arange(start + place.start, start + place.stop) for start in starts]
        coefficients, errors = own.spline_coefficients(process)
        alone = np.concatenate(each)
        assert coefficients == pytest.approx(group.size * mean[alone], rel=1e-7, abs=1e-9)
        assert errors == pytest.approx(group.size * np.sqrt(np.diag(covariance)[alone]), rel=1e-7)
        made = [block.z[:, place] @ mean[here] for block, here in zip(rows.blocks, each, strict=True)]
        assert own.made_by(process) == pytest.approx(np.concatenate(made), rel=1e-7, abs=1e-9)


@ONE_AND_TWO
def test_a_function_along_a_flight_is_that_of_the_normal_equations(sizes: Sizes) -> None:
    """Of coefficients, terms and processes at once, their common errors included; and how far what it is not made of,
    the first process and the first coefficient, is correlated with it.
    """
    own, flight = found(sizes, 4), sizes.flights - 1
    whole, rng, points = dense(own), np.random.default_rng(8), 7
    mean, covariance = whole.posterior()
    values = rng.normal(size=(points, sizes.baseline + sizes.terms + sizes.shifts))
    values[:, 0] = 0.0
    splines = {k: rng.normal(size=(points, count)) for k, count in enumerate(sizes.splines) if k}
    flat, known = whole.flat.shape[1], sizes.baseline
    first = flat + sizes.allowed + sizes.terms + sizes.shifts + flight * sum(sizes.splines)
    makes = np.zeros((points, mean.size))
    makes[:, without_prior(own.rows).shape[1] : flat] = values[:, :known] @ own.rows.coefficients
    makes[:, flat + sizes.allowed : flat + sizes.allowed + sizes.terms + sizes.shifts] = values[:, known:]
    for k, each in splines.items():
        place = own.rows.blocks[flight].columns[k]
        makes[:, first + place.start : first + place.stop] = own.rows.groups[k].size * each
    value, error, correlation = own.along(flight, values, splines)
    assert value == pytest.approx(makes @ mean, rel=1e-7, abs=1e-9)
    assert error == pytest.approx(np.sqrt(np.sum((makes @ covariance) * makes, axis=1)), rel=1e-7)
    place, coefficient = own.rows.blocks[flight].columns[0], np.zeros((1, mean.size))
    coefficient[:, without_prior(own.rows).shape[1] : flat] = own.rows.coefficients[0]
    process = np.eye(mean.size)[first + place.start : first + place.stop]
    found_of = np.zeros((points, correlation.shape[1]))
    for column, other in ((0, process), (len(sizes.splines), coefficient)):
        across, spread = makes @ covariance @ other.T, other @ covariance @ other.T
        found_of[:, column] = np.sqrt(np.sum(across * np.linalg.solve(spread, across.T).T, axis=1)) / error
    assert correlation == pytest.approx(found_of, rel=1e-6, abs=1e-9)


@ONE_AND_TWO
def test_the_share_of_terms_is_what_they_make_of_what_is_explained(sizes: Sizes) -> None:
    """Of processes of noise alone all, and of processes that make nearly everything little."""
    own = found(sizes, 5)
    assert 0.0 < own.share_of_terms <= 1.0
    rows, z = own.rows, own.rows.blocks[0].z
    y = rows.y.copy()
    y[rows.blocks[0].rows] += 1e3 * z[:, 0] / np.linalg.norm(z[:, 0])
    assert maximised(replace(rows, y=y), own.terms).share_of_terms < own.share_of_terms
    at = own.at.copy()
    at[1 : 1 + len(rows.groups)] = -30.0
    quiet = replace(own, at=at)
    assert quiet.share_of_terms == pytest.approx(1.0)


@ONE_AND_TWO
def test_the_residual_is_the_data_less_all_that_the_normal_equations_fit(sizes: Sizes) -> None:
    own = found(sizes, 4)
    whole = dense(own)
    mean, _ = whole.posterior()
    fitted = np.concatenate([whole.flat, whole.bounded[0]], axis=1) @ mean
    assert own.residual == pytest.approx(own.rows.y - fitted, rel=1e-7, abs=1e-9)


# ---- Other data: stretches of time left out, and what further columns would find ----


@settings(max_examples=10)
@given(sizes=SIZES.filter(lambda sizes: not sizes.without_prior), seed=st.integers(0, 1000))
def test_a_stretch_left_out_is_a_problem_without_its_rows(sizes: Sizes, seed: int) -> None:
    own = found(sizes, seed)
    stretches = own.rows.time_blocks
    expected = [dense(own).log_density(stretches != k) + dense(own).log_prior for k in np.unique(stretches)]
    assert own.level - own.held_out == pytest.approx(expected, rel=AGREE)


@ONE_AND_TWO
def test_a_stretch_held_out_has_its_predictive_density(sizes: Sizes) -> None:
    """Mean and covariance of its rows, given the others, by the rule for Gaussians."""
    own = found(sizes, 6)
    whole, y, stretches = dense(own), own.rows.y, own.rows.time_blocks
    assert own.held_out.shape == np.unique(stretches).shape
    for k, density in zip(np.unique(stretches), own.held_out, strict=True):
        here, rest = stretches == k, stretches != k
        to_flat = np.linalg.inv(whole.covariance[np.ix_(rest, rest)])
        across = whole.covariance[np.ix_(here, rest)] @ to_flat
        inner = np.linalg.inv(whole.flat[rest].T @ to_flat @ whole.flat[rest])
        coefficients = inner @ (whole.flat[rest].T @ to_flat @ y[rest])
        mean = whole.flat[here] @ coefficients + across @ (y[rest] - whole.flat[rest] @ coefficients)
        beyond = whole.flat[here] - across @ whole.flat[rest]
        covariance = whole.covariance[np.ix_(here, here)] - across @ whole.covariance[np.ix_(rest, here)]
        expected = stats.multivariate_normal(mean, covariance + beyond @ inner @ beyond.T).logpdf(y[here])
        assert density == pytest.approx(expected + 0.5 * np.sum(here) * np.log(2.0 * np.pi), rel=1e-7)


def rates_of(rows: Rows, seed: int, count: int) -> FloatArray:
    """Random columns (n, count) that are zero on the second half of each flight's rows, where moments show nothing."""
    rates = np.random.default_rng(seed).standard_normal((rows.y.size, count))
    for block in rows.blocks:
        rates[block.rows[block.rows.size // 2 :]] = 0.0
    return rates


@settings(max_examples=10)
@given(sizes=SIZES, seed=st.integers(0, 1000), count=st.integers(1, 4))
def test_products_of_moments_are_those_of_their_whitened_columns(sizes: Sizes, seed: int, count: int) -> None:
    """Errors within tolerances among the noise."""
    rows, terms = small(sizes, seed)
    rng, blocks = np.random.default_rng(20_000 + seed), []
    for block in rows.blocks:
        errors = rng.standard_normal((block.rows.size, 3))
        errors = np.linalg.qr(errors - block.own @ (block.own.T @ errors))[0]
        blocks.append(replace(block, errors=errors, shrunk=rng.uniform(0.1, 0.9, 3)))
    rows = replace(rows, blocks=tuple(blocks))
    rates = rates_of(rows, seed, count)
    found = rows.products.beside(rows, terms.x).beside_moments(rows, terms.x, rates)
    expected = rows.products.beside(rows, np.concatenate([terms.x, rows.whitened(rates)], axis=1))
    assert found.across == pytest.approx(expected.across, rel=1e-9, abs=1e-9)
    assert found.right == pytest.approx(expected.right, rel=1e-9, abs=1e-9)
    for own, other in zip(found.flights.values(), expected.flights.values(), strict=True):
        assert own.with_border == pytest.approx(other.with_border, rel=1e-9, abs=1e-9)


@settings(max_examples=10)
@given(sizes=SIZES, seed=st.integers(0, 1000), count=st.integers(1, 4))
def test_products_of_further_columns_are_projected(sizes: Sizes, seed: int, count: int) -> None:
    own = found(sizes, seed)
    rows, rates = own.rows, rates_of(own.rows, 10_000 + seed, count)
    x = rows.whitened(rates)
    information, right = own.projected(own.with_moments(rates))
    p = dense(own).projector
    scale = float(np.max(np.abs(x.T @ p @ x)))
    assert information == pytest.approx(x.T @ p @ x, rel=1e-7, abs=1e-7 * scale)
    assert right == pytest.approx(x.T @ p @ rows.y, rel=1e-7, abs=1e-7 * scale * float(np.abs(rows.y).max()))


def test_the_information_of_a_column_is_what_its_flat_coefficient_has() -> None:
    """One more column of the baseline: its generalised least squares."""
    own = found(Sizes(), 8)
    x = rates_of(own.rows, 8, 1)
    information, right = own.projected(own.with_moments(x))
    wider = replace(
        own.rows, shared=np.concatenate([own.rows.shared, x], axis=1), spread=np.append(own.rows.spread, np.inf)
    )
    mean, covariance = Dense(wider, own.terms, own.at).posterior()
    place = int(np.sum(np.isinf(own.rows.spread)))
    assert right[0] / information[0, 0] == pytest.approx(mean[place], rel=1e-7)
    assert 1.0 / information[0, 0] == pytest.approx(covariance[place, place], rel=1e-7)


def test_beside_the_baseline_is_the_residual_of_least_squares() -> None:
    rows, _ = small(Sizes(flights=2), 9)
    flat = rows.shared[:, np.isinf(rows.spread)]
    residual = rows.y - flat @ np.linalg.lstsq(flat, rows.y, rcond=None)[0]
    assert rows.beside_baseline(rows.y) == pytest.approx(residual, abs=1e-12)
    assert rows.beside_baseline(np.column_stack([rows.y, rows.y])) == pytest.approx(
        np.column_stack([residual, residual]), abs=1e-12
    )


@pytest.mark.parametrize("flights", [1, 2])
def test_errors_within_tolerances_are_noise(flights: int) -> None:
    """Scalar products of whitened rows are those under the inverse of 1 + T T' of each flight."""
    rng = np.random.default_rng(14)
    rows, _ = small(Sizes(flights=flights, rows=30, without_prior=1), 13)
    blocks, expected = [], np.zeros((rows.y.size, rows.y.size))
    for block in rows.blocks:
        own = block.own
        tolerances = 3.0 * rng.standard_normal((30, 4))
        tolerances -= own @ (own.T @ tolerances)
        directions, sizes, _ = np.linalg.svd(tolerances, full_matrices=False)
        blocks.append(replace(block, errors=directions, shrunk=1.0 / np.sqrt(1.0 + sizes**2)))
        expected[np.ix_(block.rows, block.rows)] = np.linalg.inv(np.eye(30) + tolerances @ tolerances.T)
    noisy = replace(rows, blocks=tuple(blocks))
    given = rng.standard_normal((rows.y.size, 3))
    known = given - without_prior(rows) @ (without_prior(rows).T @ given)
    assert noisy.whitened(given).T @ noisy.whitened(given) == pytest.approx(known.T @ expected @ known)
    assert without_prior(rows).T @ noisy.whitened(given) == pytest.approx(np.zeros((flights, 3)), abs=1e-12)


# ---- On data that the model itself makes ----

MADE = Sizes(flights=2, rows=80, terms=3, shifts=0, splines=(6, 8))


@cache
def drawn(count: int) -> tuple[FloatArray, FloatArray]:
    """Of problems drawn from the priors: (draws, coefficients) off in stated errors, and 2 ln by which the amplitudes
    of the truth are less probable than those found (draws,).
    """
    rng = np.random.default_rng(20261126)
    frame, terms = small(MADE, 10)
    priors = [NOISE_LEVEL, *(group.prior for group in frame.groups), MECHANISM_AMPLITUDE]
    centre, width = np.array(priors).T
    off, fall = [], []
    for _ in range(count):
        at = centre + width * rng.standard_normal(centre.size)
        whole = Dense(frame, terms, at)
        columns, spreads = whole.bounded
        unknown = whole.noise * spreads * rng.standard_normal(spreads.size)
        flat = 10.0 * rng.standard_normal(whole.flat.shape[1])
        y = whole.flat @ flat + columns @ unknown + whole.noise * rng.standard_normal(frame.y.size)
        rows = replace(frame, y=y)
        own = maximised(rows, terms)
        true = np.concatenate([frame.coefficients @ flat, unknown[MADE.allowed : MADE.allowed + MADE.terms]])
        off.append((own.values - true) / np.sqrt(np.diag(own.covariance)))
        fall.append(2.0 * (own.level - Dense(rows, terms, at).log_evidence))
    return np.array(off), np.array(fall)


def check_coverage(draws: int, within: float) -> None:
    """Shares may miss the nominal ones by `within`."""
    off, fall = drawn(draws)
    nominal = 1.0 - 2.0 * stats.norm.sf(2.0)
    assert np.mean(np.abs(off) < 2.0) == pytest.approx(nominal, abs=within)
    assert np.mean(np.abs(off[:, : MADE.baseline]) < 2.0) == pytest.approx(nominal, abs=within)
    amplitudes = 2 + len(MADE.splines)
    assert np.mean(fall < stats.chi2.ppf(0.95, amplitudes)) > 0.95 - within


def test_stated_errors_and_amplitudes_have_their_coverage() -> None:
    """40 draws: three standard errors of a share of 0.95 are 0.10."""
    check_coverage(40, 0.10)


@pytest.mark.slow
def test_stated_errors_and_amplitudes_have_their_coverage_in_many_draws() -> None:
    """1000 draws: three standard errors of a share of 0.95 are 0.021; amplitudes are fixed at their mode meanwhile."""
    check_coverage(1000, 0.025)


def test_a_process_that_is_absent_is_estimated_small_and_one_that_is_there_is_not() -> None:
    rng = np.random.default_rng(11)
    rows, _ = small(Sizes(rows=200, splines=(10, 10)), 12)
    no_terms = Terms(np.zeros((rows.y.size, 0)), np.zeros(0), np.zeros(0, dtype=bool))
    block = rows.blocks[0]
    history = rng.standard_normal(10)
    y = block.z[:, block.columns[0]] @ history + rng.standard_normal(rows.y.size)
    own = maximised(replace(rows, y=y), no_terms)
    present, absent = own.noise * np.exp(own.at[1:])
    assert present == pytest.approx(np.sqrt(np.mean(history**2)), rel=0.3)
    assert absent < 0.15 * present
    assert own.noise == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("seed", range(5))
def test_a_matrix_whose_smallest_eigenvalues_are_lost_in_rounding_has_a_factor(seed: int) -> None:
    rows = np.random.default_rng(seed).standard_normal((40, 3))
    matrix = 1e18 * rows @ rows.T + np.eye(40)
    matrix -= 1e3 * np.eye(40)  # as rounding may leave it
    factor = lower_factor(matrix, float(matrix.max()))
    np.testing.assert_allclose(factor @ factor.T, matrix, rtol=0.0, atol=1e-12 * matrix.max())
