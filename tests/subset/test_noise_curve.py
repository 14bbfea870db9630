"""Collinear knots at every level of noise: exact against brute force; the benchmark's curve in small."""

from __future__ import annotations

import numpy as np
import pytest

from tests.studies.subset.benchmark import CURVES, curve_point
from tests.studies.subset.problems import delay_problem, spline_problem, with_r_squared
from tests.subset.brute_force import enumerate_subsets
from tests.subset.kernels import best_subsets_by


@pytest.mark.parametrize("kernel", ["numba-schur", pytest.param("numpy", marks=pytest.mark.thorough)])
@pytest.mark.parametrize("share", [0.3, *(pytest.param(s, marks=pytest.mark.thorough) for s in (0.9, 0.9999))])
@pytest.mark.parametrize("kind", ["spline", pytest.param("delay", marks=pytest.mark.thorough)])
def test_collinear_columns_are_searched_exactly_at_every_noise(kind: str, share: float, kernel: str) -> None:
    clean = spline_problem(5, noise=0.0) if kind == "spline" else delay_problem(6, 3, noise=0.0)
    X, y = with_r_squared(clean, share)
    result = best_subsets_by(kernel, X, y, 4)
    expected = enumerate_subsets(X, y, (0,), range(1, X.shape[1]), 4)
    assert result.certificate.exact
    for size in range(1, 5):
        best, columns = expected[size][0]
        assert result.best(size).rss == pytest.approx(best, rel=1e-9)
        assert result.best(size).columns == columns


@pytest.mark.parametrize("seed", [0, *(pytest.param(s, marks=pytest.mark.thorough) for s in range(1, 8))])
def test_both_kernels_find_the_same_of_running_sums(seed: int) -> None:
    rng = np.random.default_rng(seed)
    X = np.column_stack([np.ones(90), np.cumsum(rng.standard_normal((90, 22)), axis=0)])
    y = X[:, [3, 9, 15]].sum(axis=1) + rng.choice([1.0, 5.0, 20.0]) * rng.standard_normal(90)
    plain, compiled = (best_subsets_by(kernel, X, y, 7, n_best=4) for kernel in ("numpy", "numba-schur"))
    assert compiled.certificate.exact
    assert [s.columns for s in compiled.subsets] == [s.columns for s in plain.subsets]


@pytest.mark.parametrize("share", [0.3, 0.99])
def test_the_true_model_explains_the_requested_share(share: float) -> None:
    X, signal = delay_problem(noise=0.0)
    _, y = with_r_squared((X, signal), share)
    assert 1.0 - np.var(y - signal) / np.var(y) == pytest.approx(share, abs=0.1 * (1.0 - share))


def test_a_point_of_the_curve_has_its_certificate() -> None:
    easy = curve_point(CURVES[0], 0.9999, limit_s=60.0)
    assert easy.certificate.exact
    hard = curve_point(CURVES[1], 0.3, limit_s=0.05)
    assert not hard.certificate.exact
    assert 0.0 < hard.certificate.gap < 1.0
