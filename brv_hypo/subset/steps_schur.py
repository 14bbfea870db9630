"""Steps of the compiled search on Schur complements, for well-conditioned columns.

The column to branch on is moved to the last place: including it is then a rank-one step on S into the next
level, dropping it one on H in place. Both are stored in full: rows are what ``packing`` and ``triples`` read. A
level copies H from its parent when it first branches.
"""

from __future__ import annotations

from typing import Any

from brv_hypo.subset.kernel_parts import Work, compiled_part, padded, score


@compiled_part
def rises(w: Work, level: int, m: int, out: Any) -> None:
    """Rise of the bound on dropping each undecided column: beta^2 / H_jj."""
    H = w.B[level] if w.owns[level] else w.B[level - 1]
    beta = w.beta[level]
    for i in range(m):
        out[i] = beta[i] * beta[i] / H[i, i]
    out[m : padded(m)] = 0.0


@compiled_part
def place(w: Work, level: int, j: int, m: int) -> int:
    """Move the column to branch on to the last place."""
    S, H, c, beta, ids = w.A[level], w.B[level], w.x[level], w.beta[level], w.ids[level]
    if not w.owns[level]:
        source = w.B[level - 1]
        for i in range(m):
            for k in range(padded(m)):
                H[i, k] = source[i, k]
        w.owns[level] = True
    last = m - 1
    if j != last:
        _swap(S, j, last)
        _swap(H, j, last)
        c[j], c[last] = c[last], c[j]
        beta[j], beta[last] = beta[last], beta[j]
        ids[j], ids[last] = ids[last], ids[j]
    return last


@compiled_part
def drop(w: Work, level: int, last: int) -> None:
    """Drop the last column: a rank-one step on H, S as it stands."""
    H, beta = w.B[level], w.beta[level]
    w.bound[level] += beta[last] * beta[last] / H[last, last]
    _downdate(H, beta, H, beta, last)


@compiled_part
def include(w: Work, level: int, last: int) -> None:
    """Include the last column: a rank-one step on S into the next level, H as it stands."""
    S, c = w.A[level], w.x[level]
    _downdate(S, c, w.A[level + 1], w.x[level + 1], last)
    w.rss[level + 1] = w.rss[level] - c[last] * c[last] / S[last, last]
    for i in range(last):
        w.beta[level + 1, i] = w.beta[level, i]
        w.ids[level + 1, i] = w.ids[level, i]


@compiled_part
def score_leaf(w: Work, level: int, m: int, pairs: bool, limits: Any) -> None:
    """Score the singles, and the pairs, of a node."""
    S = w.A[level]
    d = w.scratch[1]
    for i in range(m):
        d[i] = S[i, i]
    score(w, S, d, w.x[level], w.ids[level], m, w.base + level, pairs, w.rss[level], limits)


@compiled_part
def _swap(M: Any, j: int, last: int) -> None:
    """Exchange rows and columns j and last of a symmetric matrix."""
    for k in range(last + 1):
        M[j, k], M[last, k] = M[last, k], M[j, k]
    for k in range(last + 1):
        M[k, j], M[k, last] = M[k, last], M[k, j]


@compiled_part
def _downdate(M: Any, v: Any, out: Any, out_v: Any, last: int) -> None:
    """Schur complement on the last row: out = M - q q' / q_last, out_v = v - q v_last / q_last."""
    scale = 1.0 / M[last, last]
    shift = v[last] * scale
    width = padded(last + 1)
    for i in range(last):
        factor = M[last, i] * scale
        for k in range(width):
            out[i, k] = M[i, k] - factor * M[last, k]
    for i in range(last):
        out_v[i] = v[i] - M[last, i] * shift
