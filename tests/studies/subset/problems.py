"""Seeded subset-regression problems of the kinds that entry-vehicle analysis poses.

Each generator returns ``(X, y)`` with the constant in column 0; tests and the benchmark share them.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brv_hypo.arrays import FloatArray

# Knots of Table 5.5, seconds from launch.
TABLE_5_5_KNOTS = (
    318.875, 320.5, 320.8, 320.9, 321.0, 321.1, 321.2, 321.3, 321.4, 321.5, 321.75, 322.0, 322.25, 322.5,
    322.75,
)  # fmt: skip
STOP_S = 323.0
SAMPLE_S = 0.005

Times = NDArray[np.floating[Any]]


def spline_problem(knots: int = 15, seed: int = 1, noise: float = 2e-5) -> tuple[FloatArray, FloatArray]:
    """Jumps and ramps in C_m0 and C_malpha at each knot: 4 columns a knot, 826 samples (Section 5.3.1).

    The jump in C_m0 at the first knot is the constant. The first 15 knots are those of Table 5.5; more are
    spread evenly between them. The response has the nine-term model of Table 5.5 and coloured noise.
    """
    rng = np.random.default_rng(seed)
    t = TABLE_5_5_KNOTS[0] + SAMPLE_S * np.arange(826)
    alpha = _angle_of_attack(t)
    extra = np.linspace(319.2, 320.35, max(knots - len(TABLE_5_5_KNOTS), 0))
    times = np.sort(np.concatenate([TABLE_5_5_KNOTS[:knots], extra]))
    columns = [np.ones_like(t), alpha, t - t[0], alpha * (t - t[0])]
    for knot in times[1:]:
        jump = (t >= knot).astype(float)
        ramp = np.maximum(t - knot, 0.0)
        columns += [jump, alpha * jump, ramp, alpha * ramp]
    X = np.column_stack(columns)
    y = (
        -0.0000987 - 0.0883 * alpha + 0.0131 * alpha * (t - t[0])
        + 0.000269 * (t >= 320.8) - 0.000096 * (t >= 321.0) - 0.000103 * (t >= 321.5)
        + 0.000193 * (t >= 321.75)
    )  # fmt: skip
    return X, y + _coloured_noise(rng, t.size, noise)


def delay_problem(
    delays: int = 12, regions: int = 5, seed: int = 2, noise: float = 0.3
) -> tuple[FloatArray, FloatArray]:
    """Sticking terms C_mw(t - tau_i) sin(phi_w(t) - phi_w(t - tau_i)) by region (Equations 5.1 and 5.2).

    Columns: the constant, the present in-plane moment, then delays x regions; 826 samples. ``noise`` is that of
    the response against its signal.
    """
    rng = np.random.default_rng(seed)
    t = TABLE_5_5_KNOTS[0] + SAMPLE_S * np.arange(826)
    edges = np.linspace(t[0], STOP_S, regions + 1)
    columns = [np.ones_like(t), _in_plane_moment(t)]
    for tau in 0.05 * np.arange(1, delays + 1):
        delayed = _in_plane_moment(t - tau) * np.sin(_windward_meridian(t) - _windward_meridian(t - tau))
        columns += [delayed * ((t >= a) & (t < b)) for a, b in pairwise(edges)]
    X = np.column_stack(columns)
    planted = rng.choice(np.arange(2, X.shape[1]), size=8, replace=False)
    signal = X[:, planted] @ rng.normal(1.0, 0.3, size=8)
    return X, signal + _coloured_noise(rng, t.size, noise * float(signal.std()))


def with_r_squared(
    problem: tuple[FloatArray, FloatArray], share: float, seed: int = 5
) -> tuple[FloatArray, FloatArray]:
    """A problem without noise given white noise, so that the true model explains this share of the variance."""
    X, signal = problem
    rng = np.random.default_rng(seed)
    sigma = float(signal.std()) * float(np.sqrt(1.0 / share - 1.0))
    return X, signal + sigma * rng.standard_normal(signal.size)


def polynomial_problem(seed: int = 3) -> tuple[FloatArray, FloatArray]:
    """The 28 terms of Table 4.1 in raw alpha, Reynolds and Mach ratios: condition about 1e10, 600 samples.

    The response is the model printed in the table's second column, about the means of its footnote, with
    noise at 1e-4 of its spread.
    """
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 3.0, 600)
    s = t - 1.5
    d_alpha = 0.0132 * np.sin(11.0 * t + 0.6 * t**2) * np.exp(-0.2 * t) + 0.0044 * np.cos(23.0 * t)
    d_reynolds = 0.156 * s + 0.026 * s**2
    d_mach = -0.03 * s - 0.006 * s**3 + 0.002 * np.sin(5.0 * t)
    alpha, reynolds, mach = 0.0143 + d_alpha, 1.939 / 3.71 + d_reynolds, 0.983 + d_mach
    X = np.column_stack([alpha**a * reynolds**r * mach**m for a, r, m in _TABLE_4_1_POWERS])
    y = (
        -0.00101 - 0.0695 * d_alpha + 0.000225 * d_reynolds - 0.0000108 * d_reynolds**2
        + 0.0125 * d_alpha * d_reynolds - 0.00685 * d_alpha * d_reynolds**2
        - 0.0976 * d_reynolds**2 * d_mach**2
    )  # fmt: skip
    return X, y + 1e-6 * rng.standard_normal(t.size)


def correlated_problem(
    columns: int = 40, correlation: float = 0.9, rows: int = 500, seed: int = 4
) -> tuple[FloatArray, FloatArray]:
    """Equicorrelated Gaussian columns behind a constant; a third of the candidates are active."""
    rng = np.random.default_rng(seed)
    common = rng.standard_normal((rows, 1))
    own = rng.standard_normal((rows, columns - 1))
    X = np.column_stack([np.ones(rows), np.sqrt(correlation) * common + np.sqrt(1.0 - correlation) * own])
    beta = np.zeros(columns)
    active = rng.choice(np.arange(1, columns), size=columns // 3, replace=False)
    beta[active] = rng.normal(0.0, 1.0, size=active.size)
    return X, X @ beta + rng.standard_normal(rows)


# Powers of alpha, Reynolds and Mach ratio in the order of Table 4.1.
_TABLE_4_1_POWERS = (
    (0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (2, 0, 0), (3, 0, 0), (4, 0, 0), (0, 2, 0), (0, 3, 0),
    (1, 0, 3), (1, 1, 0), (0, 0, 2), (0, 0, 3), (1, 0, 1), (0, 1, 1), (2, 1, 0), (2, 0, 1), (1, 0, 2),
    (0, 1, 2), (1, 2, 0), (0, 2, 1), (3, 1, 0), (3, 0, 1), (4, 1, 0), (2, 2, 0), (2, 0, 2), (0, 2, 2),
    (1, 1, 1),
)  # fmt: skip


def _angle_of_attack(t: Times) -> FloatArray:
    """Total angle of attack [rad] of a precessing body through transition."""
    s = t - TABLE_5_5_KNOTS[0]
    return np.asarray(0.0042 + 0.0021 * np.sin(2 * np.pi * (1.9 * s + 0.11 * s**2)) + 0.0007 * np.sin(31.0 * s))


def _windward_meridian(t: Times) -> FloatArray:
    """Windward meridian [rad], unwrapped."""
    s = t - TABLE_5_5_KNOTS[0]
    return np.asarray(9.0 * s + 0.9 * np.sin(2 * np.pi * 1.1 * s) + 0.35 * s**2)


def _in_plane_moment(t: Times) -> FloatArray:
    return np.asarray(-0.09 * _angle_of_attack(t))


def _coloured_noise(rng: np.random.Generator, size: int, sigma: float) -> FloatArray:
    """White noise smoothed over five samples, as differentiated gyros leave it."""
    white = rng.standard_normal(size + 4)
    return np.asarray(sigma * np.convolve(white, np.full(5, 5**-0.5), mode="valid"))
