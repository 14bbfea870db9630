"""Closed form for nodes that take three or four more columns, on Schur complements.

A triple that gets under its limit has a column in each of two disjoint sets whose rises break that limit, a pair has
one in a set that breaks its own, four have one in each of three (see ``packing``): only those are scored, with nothing
dropped.
"""

from __future__ import annotations

from typing import Any

from brv_hypo.subset.kernel_parts import (
    HITS,
    NONE,
    ONE,
    ZERO,
    Work,
    compiled_part,
    padded,
    record,
    record_singles,
    singles_enough,
)
from brv_hypo.subset.packing import HARDLY_TAKEN, TAKEN, free_all, grow, take


@compiled_part
def score_triples(w: Work, level: int, m: int, rise: Any, limits: Any) -> bool:
    """Record all singles, pairs and triples of a node; False, with nothing recorded, where hits lack room."""
    hits, size = w.state[HITS], w.base + level
    pairs, firsts, seconds = _sets_to_score(w, level, m, rise, limits)
    S, diagonal = w.A[level], w.scratch[1]
    for i in range(m):
        diagonal[i] = S[i, i]
    diagonal[m : padded(m)] = TAKEN
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
    free, beginnings = m, 1
    free_all(H, w.beta[level], p, m)
    for k in range(1, 4):
        count, total = grow(H, p, w.factor, picks, m, ZERO, ZERO, 0.0, free, allowance, ONE)
        beginnings *= count
        if total <= allowance or beginnings > w.beginnings:
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
        diagonal[m : padded(m)] = TAKEN
        _rows_after(S, T, m, x, scale, w.sets[2], counts[1])
        _rows_after(S, T, m, x, scale, w.sets[3], counts[2])
        diagonal[x], t[x] = TAKEN, 0.0
        w.chosen[size] = ids[x]
        rss = w.rss[level] - c[x] * shift
        if not _score_from(
            w, T, t, ids, m, size + 1, rss, limits, w.sets[2], ZERO, counts[1], w.sets[3], counts[2]
        ):
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

    The diagonal of S is in ``scratch[1]``; columns that are not to be taken are TAKEN there. False: no room.
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
            d[i] = TAKEN if place[i] == x else diagonal[i] - q[i] * q[i]
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
    pair with itself is a comparison of places: to set it TAKEN for as long would make the vector it is in wait.
    """
    eased = needed - abs(needed) * slack
    for two in range(start, seconds):
        y = second[two]
        own, double, shift = d[y], 2.0 * e[y], q[y]
        a = e[y] * e[y] - eased * own
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
        if gain >= 0.0 and i != y and d[i] < HARDLY_TAKEN:
            record(w, size, ids[y], ids[i])
