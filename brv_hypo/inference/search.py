"""The candidate columns of one hypothesis, and their best subsets on the grid of knots and delays."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from operator import itemgetter

from brv_hypo.inference.problem import Problem
from brv_hypo.inference.reduced import Reduced
from brv_hypo.linearisation.frame import RateFrame
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.model.term import Choice, Regressor, candidates, theta_grid
from brv_hypo.subset import best_columns

Subset = tuple[float, tuple[Regressor, ...]]


Offers = tuple[tuple[Regressor, ...], ...]
"""Sets of columns to choose from: one for each theta of the mechanisms' grids, which serves all terms of a mechanism.
"""


def choices(offered: Offers) -> int:
    """Number of choices at one theta, which the search pays for; theta itself is paid for as a parameter."""
    return len({column.choice[:2] + column.choice[3:] for offer in offered for column in offer})


def offers(problem: Problem, frame: RateFrame, mechanisms: Sequence[Mechanism]) -> Offers:
    """The columns on offer for a hypothesis."""
    motion = frame.motions[frame.reference]
    knots = [problem.knots if (own := mechanism.knots(motion)) is None else own for mechanism in mechanisms]
    thetas = itertools.product(*(theta_grid(mechanism, dense=True) for mechanism in mechanisms))
    chosen = (zip(mechanisms, knots, each, strict=True) for each in thetas)
    return tuple(
        tuple(column for mechanism, own, theta in each for column in candidates(mechanism, motion, own, (theta,)))
        for each in chosen
    )


def on_grid(problem: Problem, mechanisms: Sequence[Mechanism]) -> tuple[RateFrame, Offers, dict[int, Subset]]:
    """Frame and offers of a hypothesis on the grid, and by number of columns above 0 the subset of least RSS."""
    frame = problem.frame.with_mechanisms(mechanisms)
    offered = offers(problem, frame, mechanisms)
    reduced = Reduced(problem, frame)
    best: dict[int, Subset] = {}
    for offer in offered:
        for subset in _subsets(reduced, (), offer, problem.exact_terms):
            size = len(subset[1])
            if size and (size not in best or subset[0] < best[size][0]):
                best[size] = subset
    return frame, offered, best


def extended(
    problem: Problem,
    frame: RateFrame,
    columns: tuple[Regressor, ...],
    mechanisms: Sequence[Mechanism],
    offered: Sequence[tuple[Regressor, ...]],
) -> tuple[Regressor, ...] | None:
    """A model's selected columns with the best further term at its own theta; None where it is full."""
    selected = columns[len(problem.baseline) :]
    reduced = Reduced(problem, frame)
    size = max((2 if column.grouped else 1 for column in selected or offered[0]), default=1)  # of one more choice
    if len(selected) + size > problem.max_terms:
        return None
    theta = {c.mechanism: c.theta for c in selected}
    renamed = [tuple(c.at(theta.get(c.mechanism, c.theta), c.time_basis) for c in offer) for offer in offered]
    subsets = (each for offer in dict.fromkeys(renamed) for each in _subsets(reduced, selected, offer, size))
    found = [subset for subset in subsets if subset[1]]
    return (*selected, *min(found, key=itemgetter(0))[1]) if found else None


def _subsets(
    reduced: Reduced, forced: Sequence[Regressor], offered: Sequence[Regressor], max_terms: int
) -> list[Subset]:
    """The best subset of each size of what is on offer, beside forced columns: (RSS, columns without those). The search
    has the triangular factor of all columns, which has the same residual sums of squares as the rows and is small.
    Columns that nothing is left of beside baseline and nuisances are no candidates.
    """
    columns = (*forced, *offered)
    batch = reduced.batch(columns)
    triangle = reduced.triangle(batch)
    spent = frozenset(reduced.spent(batch, triangle).tolist())
    kept = [j for j in range(len(columns)) if j not in spent]
    first = sum(j < len(forced) for j in kept)
    vectors: dict[Choice, list[int]] = {}
    for place, j in enumerate(kept):
        if place >= first and columns[j].grouped:
            vectors.setdefault(columns[j].choice, []).append(place)
    found = best_columns(
        triangle[:, kept],
        triangle[:, -1],
        max_terms=min(max_terms, len(kept) - first),
        forced=tuple(range(first)),
        groups=tuple(tuple(members) for members in vectors.values()) or None,
    )
    return [(rss, tuple(columns[kept[place]] for place in chosen)) for rss, chosen in found]
