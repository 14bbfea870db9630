"""Steps of the compiled search on Schur complements, for well-conditioned columns.

The column to branch on is moved to the last place: including it is then a rank-one step on S into the next
level, dropping it one on H in place. Lower triangles only. A level copies H from its parent when it first
branches.
"""

from __future__ import annotations

from typing import Any

from brv_hypo.subset.kernel_parts import NONE, PAIRS, Work, compiled_part, record, score


@compiled_part
def rises(w: Work, level: int, m: int, out: Any) -> None:
    """Rise of the bound on dropping each undecided column: beta^2 / H_jj."""
    H = w.B[level] if w.owns[level] else w.B[level - 1]
    beta = w.beta[level]
    for i in range(m):
        out[i] = beta[i] * beta[i] / H[i, i]


@compiled_part
def place(w: Work, level: int, j: int, m: int) -> int:
    """Move the column to branch on to the last place."""
    S, H, c, beta, ids = w.A[level], w.B[level], w.x[level], w.beta[level], w.ids[level]
    if not w.owns[level]:
        source = w.B[level - 1]
        for i in range(m):
            row, target = source[i], H[i]
            for k in range(i + 1):
                target[k] = row[k]
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
    d, p = w.scratch[1], w.scratch[2]
    for i in range(m):
        d[i] = S[i, i]
        p[i] = 0.0
    score(w, S, p, d, w.x[level], w.ids[level], m, w.base + level, pairs, w.rss[level], limits)


@compiled_part
def score_child(w: Work, level: int, last: int, limits: Any) -> None:
    """Include the last column and score the singles and pairs beside it, without writing the child down."""
    S, c, ids = w.A[level], w.x[level], w.ids[level]
    d, p, e = w.scratch[1], w.scratch[2], w.scratch[3]
    size = w.base + level
    pivot = S[last]
    root = pivot[last] ** -0.5
    shift = c[last] * root
    for i in range(last):
        p[i] = pivot[i] * root
        d[i] = S[i, i] - p[i] * p[i]
        e[i] = c[i] - p[i] * shift
    rss = w.rss[level] - shift * shift
    w.chosen[size] = ids[last]
    if rss <= limits[size + 1]:
        record(w, size + 1, NONE, NONE)
    score(w, S, p, d, e, ids, last, size + 1, PAIRS, rss, limits)


@compiled_part
def _swap(M: Any, j: int, last: int) -> None:
    """Exchange rows and columns j and last of a symmetric matrix held in its lower triangle."""
    for k in range(j):
        M[j, k], M[last, k] = M[last, k], M[j, k]
    for k in range(j + 1, last):
        M[k, j], M[last, k] = M[last, k], M[k, j]
    M[j, j], M[last, last] = M[last, last], M[j, j]


@compiled_part
def _downdate(M: Any, v: Any, out: Any, out_v: Any, last: int) -> None:
    """Schur complement on the last row: out = M - q q' / q_last, out_v = v - q v_last / q_last."""
    pivot = M[last]
    scale = 1.0 / pivot[last]
    shift = v[last] * scale
    for i in range(last):
        factor = pivot[i] * scale
        row, target = M[i], out[i]
        for k in range(i + 1):
            target[k] = row[k] - factor * pivot[k]
        out_v[i] = v[i] - pivot[i] * shift
