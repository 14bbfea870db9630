"""Steps of the compiled search on triangular factors, for ill-conditioned columns.

Orthogonal throughout: including a column rotates it to the front of R and strikes its row; dropping one
strikes the column and rotates R back to a triangle, which hands the last entry of z to the bound.
"""

from __future__ import annotations

from typing import Any

from brv_hypo.subset.kernel_parts import Work, compiled_part, score


@compiled_part
def rises(w: Work, level: int, m: int, out: Any) -> None:
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
def drop(w: Work, level: int, j: int) -> None:
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
def include(w: Work, level: int, j: int) -> None:
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
def score_leaf(w: Work, level: int, m: int, pairs: bool, limits: Any) -> None:
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
