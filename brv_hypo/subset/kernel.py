"""The compiled loops of the search: working arrays, quota, closed-form scoring, rules on the path, disjoint sets.

Pruning by disjoint sets of columns: dropping a set A of columns raises the residual by rho(A) = beta_A' (H_AA)^-1
beta_A. A subset with t further columns misses at least one of t + 1 disjoint sets: where all of their rises break its
limit, no such subset gets under it. Collinear columns stand in for each other, so that single columns raise it little,
but sets of a few raise it. Sets are grown greedily by a pivoted factor of H; where t sets are found and the columns
left over make no other, a subset of that size takes one column of each. A triple under its limit therefore has a column
in each of two such sets, four have one in each of three: only those are scored, with nothing dropped. Entrances:
`packed_quota`, `score_triples`, `score_fours`.

Imported only when the compiled search is wanted: importing numba costs more than most searches.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

# What a path has decided about a column.
UNDECIDED, INCLUDED, DROPPED = 0, 1, 2
# Where a level stands: not looked at, its include branch taken, taken with no drop branch to follow.
NEW, BRANCHED, FORCED = 0, 1, 2
# Scalars of the search, by position in ``Work.state``.
LEVEL, NODES, HITS, TRAIL = 0, 1, 2, 3
# An argument as numpy scalar: numba would compile a function anew for every literal.
NONE: Any = np.int64(-1)
ZERO: Any = np.int64(0)
ONE: Any = np.int64(1)

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


def _extremum(instruction: str) -> Any:
    """The larger or smaller of two numbers: a comparison as numba compiles it keeps a loop from being vectorised."""

    @intrinsic  # type: ignore[untyped-decorator, unused-ignore]
    def extremum(_: Any, a: Any, b: Any) -> Any:
        def emit(context: Any, builder: Any, signature: Any, pair: Any) -> Any:
            kind = pair[0].type
            found = builder.module.declare_intrinsic(instruction, [kind], ir.FunctionType(kind, [kind, kind]))
            return builder.call(found, pair, fastmath=("fast",))

        return types.float64(types.float64, types.float64), emit

    return extremum


larger, smaller = _extremum("llvm.maxnum"), _extremum("llvm.minnum")


class Work(NamedTuple):
    """The state of one search, which stops and goes on at any node. A level is a number of included columns."""

    A: Any  # (levels, m, m): S, or the factor R
    B: Any  # (levels, m, m): H; of orthogonal steps scratch
    x: Any  # (levels, m): c, or z
    beta: Any  # (levels, m): coefficients with all undecided columns in
    ids: Any  # (levels, m): the undecided columns
    count: Any  # (levels,): how many they are
    phase: Any  # (levels,): where the level stands
    at: Any  # (levels,): place of the column branched on
    owns: Any  # (levels,): whether B is the level's own
    rss: Any  # (levels,): residual without the undecided columns
    bound: Any  # (levels,): residual with all of them
    most: Any  # (levels,): no larger subset below the level can get under its limit
    chosen: Any  # the included columns
    status: Any  # (columns,): what the path has decided, for the rules
    trail: Any  # the drops along the path, with their levels
    requires: Any  # (columns, columns) bytes, empty without rules; the diagonal counts what a column brings along
    excludes: Any  # (columns, columns) bytes, empty without rules
    hits: Any  # rows of (size, columns...)
    scratch: Any  # (5, m)
    packing: Any  # (5, m): see `grow`
    factor: Any  # (m, m): see `grow`
    sets: Any  # (4, m): see `grow`
    place: Any  # 0, 1, 2, ...
    state: Any  # LEVEL, NODES, HITS, TRAIL
    base: int  # columns included before the search
    slack: float  # allowance for rounding in a determinant
    scored: int  # see SCORED in `compiled`
    prefixes: int  # see MOST_PREFIXES there


@compiled_part
def quota_of(rise: Any, m: int, bound: float, limits: Any, size: int, most: int) -> int:
    """Largest number t of further columns, to no more than ``most`` in all, that may still get under the limit.

    Such a subset leaves out at least one of the t + 1 columns of the largest rise, so no more than t
    columns may have a rise that breaks the limit.
    """
    t: int = min(most - size, m)
    while t > 0:
        allowance = limits[size + t] - bound
        if allowance >= 0.0 and _above(rise, m, allowance) <= t:
            return t
        t -= 1
    return 0


@compiled_part
def _above(rise: Any, m: int, allowance: float) -> int:
    """How many columns have a rise above the allowance."""
    count = 0
    for i in range(m):
        count += 1 if rise[i] > allowance else 0
    return count


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
    if w.requires.size == 0 or _permitted(row, size, w.requires, w.excludes):
        w.state[HITS] += 1


@compiled_part
def _permitted(row: Any, size: int, requires: Any, excludes: Any) -> bool:
    for i in range(1, size + 1):
        v = row[i]
        present = 0
        for k in range(1, size + 1):
            if excludes[v, row[k]]:
                return False
            if k != i:
                present += requires[v, row[k]]
        if present < requires[v, v]:
            return False
    return True


@compiled_part
def singles_enough(d: Any, c: Any, m: int, needed: float) -> int:
    """How many columns gain what is needed; without ``Work``, which takes longer to hand over than to count."""
    enough = 0
    for i in range(padded(m)):
        enough += 1 if c[i] * c[i] >= needed * d[i] else 0
    return enough


@compiled_part
def record_singles(w: Work, d: Any, c: Any, ids: Any, m: int, size: int, needed: float, without: Any) -> None:
    """Record those columns, but one."""
    for i in range(m):
        if c[i] * c[i] >= needed * d[i] and i != without:
            record(w, size, ids[i], NONE)


@compiled_part
def score(w: Work, level: int, m: int, pairs: bool, limits: Any) -> None:
    """Record every column of a node, and every pair, whose gain reaches what its size needs, without a division.

    S is the normal matrix (its lower triangle is read), d its diagonal, c its right-hand side. A pair gains enough
    where d_k (c_i^2 - D d_i) + c_k^2 d_i + v (D v - 2 c_i c_k) >= 0, with v its entry and D what is needed.
    """
    S, d, c, ids, size, rss = w.A[level], w.scratch[1], w.x[level], w.ids[level], w.base + level, w.rss[level]
    for i in range(m):
        d[i] = S[i, i]
    record_singles(w, d, c, ids, m, size, rss - limits[size + 1], NONE)
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


@compiled_part
def implied(w: Work, ids: Any, m: int) -> tuple[int, int]:
    """First undecided column that the rules force, as (position, INCLUDED or DROPPED); (-1, 0) for none."""
    for i in range(m):
        v = ids[i]
        for u in range(w.status.size):
            if u == v:
                continue
            state = w.status[u]
            if (w.requires[v, u] and state == DROPPED) or (w.excludes[v, u] and state == INCLUDED):
                return i, DROPPED
            if w.requires[u, v] and state == INCLUDED:
                return i, INCLUDED
    return -1, 0


@compiled_part
def mark_dropped(w: Work, label: int, level: int) -> None:
    """Note a drop made at a level, so that leaving the level undoes it."""
    w.status[label] = DROPPED
    w.trail[w.state[TRAIL], 0] = label
    w.trail[w.state[TRAIL], 1] = level
    w.state[TRAIL] += 1


@compiled_part
def leave(w: Work, level: int) -> None:
    """Undo the drops made at a level and the inclusion that led to it."""
    while w.state[TRAIL] > 0 and w.trail[w.state[TRAIL] - 1, 1] == level:
        w.state[TRAIL] -= 1
        w.status[w.trail[w.state[TRAIL], 0]] = UNDECIDED
    if level > 0:
        w.status[w.chosen[w.base + level - 1]] = UNDECIDED
    w.state[LEVEL] = level - 1


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
        p[H_FREE, i] = EXCLUDED
        p[B_FREE, i] = 0.0


@compiled_part
def take(p: Any, picks: Any, start: Any, count: int) -> None:
    """Let these columns be taken no more."""
    for k in range(start, start + count):
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
            p[H_LEFT, pick] = EXCLUDED
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
        rise = -1.0 if (h <= 0.0) | (h > NEARLY_EXCLUDED) else b * b / h
        p[RISE, i] = rise
        most = larger(most, rise)
    return most


# ---- Closed form for nodes that take three or four more columns, on Schur complements ----


@compiled_part
def score_triples(w: Work, level: int, m: int, rise: Any, limits: Any) -> bool:
    """Record all singles, pairs and triples of a node; False, with nothing recorded, where hits lack room."""
    hits, size = w.state[HITS], w.base + level
    pairs, firsts, seconds = _sets_to_score(w, level, m, rise, limits)
    S, diagonal = w.A[level], w.scratch[1]
    for i in range(m):
        diagonal[i] = S[i, i]
    diagonal[m : padded(m)] = EXCLUDED
    needed = w.rss[level] - limits[size + 1]
    if singles_enough(diagonal, w.x[level], m, needed) > 0:
        record_singles(w, diagonal, w.x[level], w.ids[level], m, size, needed, NONE)
    scored = _score_from(
        w, S, w.x[level], w.ids[level], m, size, w.rss[level], limits, w.sets[1], pairs, firsts, w.sets[2], seconds
    )
    if not scored:
        w.state[HITS] = hits
    return scored


@compiled_part
def score_fours(w: Work, level: int, m: int, limits: Any) -> bool:
    """Record all fours of a node; False, with nothing recorded, where hits lack room or branching is quicker."""
    S, c, ids, size, hits = w.A[level], w.x[level], w.ids[level], w.base + level, w.state[HITS]
    H = w.B[level] if w.owns[level] else w.B[level - 1]
    p, picks = w.packing, w.sets[0]
    allowance = limits[size + 4] - w.bound[level]
    counts = (ZERO, ZERO, ZERO)
    free, prefixes = m, 1
    free_all(H, w.beta[level], p, m)
    for k in range(1, 4):
        count, total = grow(H, p, w.factor, picks, m, ZERO, ZERO, 0.0, free, allowance, ONE)
        prefixes *= count
        if total <= allowance or prefixes > w.prefixes:
            return False
        free -= count
        take(p, picks, ZERO, count)
        for i in range(count):
            w.sets[k, i] = picks[i]
        counts = (counts[1], counts[2], count)
    T, t, diagonal = w.A[level + 1], w.x[level + 1], w.scratch[1]
    for one in range(counts[0]):
        x = w.sets[1, one]
        scale = 1.0 / S[x, x]
        shift = c[x] * scale
        for i in range(m):
            diagonal[i] = S[i, i] - S[x, i] * S[x, i] * scale
        for i in range(padded(m)):
            t[i] = c[i] - S[x, i] * shift
        diagonal[m : padded(m)] = EXCLUDED
        _rows_after(S, T, m, x, scale, w.sets[2], counts[1])
        _rows_after(S, T, m, x, scale, w.sets[3], counts[2])
        diagonal[x], t[x] = EXCLUDED, 0.0
        w.chosen[size] = ids[x]
        rss = w.rss[level] - c[x] * shift
        if not _score_from(w, T, t, ids, m, size + 1, rss, limits, w.sets[2], ZERO, counts[1], w.sets[3], counts[2]):
            w.state[HITS] = hits
            return False
    return True


@compiled_part
def _rows_after(S: Any, T: Any, m: int, x: int, scale: float, rows: Any, count: int) -> None:
    """Some rows of the normal matrix after x."""
    for k in range(count):
        y = rows[k]
        factor = S[x, y] * scale
        for i in range(padded(m)):
            T[y, i] = S[y, i] - factor * S[x, i]


@compiled_part
def _score_from(
    w: Work, S: Any, c: Any, ids: Any, m: int, size: int, rss: float, limits: Any, first: Any, pairs: int,
    firsts: int, second: Any, seconds: int,
) -> bool:  # fmt: skip
    """Record pairs that begin with a column of ``first``, and triples that go on with one of ``second``.

    The diagonal of S is in ``scratch[1]``; columns that are not to be taken are EXCLUDED there. False: no room.
    """
    diagonal, d, q, e, place = w.scratch[1], w.scratch[2], w.scratch[3], w.scratch[4], w.place
    room = w.hits.shape[0] - m
    for one in range(max(pairs, firsts)):
        if w.state[HITS] > room:
            return False
        x = first[one]
        root = diagonal[x] ** -0.5
        shift = c[x] * root
        for i in range(padded(m)):
            q[i] = S[x, i] * root
            d[i] = EXCLUDED if place[i] == x else diagonal[i] - q[i] * q[i]
            e[i] = c[i] - q[i] * shift
        left = rss - shift * shift
        w.chosen[size] = ids[x]
        needed = left - limits[size + 2]
        if one < pairs and singles_enough(d, e, m, needed) > 0:
            record_singles(w, d, e, ids, m, size + 1, needed, x)
        needed = left - limits[size + 3]
        two = seconds
        if one < firsts:
            two = _next_second(S, d, q, e, place, m, x, second, ZERO, seconds, needed, w.slack)
        while two < seconds:
            if w.state[HITS] > room:
                return False
            _record_seconds(w, S, d, q, e, ids, m, size + 1, second[two], needed)
            two = _next_second(S, d, q, e, place, m, x, second, two + 1, seconds, needed, w.slack)
    return bool(w.state[HITS] <= room)


@compiled_part
def _sets_to_score(w: Work, level: int, m: int, rise: Any, limits: Any) -> tuple[int, int, int]:
    """How many columns of ``sets[1]`` pairs and triples begin with, and of ``sets[2]`` triples go on with."""
    size, bound = w.base + level, w.bound[level]
    H = w.B[level] if w.owns[level] else w.B[level - 1]
    p, L, picks, first, second = w.packing, w.factor, w.sets[0], w.sets[1], w.sets[2]
    of_pairs, of_triples = limits[size + 2] - bound, limits[size + 3] - bound
    free_all(H, w.beta[level], p, m)
    pairs = firsts = seconds = 0
    total = 0.0
    # Whether single columns leave so many further ones possible (see ``quota_of``).
    if of_triples >= 0.0 and _above(rise, m, of_triples) <= 3:
        firsts, total = grow(H, p, L, picks, m, ZERO, ZERO, 0.0, m, of_triples, ONE)
        if total <= of_triples:
            _all(first, m)
            _all(second, m)
            return m, m, m
    if of_pairs >= 0.0 and _above(rise, m, of_pairs) <= 2:
        pairs, total = grow(H, p, L, picks, m, ZERO, firsts, total, m, of_pairs, ONE)
    for k in range(max(pairs, firsts)):
        first[k] = picks[k]
    if firsts > 0:
        take(p, first, ZERO, firsts)
        seconds, rise_of_seconds = grow(H, p, L, picks, m, ZERO, ZERO, 0.0, m - firsts, of_triples, ONE)
        for k in range(seconds):
            second[k] = picks[k]
        if rise_of_seconds <= of_triples:
            _all(second, m)
            seconds = m
    if pairs > 0 and total <= of_pairs:
        _all(first, m)
        pairs, firsts = m, m if firsts > 0 else 0
    return pairs, firsts, seconds


@compiled_part
def _all(columns: Any, m: int) -> None:
    for i in range(m):
        columns[i] = i


@compiled_part
def _next_second(
    S: Any, d: Any, q: Any, e: Any, place: Any, m: int, x: int, second: Any, start: Any, seconds: int, needed: float,
    slack: float,
) -> int:  # fmt: skip
    """The first place, from ``start`` on, of a column that, after x, makes a pair that gains what is needed.

    The normal matrix after x is S - q q', its diagonal d, its right-hand side e (see ``score``). That a column makes no
    pair with itself is a comparison of places: to set it EXCLUDED for as long would make the vector it is in wait.
    """
    relaxed = needed - abs(needed) * slack
    for two in range(start, seconds):
        y = second[two]
        own, double, shift = d[y], 2.0 * e[y], q[y]
        a = e[y] * e[y] - relaxed * own
        enough = 0
        for i in range(padded(m)):
            v = S[y, i] - shift * q[i]
            gain = d[i] * a + e[i] * e[i] * own + v * (needed * v - double * e[i])
            enough += 1 if (gain >= 0.0) & (place[i] != y) else 0
        if enough > 0 and y != x:
            return two
    return seconds


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
