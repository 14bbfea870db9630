"""Least squares on whitened rows, with columns scaled to unit length first."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_triangular

from brv_hypo.arrays import FloatArray

# Share of a column's square below which what a projection leaves is rounding; also of unit columns' directions.
_SPENT = 1e-12
_ROUNDING = 1e-14  # some 45 units of double precision's rounding
_SHORT = 1e-5  # of the longest direction, of which products keep half their digits
_CUTOFF = 1e-12  # of the longest direction: below is rounding


def solve_scaled(design: FloatArray, response: FloatArray) -> FloatArray:
    """Coefficients (columns,); singular values that are rounding of the largest drop out."""
    scale = lengths(design)
    return np.asarray(np.linalg.lstsq(design / scale, response, rcond=_CUTOFF)[0] / scale, dtype=float)


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
    triangle = np.linalg.qr(design / scale, mode="r")  # has the same singular values, and is small
    inverse = np.linalg.pinv(triangle, rcond=1e-10) / scale[:, np.newaxis]
    return np.asarray(variance * inverse @ inverse.T, dtype=float)


def orthonormal(design: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Orthonormal columns (rows, rank) that span those of `design`, and what makes them of these (columns, rank). Long
    directions of unit columns from products of the columns, and once more from those of what is found, which leaves
    rounding alone (Yamamoto et al., ETNA 44:306, 2015: Cholesky QR twice). Short ones, few, from what the long ones
    leave of them: products hold no digit of a direction 1e-8 of the longest. Directions of rounding drop out.
    """
    if not design.shape[1]:
        return design, np.zeros((0, 0))
    scale = lengths(design)
    size, directions = np.linalg.eigh(design.T @ design / np.outer(scale, scale))
    directions /= scale[:, np.newaxis]
    long = size > _SHORT**2 * size[-1]
    first = directions[:, long] / np.sqrt(size[long])
    nearly = design @ first
    triangle = np.linalg.cholesky(nearly.T @ nearly).T
    inverse = solve_triangular(triangle, np.eye(triangle.shape[0]))
    basis, made = nearly @ inverse, first @ inverse
    rest, of_rest = design @ directions[:, ~long], directions[:, ~long]
    for _ in range(2):
        inside = basis.T @ rest
        rest, of_rest = rest - basis @ inside, of_rest - made @ inside
    others, length, turned = np.linalg.svd(rest, full_matrices=False)
    kept = length > _CUTOFF * np.sqrt(size[-1])
    made_of_rest = of_rest @ (turned[kept].T / length[kept])
    return np.column_stack([basis, others[:, kept]]), np.column_stack([made, made_of_rest])


def lengths(design: FloatArray) -> FloatArray:
    """Length of each column, 1 for a column of zeros."""
    scale = np.linalg.norm(design, axis=0)
    return np.where(scale > 0.0, scale, 1.0)
