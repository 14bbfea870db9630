"""Least squares on whitened rows, with columns scaled to unit length first."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_triangular

from brv_hypo.arrays import FloatArray

# Share of a column's square below which what a projection leaves of it is rounding; the same for directions of unit
# columns in normal equations.
_SPENT = 1e-12
_ROUNDING = 1e-14  # some 45 units of double precision's rounding
_SHORT = 3e-7  # of the longest direction: the root of what products of double precision tell from nothing


def solve_scaled(design: FloatArray, response: FloatArray, cutoff: float = 1e-12) -> FloatArray:
    """Coefficients (columns,); singular values below `cutoff` of the largest drop out."""
    scale = lengths(design)
    return np.asarray(np.linalg.lstsq(design / scale, response, rcond=cutoff)[0] / scale, dtype=float)


def solve_normal(products: FloatArray, right: FloatArray, squares: FloatArray) -> FloatArray:
    """Coefficients (..., columns) of normal equations, `products` (..., columns, columns), or a stack of them.

    `squares` (..., columns) are the squared lengths of the columns before anything was projected out of them: the
    rounding of the products is relative to these. Directions that are rounding drop out.
    """
    if right.shape[-1] == 0:
        return np.zeros(right.shape)
    diagonal = np.diagonal(products, axis1=-2, axis2=-1)
    alive = diagonal > _SPENT * squares
    scale = np.where(alive, 1.0 / np.sqrt(np.where(alive, diagonal, 1.0)), 0.0)
    rounding = np.max(np.where(alive, squares * scale**2, 1.0), axis=-1, keepdims=True)
    size, directions = np.linalg.eigh(products * scale[..., np.newaxis] * scale[..., np.newaxis, :])
    kept = size > _ROUNDING * rounding
    along = np.einsum("...ji,...j->...i", directions, right * scale)
    along = np.where(kept, along / np.where(kept, size, 1.0), 0.0)
    return np.asarray(np.einsum("...ij,...j->...i", directions, along) * scale, dtype=float)


def covariance_of(design: FloatArray, residual: FloatArray, samples: int, efficiency: float) -> FloatArray:
    """Covariance (columns, columns) of the coefficients at the effective sample size."""
    scale = lengths(design)
    variance = float(residual @ residual) / max(samples - design.shape[1], 1) / efficiency
    _, singular, right = np.linalg.svd(design / scale, full_matrices=False)
    kept = singular > 1e-10 * singular[0]
    inverse = np.where(kept, 1.0 / np.where(kept, singular, 1.0), 0.0)
    return np.asarray(variance * (right.T * inverse**2) @ right / np.outer(scale, scale), dtype=float)


def orthonormal(design: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Orthonormal columns (rows, rank) that span those of `design`, and what makes them of these (columns, rank).

    From products of the columns, and once more from those of what is found, which leaves rounding alone (Yamamoto et
    al., ETNA 44:306, 2015: Cholesky QR twice); directions of unit columns that are shorter than `_SHORT` drop out.
    """
    scale = lengths(design)
    size, directions = np.linalg.eigh(design.T @ design / np.outer(scale, scale))
    kept = size > _SHORT**2 * size[-1]
    first = directions[:, kept] / np.sqrt(size[kept]) / scale[:, np.newaxis]
    nearly = design @ first
    triangle = np.linalg.cholesky(nearly.T @ nearly).T
    inverse = solve_triangular(triangle, np.eye(triangle.shape[0]))
    return np.asarray(nearly @ inverse, dtype=float), first @ inverse


def lengths(design: FloatArray) -> FloatArray:
    """Length of each column, 1 for a column of zeros."""
    scale = np.linalg.norm(design, axis=0)
    return np.where(scale > 0.0, scale, 1.0)
