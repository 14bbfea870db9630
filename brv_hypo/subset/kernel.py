"""The compiled depth-first search: one driver, two sets of steps."""

from __future__ import annotations

from typing import Any

from brv_hypo.subset import steps_givens as givens
from brv_hypo.subset import steps_schur as schur
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
    implied,
    leave,
    mark_dropped,
    quota_of,
    record,
)
from brv_hypo.subset.packing import packed_quota
from brv_hypo.subset.triples import score_fours, score_triples

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
                schur.drop(w, level, w.at[level])
            else:
                givens.drop(w, level, w.at[level])
            m = w.count[level] = m - 1
            w.phase[level] = NEW
            if w.bound[level] > loosest[size + 1]:
                leave(w, level)
                continue
        w.state[NODES] += 1
        if orthogonal is None:
            schur.rises(w, level, m, rise)
        else:
            givens.rises(w, level, m, rise)
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
                    schur.score_leaf(w, level, m, quota == 2, limits)
                else:
                    givens.score_leaf(w, level, m, quota == 2, limits)
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
            j = schur.place(w, level, j, m)
        w.at[level] = j
        if verdict == DROPPED:
            continue
        if orthogonal is None:
            schur.include(w, level, j)
        else:
            givens.include(w, level, j)
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
