"""A bound from disjoint sets of columns, for searches on Schur complements.

Dropping a set A of columns raises the residual by rho(A) = beta_A' (H_AA)^-1 beta_A. A subset with t further columns
misses at least one of t + 1 disjoint sets: where all of their rises break its limit, no such subset gets under it.
Single columns are the simplest sets (``quota_of``). Collinear columns stand in for each other, so that their own
rises are small, but not those of a few of them together.

Sets are grown greedily, a column at a time, by a pivoted factor of H that is written down for the set alone. Where t
sets are found and the columns left over do not make another, a subset of that size takes one column of each set: the
rest can be dropped, which leaves less to be allowed for, and sets are looked for again.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from brv_hypo.subset.kernel_parts import ZERO, Work, compiled_part, larger, padded, quota_of, smaller

# Squared length of a column that is not to be taken. Those of others are 1 at most in S and no more than the square of
# the condition number in H, 1e14 where these steps are taken: what rounding leaves of TAKEN is above HARDLY_TAKEN.
TAKEN = 1e300
HARDLY_TAKEN = 1e299
# Rows of ``Work.packing``: squared lengths and coefficients before a set is begun, and as it grows; rises.
H_FREE, B_FREE, H_LEFT, B_LEFT, RISE = np.arange(5)


@compiled_part
def packed_quota(w: Work, level: int, m: int, rise: Any, quota: int, limits: Any) -> int:
    """The quota, lowered as far as disjoint sets allow; ``w.scored`` and fewer are sooner scored than ruled out."""
    size, bound = w.base + level, w.bound[level]
    H = w.B[level] if w.owns[level] else w.B[level - 1]
    while quota > w.scored and _packs(
        H, w.beta[level], w.packing, w.factor, w.sets[0], m, limits[size + quota] - bound, quota + 1
    ):
        quota = quota_of(rise, m, bound, limits, size, size + quota - 1)
    return quota


@compiled_part
def _packs(H: Any, beta: Any, p: Any, L: Any, picks: Any, m: int, allowance: float, wanted: int) -> bool:
    """Whether so many disjoint sets are found whose rises are above the allowance."""
    free_all(H, beta, p, m)
    dropped, n = ZERO, m
    while True:
        left, depth, total = wanted, ZERO, 0.0
        while left > 0:
            depth, total = grow(H, p, L, picks, m, dropped, ZERO, 0.0, n, allowance, left)
            if total <= allowance:
                break
            left -= 1
            n -= depth
            take(p, picks, dropped, depth)
        if left == 0:
            return True
        if left > 1 or n == 0 or depth < n:
            return False
        allowance -= total
        dropped += depth
        n = m - dropped
        free_all(H, beta, p, m)
        for k in range(dropped):
            _sweep(L, k, p, H_FREE, p[B_FREE, picks[k]] / L[k, picks[k]], m)
        take(p, picks, ZERO, dropped)


@compiled_part
def free_all(H: Any, beta: Any, p: Any, m: int) -> None:
    """Let every column be taken."""
    for i in range(m):
        p[H_FREE, i] = H[i, i]
        p[B_FREE, i] = beta[i]
    for i in range(m, padded(m)):
        p[H_FREE, i] = TAKEN
        p[B_FREE, i] = 0.0


@compiled_part
def take(p: Any, picks: Any, start: Any, count: int) -> None:
    """Let these columns be taken no more."""
    for k in range(start, start + count):
        p[H_FREE, picks[k]] = TAKEN


@compiled_part
def _begin(p: Any, m: int) -> float:
    """Begin a set: the largest rise."""
    most = -1.0
    for i in range(padded(m)):
        h, b = p[H_FREE, i], p[B_FREE, i]
        p[H_LEFT, i] = h
        p[B_LEFT, i] = b
        rise = b * b / h if h < TAKEN else -1.0
        p[RISE, i] = rise
        most = larger(most, rise)
    return most


@compiled_part
def grow(
    H: Any, p: Any, L: Any, picks: Any, m: int, dropped: Any, depth: Any, total: float, n: int, allowance: float,
    wanted: Any,
) -> tuple[int, float]:  # fmt: skip
    """Add columns to a set of this depth, or to a new one, until its rise is above the allowance: the depth and rise.

    At most n columns are free. It ends early where they would not do for so many sets of this depth. ``picks`` and
    the rows of the factor L follow those of the columns dropped.
    """
    most = _begin(p, m) if depth == 0 else -1.0
    while True:
        if depth > 0 and total <= allowance:
            at = dropped + depth - 1
            pick = picks[at]
            root = p[H_LEFT, pick] ** -0.5
            shift = p[B_LEFT, pick] * root
            # Well before the sweep: a vector that holds a number just stored has to wait for it.
            p[H_LEFT, pick] = TAKEN
            _factor_row(H, L, pick, at, m, root)
            most = _sweep(L, at, p, H_LEFT, shift, m)
        if total > allowance or n < wanted * (depth + 1) or most < 0.0:
            return depth, total
        room = allowance - total
        if most > room:
            # The least that is enough: the others are worth more in another set.
            least = most
            for i in range(padded(m)):
                rise = p[RISE, i]
                least = smaller(least, rise if rise > room else most)
            most = least
        total += most
        pick = 0
        for i in range(padded(m)):
            pick = i if p[RISE, i] == most else pick
        picks[dropped + depth] = pick
        depth += 1


@compiled_part
def _factor_row(H: Any, L: Any, pick: int, depth: int, m: int, root: float) -> None:
    """Row ``depth`` of the factor: that of H less what the rows above hold of it, over its length."""
    width = padded(m)
    for i in range(width):
        L[depth, i] = root * H[pick, i]
    odd = depth % 4
    for k in range(odd):
        f = root * L[k, pick]
        for i in range(width):
            L[depth, i] -= f * L[k, i]
    # Four at a time: short loops cost more to begin than to run.
    for k in range(odd, depth, 4):
        f, g = root * L[k, pick], root * L[k + 1, pick]
        x, y = root * L[k + 2, pick], root * L[k + 3, pick]
        for i in range(width):
            L[depth, i] -= f * L[k, i] + g * L[k + 1, i] + x * L[k + 2, i] + y * L[k + 3, i]


@compiled_part
def _sweep(L: Any, k: int, p: Any, of_h: Any, shift: float, m: int) -> float:
    """Take a row of the factor out of squared lengths and coefficients (the next row of p): the largest rise left."""
    most = -1.0
    for i in range(padded(m)):
        h = p[of_h, i] - L[k, i] * L[k, i]
        b = p[of_h + 1, i] - L[k, i] * shift
        p[of_h, i] = h
        p[of_h + 1, i] = b
        # Not a chain of comparisons: that would be a branch, and the loop would not vectorise.
        rise = -1.0 if (h <= 0.0) | (h > HARDLY_TAKEN) else b * b / h
        p[RISE, i] = rise
        most = larger(most, rise)
    return most
