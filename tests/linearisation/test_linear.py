"""Least squares where columns depend on each other."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.arrays import FloatArray
from brv_hypo.linearisation.linear import orthonormal
from tests.harness.last_digit import last_digit_off

ROWS, LONG = 400, 12


def dependent(short: float, seed: int) -> FloatArray:
    """Long columns, three that leave these by `short`, two that are sums of others, all of very different lengths."""
    draws = np.random.default_rng(seed)
    long = draws.standard_normal((ROWS, LONG))
    near = long[:, :3] + short * draws.standard_normal((ROWS, 3))
    design = np.column_stack([long, near, long[:, 3:5] + long[:, 5:7]])
    return design * 10.0 ** draws.uniform(0.0, 8.0, design.shape[1])


@pytest.mark.parametrize("short", [1e-3, 1e-6, 1e-8])
@pytest.mark.parametrize("seed", [1, 2])
def test_the_last_digit_of_a_design_moves_what_it_takes_by_what_its_short_directions_amplify(short: float, seed: int):
    """Directions of products alone take away what those of 1e-6 and shorter explain, and with the last digit more."""
    design = dependent(short, seed)
    rows = np.random.default_rng(seed).standard_normal(ROWS)
    ones, others = (orthonormal(each)[0] for each in (design, last_digit_off(design, seed)))
    assert ones.shape == others.shape == (ROWS, LONG + 3)
    assert np.linalg.norm(ones @ (ones.T @ rows) - others @ (others.T @ rows)) < 1e-13 / short


@pytest.mark.parametrize("short", [1e-3, 1e-8])
def test_what_is_orthonormal_is_made_of_the_columns(short: float):
    design = dependent(short, 3)
    basis, made = orthonormal(design)
    np.testing.assert_allclose(basis.T @ basis, np.eye(LONG + 3), atol=1e-13)
    np.testing.assert_allclose(design @ made, basis, atol=1e-15 / short)
