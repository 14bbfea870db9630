"""Upper triangles of tall matrices by QR, a slab at a time."""

from __future__ import annotations

import numpy as np

from brv_hypo.arrays import FloatArray

_SLAB = 8
"""Rows of a slab over its columns: small slabs stay in cache, and below what a threaded BLAS would split."""


def upper_triangle(rows: FloatArray) -> FloatArray:
    """R of a tall matrix, (columns, columns): QR of slabs, then of their triangles (TSQR)."""
    columns = rows.shape[1]
    slab = _SLAB * columns
    while rows.shape[0] > slab:
        spare = -rows.shape[0] % slab
        padded = np.concatenate([rows, np.zeros((spare, columns))]) if spare else rows
        rows = np.asarray(np.linalg.qr(padded.reshape(-1, slab, columns), mode="r")).reshape(-1, columns)
    padded = np.concatenate([rows, np.zeros((columns, columns))])
    return np.asarray(np.linalg.qr(padded, mode="r"))


def residual_last(columns: FloatArray) -> FloatArray:
    """(n, m, 1 + p) with the constant part first, as rows (n m, p + 1) with it last."""
    rows = columns.reshape(-1, columns.shape[2])
    return np.concatenate([rows[:, 1:], rows[:, :1]], axis=1)
