"""Time limits, threads, start-up cost and refusals."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from brv_hypo.errors import UsageError
from brv_hypo.subset import at_most_one, best_subsets
from tests.studies.subset.problems import correlated_problem, spline_problem
from tests.studies.subset.stepwise import stepwise_columns
from tests.subset.kernels import best_subsets_by


@pytest.fixture(scope="module")
def splines() -> tuple[np.ndarray, np.ndarray]:
    return spline_problem()


@pytest.mark.parametrize("kernel", ["numba-schur", pytest.param("numpy", marks=pytest.mark.thorough)])
def test_time_limit_returns_the_best_so_far_and_a_true_gap(splines: tuple[np.ndarray, np.ndarray], kernel: str) -> None:
    best_subsets_by(kernel, *splines, 2)
    cut = best_subsets_by(kernel, *splines, 12, time_limit_s=0.02)
    exact = best_subsets_by("numba-schur", *splines, 12)
    assert not cut.certificate.exact
    assert "time limit" in cut.certificate.status
    assert cut.certificate.gap == max(cut.certificate.gaps)
    assert 0.0 < cut.certificate.gap < 1.0
    for found, best, gap in zip(cut.subsets, exact.subsets, cut.certificate.gaps, strict=True):
        assert found.rss * (1.0 - gap) <= best.rss * (1.0 + 1e-9)


@pytest.mark.thorough
def test_threads_change_nothing_but_the_time(splines: tuple[np.ndarray, np.ndarray]) -> None:
    one = best_subsets_by("numba-schur", *splines, 11, n_best=2)
    two = best_subsets_by("numba-schur", *splines, 11, n_best=2, threads=2)
    assert two.certificate.exact
    assert [s.columns for s in one.subsets] == [s.columns for s in two.subsets]


def test_kernels_agree_on_the_spline_problem(splines: tuple[np.ndarray, np.ndarray]) -> None:
    answers = {kernel: best_subsets_by(kernel, *splines, 6, n_best=2) for kernel in ("auto", "numpy", "numba-schur")}
    reference = [s.columns for s in answers["auto"].subsets]
    assert all([s.columns for s in r.subsets] == reference for r in answers.values())


def test_all_sizes_of_forty_correlated_columns() -> None:
    X, y = correlated_problem()
    result = best_subsets(X, y, 39)
    assert result.certificate.exact
    assert [s.size for s in result.subsets] == list(range(1, 40))
    assert np.all(np.diff([s.rss for s in result.subsets]) < 0.0)


def test_importing_and_a_small_search_need_neither_numba_nor_scipy_stats() -> None:
    code = (
        "import sys, numpy as np\n"
        "from brv_hypo.subset import best_subsets\n"
        "rng = np.random.default_rng(0)\n"
        "X = np.column_stack([np.ones(200), rng.standard_normal((200, 13))])\n"
        "assert best_subsets(X, X[:, 3] + rng.standard_normal(200), 13).certificate.exact\n"
        "print([m for m in ('numba', 'scipy.stats') if m in sys.modules])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_stepwise_moves_groups_together() -> None:
    rng = np.random.default_rng(2)
    X = np.column_stack([np.ones(80), rng.standard_normal((80, 6))])
    y = X[:, 3] + X[:, 5] + 0.2 * rng.standard_normal(80)
    found = {len(columns): set(columns) for _, columns in stepwise_columns(X, y, 3, groups=[(3, 4)], samples=80)}
    assert found[3] == {3, 4, 5}


def test_forced_columns_count_as_parents_and_fill_a_group() -> None:
    rng = np.random.default_rng(4)
    X = np.column_stack([np.ones(50), rng.standard_normal((50, 4))])
    y = X[:, 2] + X[:, 3] + 0.1 * rng.standard_normal(50)
    result = best_subsets(X, y, 3, forced=(0, 1), groups=[at_most_one(1, 2)], parents={3: 1})
    assert result.best(1).columns == (3,)
    assert all(2 not in s.columns for s in result.subsets)


def test_aliases_are_named_with_their_combination() -> None:
    rng = np.random.default_rng(6)
    a = rng.standard_normal(30)
    X = np.column_stack([np.ones(30), a, 3.0 * a, np.full(30, 2.0), rng.standard_normal(30)])
    aliases = {a.column: dict(a.combination) for a in best_subsets(X, a + X[:, 4], 2).aliases}
    assert set(aliases) == {2, 3}
    assert aliases[2] == pytest.approx({1: 3.0})
    assert aliases[3] == pytest.approx({0: 2.0})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"X": np.ones((5, 2, 1))}, "shape"),
        ({"X": np.ones((4, 2))}, "shape"),
        ({"y": np.array([1.0, np.nan, 0.0, 0.0, 0.0])}, "not finite"),
        ({"forced": (9,)}, "forced names columns"),
        ({"max_terms": -1}, "max_terms"),
        ({"threads": 0}, "threads"),
        ({"weights": -np.ones(5)}, "weights"),
        ({"parents": {1: 17}}, "17"),
    ],
)
def test_refusals_say_what_is_wrong(arguments: dict[str, object], message: str) -> None:
    given = {"X": np.eye(5, 2), "y": np.arange(5.0), **arguments}
    with pytest.raises(UsageError, match=message):
        best_subsets(**given)


@pytest.mark.parametrize("scale", [1e-120, 1e120])
@pytest.mark.parametrize("columns", [slice(None), [2], [5, 6]])
def test_the_scale_of_columns_changes_coefficients_alone(scale: float, columns: slice | list[int]) -> None:
    random = np.random.default_rng(3)
    X = random.normal(size=(50, 7))
    X[:, 6] = 3.0 * X[:, 2]
    y = 2.0 * X[:, 2] - X[:, 5] + 0.1 * random.normal(size=50)
    scaled, factors = X.copy(), np.ones(7)
    scaled[:, columns] *= scale
    factors[columns] = scale
    for one, other in zip(best_subsets(X, y, 4).subsets, (found := best_subsets(scaled, y, 4)).subsets, strict=True):
        assert one.columns == other.columns
        np.testing.assert_allclose(other.coefficients * factors[list(other.terms)], one.coefficients, rtol=1e-9)
        np.testing.assert_allclose(other.std_errors * factors[list(other.terms)], one.std_errors, rtol=1e-9)
    (alias,) = found.aliases
    assert alias.column == 6
    assert dict(alias.combination) == pytest.approx({2: 3.0 / factors[2] * factors[6]}, rel=1e-9)


@pytest.mark.parametrize("scale", [1e-300, 1e300])
def test_numbers_whose_squares_are_none_are_refused(scale: float) -> None:
    X, y = np.eye(9)[:, :4], np.arange(9.0)
    with pytest.raises(UsageError, match=r"y reaches .* another unit"):
        best_subsets(X, scale * y, 2)
    with pytest.raises(UsageError, match=r"column 3 of X reaches .* another unit"):
        best_subsets(X * [1.0, 1.0, 1.0, scale], y, 2)
