"""Closed form for nodes that take three more columns, on Schur complements.

A triple that gets under its limit has a column in each of two disjoint sets whose rises break that limit, and a pair
one in a set that breaks its own (see ``packing``): only those are scored, with nothing dropped and no child written.
"""

from __future__ import annotations

from typing import Any

from brv_hypo.subset.kernel_parts import HITS, Work, compiled_part, record, record_singles, singles_enough
from brv_hypo.subset.packing import TAKEN, begin, free_all, grow, take


@compiled_part
def score_triples(w: Work, level: int, m: int, rise: Any, limits: Any) -> bool:
    """Record all singles, pairs and triples of a node; False, with nothing recorded, where hits lack room."""
    S, c, ids, first, second = w.A[level], w.x[level], w.ids[level], w.sets[1], w.sets[2]
    diagonal, d, q, e = w.scratch[1], w.scratch[2], w.scratch[3], w.scratch[4]
    size, hits, room = w.base + level, w.state[HITS], w.hits.shape[0] - m
    pairs, firsts, seconds = _sets_to_score(w, level, m, rise, limits)
    for i in range(m):
        diagonal[i] = S[i, i]
    record_singles(w, diagonal, c, ids, m, size, w.rss[level] - limits[size + 1], -1)
    for one in range(max(pairs, firsts)):
        x = first[one]
        root = diagonal[x] ** -0.5
        shift = c[x] * root
        for i in range(m):
            q[i] = S[x, i] * root
            d[i] = diagonal[i] - q[i] * q[i]
            e[i] = c[i] - q[i] * shift
        d[x], e[x] = TAKEN, 0.0
        rss = w.rss[level] - shift * shift
        w.chosen[size] = ids[x]
        needed = rss - limits[size + 2]
        if one < pairs and singles_enough(d, e, m, needed) > 0:
            record_singles(w, d, e, ids, m, size + 1, needed, x)
        needed = rss - limits[size + 3]
        for two in range(seconds if one < firsts else 0):
            if w.state[HITS] > room:
                w.state[HITS] = hits
                return False
            y = second[two]
            if y != x and _seconds_enough(S, d, q, e, m, y, needed, w.slack) > 0:
                _record_seconds(w, S, d, q, e, ids, m, size + 1, x, y, needed)
        if w.state[HITS] > room:
            w.state[HITS] = hits
            return False
    return True


@compiled_part
def _sets_to_score(w: Work, level: int, m: int, rise: Any, limits: Any) -> tuple[int, int, int]:
    """How many columns of ``sets[1]`` pairs and triples begin with, and of ``sets[2]`` triples go on with."""
    size, bound = w.base + level, w.bound[level]
    H = w.B[level] if w.owns[level] else w.B[level - 1]
    p, L, picks, first, second = w.packing, w.factor, w.sets[0], w.sets[1], w.sets[2]
    allowance = limits[size + 3] - bound
    free_all(H, w.beta[level], p, m)
    begin(p, m)
    firsts, total = grow(H, p, L, picks, m, 0, 0, 0.0, m, allowance, 1)
    if total <= allowance:
        for i in range(m):
            first[i] = second[i] = i
        return m, m, m
    of_pairs = limits[size + 2] - bound
    pairs = 0
    if of_pairs >= 0.0 and _above(rise, m, of_pairs) <= 2:
        pairs, total = grow(H, p, L, picks, m, 0, firsts, total, m, of_pairs, 1)
    for k in range(max(pairs, firsts)):
        first[k] = picks[k]
    take(p, first, 0, firsts)
    begin(p, m)
    seconds, rise_of_seconds = grow(H, p, L, picks, m, 0, 0, 0.0, m - firsts, allowance, 1)
    for k in range(seconds):
        second[k] = picks[k]
    if rise_of_seconds <= allowance:
        seconds = m
        for i in range(m):
            second[i] = i
    if pairs > 0 and total <= of_pairs:
        pairs = firsts = m
        for i in range(m):
            first[i] = i
    return pairs, firsts, seconds


@compiled_part
def _above(rise: Any, m: int, allowance: float) -> int:
    count = 0
    for i in range(m):
        count += 1 if rise[i] > allowance else 0
    return count


@compiled_part
def _seconds_enough(S: Any, d: Any, q: Any, e: Any, m: int, y: int, needed: float, slack: float) -> int:
    """How many columns, after x, make a pair with y that gains what is needed (see ``score``).

    The normal matrix after x is S - q q', its diagonal d, its right-hand side e; x and y do not count.
    """
    own, d[y] = d[y], TAKEN
    a = e[y] * e[y] - (needed - abs(needed) * slack) * own
    double, shift = 2.0 * e[y], q[y]
    enough = 0
    for i in range(m):
        v = S[y, i] - shift * q[i]
        enough += 1 if d[i] * a + e[i] * e[i] * own + v * (needed * v - double * e[i]) >= 0.0 else 0
    d[y] = own
    return enough


@compiled_part
def _record_seconds(
    w: Work, S: Any, d: Any, q: Any, e: Any, ids: Any, m: int, size: int, x: int, y: int, needed: float
) -> None:
    """Record those columns."""
    a = e[y] * e[y] - (needed - abs(needed) * w.slack) * d[y]
    for i in range(m):
        v = S[y, i] - q[y] * q[i]
        gain = d[i] * a + e[i] * e[i] * d[y] + v * (needed * v - 2.0 * e[y] * e[i])
        if gain >= 0.0 and i != x and i != y:
            record(w, size, ids[y], ids[i])
