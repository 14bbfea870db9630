"""The compiled depth-first search: one driver, two sets of steps.

Schur steps, for well-conditioned columns: the column to branch on is moved to the last place; including it is a
rank-one step on S into the next level, dropping it one on H in place. Both are stored in full, as `bounds` reads
rows; a level copies H from its parent when it first branches.

Givens steps, for ill-conditioned columns, are orthogonal throughout: including a column rotates it to the front of R
and strikes its row; dropping one strikes the column and rotates R back to a triangle, which adds the last entry of z
to the bound. `search` is the entrance.
"""

from __future__ import annotations

from typing import Any

from brv_hypo.subset.bounds import packed_quota, score_fours, score_triples
from brv_hypo.subset.kernel_parts import (
    BRANCHED,
    DROPPED,
    FORCED,
    HITS,
    INCLUDED,
    LEVEL,
    NEW,
    NODES,
    NONE,
    Work,
    compiled,
    compiled_part,
    implied,
    leave,
    mark_dropped,
    padded,
    quota_of,
    record,
    score,
)

# ---- Steps of the compiled search on Schur complements, for well-conditioned columns ----


@compiled_part
def schur_rises(w: Work, level: int, m: int, out: Any) -> None:
    """Rise of the bound on dropping each undecided column: beta^2 / H_jj."""
    H = w.B[level] if w.owns[level] else w.B[level - 1]
    beta = w.beta[level]
    for i in range(m):
        out[i] = beta[i] * beta[i] / H[i, i]
    out[m : padded(m)] = 0.0


@compiled_part
def schur_place(w: Work, level: int, j: int, m: int) -> int:
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
def schur_drop(w: Work, level: int, last: int) -> None:
    """Drop the last column: a rank-one step on H, S as it stands."""
    H, beta = w.B[level], w.beta[level]
    w.bound[level] += beta[last] * beta[last] / H[last, last]
    _downdate(H, beta, H, beta, last)


@compiled_part
def schur_include(w: Work, level: int, last: int) -> None:
    """Include the last column: a rank-one step on S into the next level, H as it stands."""
    S, c = w.A[level], w.x[level]
    _downdate(S, c, w.A[level + 1], w.x[level + 1], last)
    w.rss[level + 1] = w.rss[level] - c[last] * c[last] / S[last, last]
    for i in range(last):
        w.beta[level + 1, i] = w.beta[level, i]
        w.ids[level + 1, i] = w.ids[level, i]


@compiled_part
def schur_score_leaf(w: Work, level: int, m: int, pairs: bool, limits: Any) -> None:
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


# ---- Steps of the compiled search on triangular factors, for ill-conditioned columns ----


@compiled_part
def givens_rises(w: Work, level: int, m: int, out: Any) -> None:
    """Rise of the bound on dropping each undecided column, from the rows of R^-1."""
    R, z, V = w.A[level], w.x[level], w.B[0]
    for i in range(m - 1, -1, -1):
        row = V[i]
        for k in range(i, m):
            row[k] = 0.0
        for k in range(i + 1, m):
            factor, below = R[i, k], V[k]
            for j in range(k, m):
                row[j] -= factor * below[j]
        scale = 1.0 / R[i, i]
        row[i] = scale
        beta, norm = scale * z[i], scale * scale
        for k in range(i + 1, m):
            row[k] *= scale
            beta += row[k] * z[k]
            norm += row[k] * row[k]
        out[i] = beta * beta / norm


@compiled_part
def givens_drop(w: Work, level: int, j: int) -> None:
    """Strike column j and restore the triangle by rotations of neighbouring rows."""
    R, z, ids, carry = w.A[level], w.x[level], w.ids[level], w.scratch[4]
    m = w.count[level]
    for k in range(j + 1, m):
        carry[k] = R[j, k]
        ids[k - 1] = ids[k]
    for i in range(j):
        for k in range(j + 1, m):
            R[i, k - 1] = R[i, k]
    carry_z = z[j]
    for i in range(j, m - 1):
        a, b = carry[i + 1], R[i + 1, i + 1]
        r = (a * a + b * b) ** 0.5
        cos, sin = a / r, b / r
        for k in range(i + 1, m):
            upper, lower = carry[k], R[i + 1, k]
            R[i, k - 1] = cos * upper + sin * lower
            carry[k] = cos * lower - sin * upper
        upper_z, lower_z = carry_z, z[i + 1]
        z[i] = cos * upper_z + sin * lower_z
        carry_z = cos * lower_z - sin * upper_z
    w.bound[level] += carry_z * carry_z


@compiled_part
def givens_include(w: Work, level: int, j: int) -> None:
    """Rotate column j to the front; what lies below its row is the next level."""
    R, z, ids, carry = w.A[level], w.x[level], w.ids[level], w.scratch[4]
    T, t, child = w.A[level + 1], w.x[level + 1], w.ids[level + 1]
    m = w.count[level]
    for k in range(m):
        carry[k] = R[j, k] if k > j else 0.0
        if k != j:
            child[k - (k > j)] = ids[k]
    for i in range(j + 1, m):
        t[i - 1] = z[i]
        for k in range(i, m):
            T[i - 1, k - 1] = R[i, k]
    a, carry_z = R[j, j], z[j]
    for i in range(j - 1, -1, -1):
        b = R[i, j]
        r = (a * a + b * b) ** 0.5
        cos, sin = b / r, a / r
        for k in range(i, m):
            if k != j:
                upper, lower = R[i, k], carry[k]
                T[i, k - (k > j)] = cos * lower - sin * upper
                carry[k] = cos * upper + sin * lower
        t[i] = cos * carry_z - sin * z[i]
        carry_z = cos * z[i] + sin * carry_z
        a = r
    w.rss[level + 1] = w.rss[level] - carry_z * carry_z


@compiled_part
def givens_score_leaf(w: Work, level: int, m: int, pairs: bool, limits: Any) -> None:
    """Score the singles, and the pairs, of a node: S = R'R is formed here only."""
    R, z, S = w.A[level], w.x[level], w.B[1]
    d, c = w.scratch[1], w.scratch[2]
    for i in range(m):
        c[i] = 0.0
        for k in range(i + 1):
            S[i, k] = 0.0
    for row in range(m):
        for i in range(row, m):
            factor = R[row, i]
            c[i] += factor * z[row]
            for k in range(row, i + 1):
                S[i, k] += factor * R[row, k]
    for i in range(m):
        d[i] = S[i, i]
    score(w, S, d, c, w.ids[level], m, w.base + level, pairs, w.rss[level], limits)


# ---- The compiled depth-first search: one driver, two sets of steps ----


# Nodes visited after a hit before the kernel hands it over.
PATIENCE = 32


@compiled
def search(w: Work, limits: Any, loosest: Any, budget: int, orthogonal: Any) -> None:
    """Go on until the tree or the budget is done, hits have waited long enough, or their room is short.

    ``limits[k]``: a subset of size k is of interest below it; ``loosest[k]``: the largest limit from size k
    on. The level in ``w.state`` is -1 when the tree is done. ``orthogonal`` None takes Schur steps,
    anything else orthogonal ones: numba strikes out the branch not taken when it compiles.
    """
    constrained = w.requires.size > 0
    rise = w.scratch[0]
    stop = w.state[NODES] + budget
    while w.state[LEVEL] >= 0 and w.state[NODES] < stop:
        level = w.state[LEVEL]
        size = w.base + level
        m = w.count[level]
        if w.state[HITS] > 0:
            stop = min(stop, w.state[NODES] + PATIENCE)
            if w.state[HITS] + m * m > w.hits.shape[0]:
                return
        if w.phase[level] == FORCED:
            leave(w, level)
            continue
        if w.phase[level] == BRANCHED:
            if constrained:
                mark_dropped(w, w.ids[level, w.at[level]], level)
            if orthogonal is None:
                schur_drop(w, level, w.at[level])
            else:
                givens_drop(w, level, w.at[level])
            m = w.count[level] = m - 1
            w.phase[level] = NEW
            if w.bound[level] > loosest[size + 1]:
                leave(w, level)
                continue
        w.state[NODES] += 1
        if orthogonal is None:
            schur_rises(w, level, m, rise)
        else:
            givens_rises(w, level, m, rise)
        quota = quota_of(rise, m, w.bound[level], limits, size, w.most[level])
        if orthogonal is None:
            quota = packed_quota(w, level, m, rise, quota, limits)
            w.most[level] = size + quota
            if (quota == 3 or (quota == 4 and score_fours(w, level, m, limits))) and score_triples(
                w, level, m, rise, limits
            ):
                leave(w, level)
                continue
        if quota <= 2:
            if quota > 0:
                if orthogonal is None:
                    schur_score_leaf(w, level, m, quota == 2, limits)
                else:
                    givens_score_leaf(w, level, m, quota == 2, limits)
            leave(w, level)
            continue
        j = 0
        for i in range(1, m):
            if rise[i] > rise[j]:
                j = i
        w.phase[level] = BRANCHED
        verdict = 0
        if constrained:
            forced, verdict = implied(w, w.ids[level], m)
            if verdict == INCLUDED:
                w.phase[level] = FORCED
            j = forced if verdict else j
        if orthogonal is None:
            j = schur_place(w, level, j, m)
        w.at[level] = j
        if verdict == DROPPED:
            continue
        if orthogonal is None:
            schur_include(w, level, j)
        else:
            givens_include(w, level, j)
        w.bound[level + 1] = w.bound[level]
        w.count[level + 1] = m - 1
        w.phase[level + 1] = NEW
        w.owns[level + 1] = False
        w.most[level + 1] = w.most[level]
        w.chosen[size] = w.ids[level, j]
        if constrained:
            w.status[w.ids[level, j]] = INCLUDED
        if w.rss[level + 1] <= limits[size + 1]:
            record(w, size + 1, NONE, NONE)
        w.state[LEVEL] = level + 1
