"""Least squares on whitened rows, with columns scaled to unit length first."""

from __future__ import annotations

import numpy as np

from brv_hypo.arrays import FloatArray


def solve_scaled(design: FloatArray, response: FloatArray, cutoff: float = 1e-12) -> FloatArray:
    """Coefficients (columns,); singular values below `cutoff` of the largest drop out."""
    scale = lengths(design)
    return np.asarray(np.linalg.lstsq(design / scale, response, rcond=cutoff)[0] / scale, dtype=float)


def covariance_of(design: FloatArray, residual: FloatArray, samples: int, efficiency: float) -> FloatArray:
    """Covariance (columns, columns) of the coefficients at the effective sample size."""
    scale = lengths(design)
    variance = float(residual @ residual) / max(samples - design.shape[1], 1) / efficiency
    _, singular, right = np.linalg.svd(design / scale, full_matrices=False)
    kept = singular > 1e-10 * singular[0]
    inverse = np.where(kept, 1.0 / np.where(kept, singular, 1.0), 0.0)
    return np.asarray(variance * (right.T * inverse**2) @ right / np.outer(scale, scale), dtype=float)


def lengths(design: FloatArray) -> FloatArray:
    """Length of each column, 1 for a column of zeros."""
    scale = np.linalg.norm(design, axis=0)
    return np.where(scale > 0.0, scale, 1.0)
