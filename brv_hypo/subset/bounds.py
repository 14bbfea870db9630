"""Pruning by disjoint sets of columns, and closed forms for three or four columns to go, on Schur complements.

Dropping a set A of columns raises the residual by rho(A) = beta_A' (H_AA)^-1 beta_A. A subset with t further columns
misses at least one of t + 1 disjoint sets: where all of their rises break its limit, no such subset gets under it.
Collinear columns stand in for each other, so that single columns raise it little, but sets of a few raise it. Sets
are grown greedily by a pivoted factor of H; where t sets are found and the columns left over make no other, a subset
of that size takes one column of each. A triple under its limit therefore has a column in each of two such sets, four
have one in each of three: only those are scored, with nothing dropped. Entrances: `packed_quota`, `score_triples`,
`score_fours`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from brv_hypo.subset.kernel_parts import (
    HITS,
    NONE,
    ONE,
    ZERO,
    Work,
    compiled_part,
    larger,
    padded,
    quota_of,
    record,
    record_singles,
    singles_enough,
    smaller,
)

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
    if _possible(rise, m, of_triples, 3):
        firsts, total = grow(H, p, L, picks, m, ZERO, ZERO, 0.0, m, of_triples, ONE)
        if total <= of_triples:
            _all(first, m)
            _all(second, m)
            return m, m, m
    if _possible(rise, m, of_pairs, 2):
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
def _possible(rise: Any, m: int, allowance: float, count: int) -> bool:
    """Whether single columns leave so many further ones possible (see ``quota_of``)."""
    above = 0
    for i in range(m):
        above += 1 if rise[i] > allowance else 0
    return allowance >= 0.0 and above <= count


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
