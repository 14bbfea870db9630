"""The compiled loops of the search: working arrays, quota, closed-form scoring, disjoint sets.

Pruning by disjoint sets of columns: dropping a set A of columns raises the residual by rho(A) = beta_A' (H_AA)^-1
beta_A. A subset with t further columns misses at least one of t + 1 disjoint sets: where all of their rises break its
limit, no such subset gets under it. Collinear columns stand in for each other, so that single columns raise it little,
but sets of a few raise it. Sets are grown greedily by a pivoted factor of H; where t sets are found and the columns
left over make no other, a subset of that size takes one column of each. A triple under its limit therefore has a column
in each of two such sets: only those are scored, with nothing dropped. Entrances: `packed_quota`, `score_triples`.

Imported only when the compiled search is wanted: importing numba costs more than most searches.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numba import njit

# Scalars of the search, by position in ``Work.state``.
LEVEL, NODES, HITS = 0, 1, 2
# Nodes with no more columns to go are scored, not ruled out by sets of columns first.
SCORED = 3
# An argument as numpy scalar: numba would compile a function anew for every literal.
NONE: Any = np.int64(-1)

Function = TypeVar("Function", bound=Callable[..., Any])


# Without references counted (nothing is made here): counting those of arrays handed on took a fifth of the time.
_jit: Any = njit
_OPTIONS = {"cache": True, "nogil": True, "fastmath": True, "error_model": "numpy", "_nrt": False}
compiled: Callable[[Function], Function] = _jit(**_OPTIONS)
"""Compile on first call, keep on disk, run without the interpreter lock."""
compiled_part: Callable[[Function], Function] = _jit(no_cpython_wrapper=True, no_cfunc_wrapper=True, **_OPTIONS)
"""The same for what compiled functions alone call: a wrapper for Python would take as long again to compile."""


def whole_vectors(m: int) -> int:
    """m rounded up to whole vectors of the processor: loops of that length have no end that runs column by column.

    Rows are stored at such lengths; what lies beyond m is finite and counts for nothing.
    """
    return (m + 7) & -8


padded = compiled_part(whole_vectors)


class Work(NamedTuple):
    """The state of one search, which stops and goes on at any node. A level is a number of included columns."""

    A: Any  # (levels, m, m): S, or the factor R
    B: Any  # (levels, m, m): H; of orthogonal steps scratch
    x: Any  # (levels, m): c, or z
    beta: Any  # (levels, m): coefficients with all undecided columns in
    ids: Any  # (levels, m): the undecided columns
    count: Any  # (levels,): how many they are
    branched: Any  # (levels,): whether the include branch of the last column is taken
    owns: Any  # (levels,): whether B is the level's own
    rss: Any  # (levels,): residual without the undecided columns
    bound: Any  # (levels,): residual with all of them
    most: Any  # (levels,): no larger subset below the level can get under its limit
    chosen: Any  # the included columns
    hits: Any  # rows of (size, columns...)
    scratch: Any  # (5, m)
    packing: Any  # (5, m): see `grow`
    factor: Any  # (m, m): see `grow`
    sets: Any  # (3, m): see `grow`
    place: Any  # 0, 1, 2, ...
    state: Any  # LEVEL, NODES, HITS
    base: int  # columns included before the search
    slack: float  # allowance for rounding in a determinant


@compiled_part
def quota_of(rise: Any, m: int, bound: float, limits: Any, size: int, most: int) -> int:
    """Largest number t of further columns, to no more than ``most`` in all, that may still get under the limit.

    Such a subset leaves out at least one of the t + 1 columns of the largest rise, so no more than t
    columns may have a rise that breaks the limit.
    """
    t: int = min(most - size, m)
    while t > 0:
        allowance = limits[size + t] - bound
        if allowance >= 0.0:
            above = 0
            for i in range(m):
                above += 1 if rise[i] > allowance else 0
            if above <= t:
                return t
        t -= 1
    return 0


@compiled_part
def record(w: Work, size: int, a: Any, b: Any) -> None:
    """Note the chosen columns, with up to two more, as a subset to be looked at."""
    row = w.hits[w.state[HITS]]
    for i in range(size):
        row[i + 1] = w.chosen[i]
    if a >= 0:
        size += 1
        row[size] = a
    if b >= 0:
        size += 1
        row[size] = b
    row[0] = size
    w.state[HITS] += 1


@compiled_part
def score(w: Work, level: int, m: int, pairs: bool, limits: Any) -> None:
    """Record every column of a node, and every pair, whose gain reaches what its size needs, without a division.

    S is the normal matrix (its lower triangle is read), d its diagonal, c its right-hand side. A pair gains enough
    where d_k (c_i^2 - D d_i) + c_k^2 d_i + v (D v - 2 c_i c_k) >= 0, with v its entry and D what is needed.
    """
    S, d, c, ids, size, rss = w.A[level], w.scratch[1], w.x[level], w.ids[level], w.base + level, w.rss[level]
    needed = rss - limits[size + 1]
    for i in range(m):
        d[i] = S[i, i]
        if c[i] * c[i] >= needed * d[i]:
            record(w, size, ids[i], NONE)
    if not pairs:
        return
    needed = rss - limits[size + 2]
    relaxed = needed - abs(needed) * w.slack
    for i in range(1, m):
        di, ci = d[i], c[i]
        a = ci * ci - relaxed * di
        b = 2.0 * ci
        row = S[i]
        # Counting vectorises better than taking the maximum; the row is gone over again only on a hit.
        enough = 0
        for k in range(i):
            v = row[k]
            enough += 1 if d[k] * a + c[k] * c[k] * di + v * (needed * v - b * c[k]) >= 0.0 else 0
        if enough > 0:
            for k in range(i):
                v = row[k]
                if d[k] * a + c[k] * c[k] * di + v * (needed * v - b * c[k]) >= 0.0:
                    record(w, size, ids[i], ids[k])


# ---- Pruning by disjoint sets of columns ----


# Squared length of a column that is not to be taken. Those of others are 1 at most in S and no more than the square of
# the condition number in H, 1e14 where these steps are taken: what rounding leaves of EXCLUDED is above
# NEARLY_EXCLUDED.
EXCLUDED = 1e300
NEARLY_EXCLUDED = 1e299
# Rows of ``Work.packing``: squared lengths and coefficients before a set is begun, and as it grows; rises.
H_FREE, B_FREE, H_LEFT, B_LEFT, RISE = np.arange(5)


@compiled_part
def packed_quota(w: Work, level: int, m: int, rise: Any, quota: int, limits: Any) -> int:
    """The quota, lowered as far as disjoint sets allow."""
    size, bound = w.base + level, w.bound[level]
    H = w.B[level] if w.owns[level] else w.B[level - 1]
    while quota > SCORED and _packs(
        H, w.beta[level], w.packing, w.factor, w.sets[0], m, limits[size + quota] - bound, quota + 1
    ):
        quota = quota_of(rise, m, bound, limits, size, size + quota - 1)
    return quota


@compiled_part
def _packs(H: Any, beta: Any, p: Any, L: Any, picks: Any, m: int, allowance: float, wanted: int) -> bool:
    """Whether so many disjoint sets are found whose rises are above the allowance."""
    free_all(H, beta, p, m)
    n = m
    for left in range(wanted, 0, -1):
        depth, total = grow(H, p, L, picks, m, n, allowance, left)
        if total <= allowance:
            return False
        n -= depth
        take(p, picks, depth)
    return True


@compiled_part
def free_all(H: Any, beta: Any, p: Any, m: int) -> None:
    """Let every column be taken."""
    for i in range(m):
        p[H_FREE, i] = H[i, i]
        p[B_FREE, i] = beta[i]
    for i in range(m, padded(m)):
        p[H_FREE, i] = EXCLUDED
        p[B_FREE, i] = 0.0


@compiled_part
def take(p: Any, picks: Any, count: int) -> None:
    """Let the first of these columns be taken no more."""
    for k in range(count):
        p[H_FREE, picks[k]] = EXCLUDED


@compiled_part
def _begin(p: Any, m: int) -> float:
    """Begin a set: the largest rise."""
    most = -1.0
    for i in range(padded(m)):
        h, b = p[H_FREE, i], p[B_FREE, i]
        p[H_LEFT, i] = h
        p[B_LEFT, i] = b
        rise = b * b / h if h < EXCLUDED else -1.0
        p[RISE, i] = rise
        most = max(most, rise)
    return most


@compiled_part
def grow(H: Any, p: Any, L: Any, picks: Any, m: int, n: int, allowance: float, wanted: int) -> tuple[int, float]:
    """Take columns into a set until its rise is above the allowance: how many, and the rise.

    At most n columns are free. It ends early where they would not do for so many sets as large. ``picks`` and the
    rows of the factor L follow those of the columns taken.
    """
    depth, total, most = 0, 0.0, _begin(p, m)
    while total <= allowance and n >= wanted * (depth + 1) and most >= 0.0:
        room = allowance - total
        if most > room:
            # The least that is enough: the others are worth more in another set.
            least = most
            for i in range(padded(m)):
                rise = p[RISE, i]
                least = min(least, rise if rise > room else most)
            most = least
        total += most
        pick = 0
        for i in range(padded(m)):
            pick = i if p[RISE, i] == most else pick
        picks[depth] = pick
        if total <= allowance:
            root = p[H_LEFT, pick] ** -0.5
            shift = p[B_LEFT, pick] * root
            # Well before the sweep: a vector that holds a number just stored has to wait for it.
            p[H_LEFT, pick] = EXCLUDED
            _factor_row(H, L, pick, depth, m, root)
            most = _sweep(L, depth, p, shift, m)
        depth += 1
    return depth, total


@compiled_part
def _factor_row(H: Any, L: Any, pick: int, depth: int, m: int, root: float) -> None:
    """Row ``depth`` of the factor: that of H less what the rows above hold of it, over its length."""
    width = padded(m)
    for i in range(width):
        L[depth, i] = root * H[pick, i]
    for k in range(depth):
        f = root * L[k, pick]
        for i in range(width):
            L[depth, i] -= f * L[k, i]


@compiled_part
def _sweep(L: Any, k: int, p: Any, shift: float, m: int) -> float:
    """Take a row of the factor out of squared lengths and coefficients: the largest rise left."""
    most = -1.0
    for i in range(padded(m)):
        h = p[H_LEFT, i] - L[k, i] * L[k, i]
        b = p[B_LEFT, i] - L[k, i] * shift
        p[H_LEFT, i] = h
        p[B_LEFT, i] = b
        # Not a chain of comparisons: that would be a branch, and the loop would not vectorise.
        rise = -1.0 if (h <= 0.0) | (h > NEARLY_EXCLUDED) else b * b / h
        p[RISE, i] = rise
        most = max(most, rise)
    return most


# ---- Closed form for nodes that take three more columns, on Schur complements ----


@compiled_part
def score_triples(w: Work, level: int, m: int, limits: Any) -> bool:
    """Record all triples of a node; False where hits lack room. Columns that are not to be taken are EXCLUDED."""
    S, c, ids, size = w.A[level], w.x[level], w.ids[level], w.base + level
    diagonal, d, q, e, place = w.scratch[1], w.scratch[2], w.scratch[3], w.scratch[4], w.place
    first, second = w.sets[1], w.sets[2]
    firsts, seconds = _sets_to_score(w, level, m, limits[size + 3] - w.bound[level])
    for i in range(m):
        diagonal[i] = S[i, i]
    diagonal[m : padded(m)] = EXCLUDED
    room = w.hits.shape[0] - m
    for one in range(firsts):
        x = first[one]
        root = diagonal[x] ** -0.5
        shift = c[x] * root
        for i in range(padded(m)):
            q[i] = S[x, i] * root
            d[i] = EXCLUDED if place[i] == x else diagonal[i] - q[i] * q[i]
            e[i] = c[i] - q[i] * shift
        w.chosen[size] = ids[x]
        needed = w.rss[level] - shift * shift - limits[size + 3]
        for two in range(seconds):
            y = second[two]
            if y != x and _completes(S, d, q, e, place, m, y, needed, w.slack):
                if w.state[HITS] > room:
                    return False
                _record_seconds(w, S, d, q, e, ids, m, size + 1, y, needed)
    return True


@compiled_part
def _sets_to_score(w: Work, level: int, m: int, allowance: float) -> tuple[int, int]:
    """How many columns of ``sets[1]`` triples begin with, and of ``sets[2]`` they go on with."""
    H = w.B[level] if w.owns[level] else w.B[level - 1]
    p, L, picks, first, second = w.packing, w.factor, w.sets[0], w.sets[1], w.sets[2]
    for i in range(m):
        first[i] = i
        second[i] = i
    free_all(H, w.beta[level], p, m)
    firsts, total = grow(H, p, L, picks, m, m, allowance, 1)
    if total <= allowance:
        return m, m
    for k in range(firsts):
        first[k] = picks[k]
    take(p, first, firsts)
    seconds, total = grow(H, p, L, picks, m, m - firsts, allowance, 1)
    if total <= allowance:
        return firsts, m
    for k in range(seconds):
        second[k] = picks[k]
    return firsts, seconds


@compiled_part
def _completes(S: Any, d: Any, q: Any, e: Any, place: Any, m: int, y: int, needed: float, slack: float) -> bool:
    """Whether column y, after x, makes a pair that gains what is needed.

    The normal matrix after x is S - q q', its diagonal d, its right-hand side e (see ``score``). That a column makes no
    pair with itself is a comparison of places: to set it EXCLUDED for as long would make the vector it is in wait.
    """
    own, double, shift = d[y], 2.0 * e[y], q[y]
    a = e[y] * e[y] - (needed - abs(needed) * slack) * own
    enough = 0
    for i in range(padded(m)):
        v = S[y, i] - shift * q[i]
        gain = d[i] * a + e[i] * e[i] * own + v * (needed * v - double * e[i])
        enough += 1 if (gain >= 0.0) & (place[i] != y) else 0
    return enough > 0


@compiled_part
def _record_seconds(
    w: Work, S: Any, d: Any, q: Any, e: Any, ids: Any, m: int, size: int, y: int, needed: float
) -> None:
    """Record those columns."""
    a = e[y] * e[y] - (needed - abs(needed) * w.slack) * d[y]
    for i in range(m):
        v = S[y, i] - q[y] * q[i]
        gain = d[i] * a + e[i] * e[i] * d[y] + v * (needed * v - 2.0 * e[y] * e[i])
        if gain >= 0.0 and i != y and d[i] < NEARLY_EXCLUDED:
            record(w, size, ids[y], ids[i])
