"""The candidate columns of one hypothesis, and their best subsets on the grid of knots and delays."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import SEARCH_BEST
from brv_hypo.inference.problem import Problem
from brv_hypo.inference.reduced import Reduced
from brv_hypo.linearisation.frame import RateFrame
from brv_hypo.linearisation.linear import solve_normal
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.model.term import Regressor, Theta, Vector, candidates, theta_grid
from brv_hypo.subset import best_columns

Subset = tuple[float, tuple[Regressor, ...]]


@dataclass(frozen=True)
class Offers:
    """Sets of columns to choose from.

    `single`: one set for each theta of the mechanisms' grids, where one theta serves all terms. `joint`: the
    sets in which terms of several theta may stand side by side.
    """

    single: tuple[tuple[Regressor, ...], ...]
    joint: tuple[tuple[Regressor, ...], ...]

    @property
    def count(self) -> int:
        """Number of choices at one theta, which the search pays for; theta itself is paid for as a parameter."""
        return len({column.choice[:2] + column.choice[3:] for offer in self.single for column in offer})


def offers(problem: Problem, frame: RateFrame, mechanisms: Sequence[Mechanism]) -> Offers:
    """The columns on offer for a hypothesis."""

    def product(grids: list[list[tuple[Theta, ...]]]) -> tuple[tuple[Regressor, ...], ...]:
        return tuple(
            tuple(
                column
                for mechanism, thetas in zip(mechanisms, choice, strict=True)
                for column in _columns_of(problem, frame, mechanism, thetas)
            )
            for choice in itertools.product(*grids)
        )

    single = product([[(theta,) for theta in theta_grid(m, dense=True)] for m in mechanisms])
    if not any(m.several_parameters_at_once for m in mechanisms):
        return Offers(single, ())
    return Offers(
        single,
        product(
            [[theta_grid(m)] if m.several_parameters_at_once else [(t,) for t in theta_grid(m)] for m in mechanisms]
        ),
    )


def _columns_of(
    problem: Problem, frame: RateFrame, mechanism: Mechanism, thetas: Sequence[Theta]
) -> tuple[Regressor, ...]:
    motion = frame.motions[frame.reference]
    own = mechanism.knots(motion)
    return candidates(mechanism, motion, problem.knots if own is None else own, thetas)


@dataclass(frozen=True)
class Factor:
    """Columns, the first of which are `forced`, as their triangular factor with the response last.

    It has the same residual sums of squares as the rows, and is small.
    """

    columns: tuple[Regressor, ...]
    forced: int
    triangle: FloatArray

    def subsets(self, max_terms: int, n_best: int = 1) -> list[Subset]:
        """(RSS, columns) of the best subsets of each size beside the forced columns."""
        vectors: dict[Vector, list[int]] = {}
        for place, column in enumerate(self.columns):
            if place >= self.forced and column.grouped:
                vectors.setdefault(column.vector, []).append(place)
        found = best_columns(
            self.triangle[:, :-1],
            self.triangle[:, -1],
            max_terms=min(max_terms, len(self.columns) - self.forced),
            forced=tuple(range(self.forced)),
            n_best=n_best,
            groups=tuple(tuple(members) for members in vectors.values()) or None,
        )
        return [(rss, tuple(self.columns[j] for j in chosen)) for rss, chosen in found]


@dataclass(frozen=True)
class OnGrid:
    """A hypothesis on the grid of knots and thetas: what is on offer, and the best subsets of it.

    `best`: for each number of columns above 0, (RSS, columns), the least first.
    """

    frame: RateFrame
    offered: Offers
    best: Mapping[int, tuple[Subset, ...]]


def on_grid(problem: Problem, mechanisms: Sequence[Mechanism], n_best: int = SEARCH_BEST) -> OnGrid:
    """The `n_best` subsets of each size of either kind of offer."""
    frame = problem.frame.with_mechanisms(mechanisms)
    offered = offers(problem, frame, mechanisms)
    reduced = Reduced(problem, frame)
    best: dict[int, dict[tuple[Regressor, ...], float]] = {}
    for sets in (offered.single, offered.joint):
        found: dict[int, list[Subset]] = {}
        for columns in sets:
            for rss, chosen in _factor(reduced, (), columns).subsets(problem.exact_terms, n_best):
                found.setdefault(len(chosen), []).append((rss, chosen))
        for size, ranked in found.items():
            least = sorted(ranked, key=itemgetter(0))[:n_best]
            best.setdefault(size, {}).update({chosen: rss for rss, chosen in least})
    by_size = {
        size: tuple(sorted(((rss, chosen) for chosen, rss in subsets.items()), key=itemgetter(0)))
        for size, subsets in best.items()
    }
    return OnGrid(frame, offered, by_size)


def extended(
    problem: Problem,
    frame: RateFrame,
    columns: tuple[Regressor, ...],
    mechanisms: Sequence[Mechanism],
    offered: Sequence[tuple[Regressor, ...]],
) -> tuple[Regressor, ...] | None:
    """A model's selected columns with the best further term of its own offer; None where it is full."""
    selected = columns[len(problem.baseline) :]
    reduced = Reduced(problem, frame)
    size = _choice_size(selected)
    if len(selected) + size > problem.max_terms:
        return None
    found = [
        subset
        for offer in _compatible(selected, mechanisms, offered)
        for subset in (
            _factor(reduced, selected, offer).subsets(size)
            if size > 1 and not all(column.grouped for column in offer)
            else _single(reduced, selected, offer, size)
        )
        if subset[1]
    ]
    return (*selected, *min(found, key=itemgetter(0))[1]) if found else None


def _choice_size(selected: Sequence[Regressor]) -> int:
    """Columns that come with one more choice."""
    return max((2 if column.grouped else 1 for column in selected), default=1)


def _compatible(
    selected: Sequence[Regressor], mechanisms: Sequence[Mechanism], offered: Sequence[tuple[Regressor, ...]]
) -> list[tuple[Regressor, ...]]:
    """The offers with the model's own theta, where a mechanism allows one theta at a time."""
    single = {m.name for m in mechanisms if m.parameters() and not m.several_parameters_at_once}
    theta = {c.mechanism: c.theta for c in selected if c.mechanism in single}
    renamed = [tuple(c.at(theta.get(c.mechanism, c.theta), c.time_basis) for c in offer) for offer in offered]
    return list(dict.fromkeys(renamed))


def _single(reduced: Reduced, forced: Sequence[Regressor], offered: Sequence[Regressor], size: int) -> list[Subset]:
    """(RSS, columns) of the best column or vector of `size` components beside the forced columns."""
    groups = [group for group in _together(offered, lambda column: column.choice) if len(group) == size]
    return _best_group(reduced.triangle(reduced.batch((*forced, *offered))), offered, groups)


def _together(columns: Sequence[Regressor], key: Callable[[Regressor], object]) -> list[list[int]]:
    """The places of columns that have a key in common, for each key."""
    groups: dict[object, list[int]] = {}
    for place, column in enumerate(columns):
        groups.setdefault(key(column), []).append(place)
    return list(groups.values())


def _best_group(triangle: FloatArray, offered: Sequence[Regressor], groups: Sequence[Sequence[int]]) -> list[Subset]:
    """(RSS, columns) of the best of some groups of what is on offer, all as large.

    `triangle` has the columns on offer and the response last; columns that are forced stand before those.
    """
    members = np.array(groups)
    if not members.size:
        return []
    forced = triangle.shape[1] - 1 - len(offered)
    squares = np.sum(triangle[:, forced:-1] ** 2, axis=0)[members]
    # Below the forced columns' rows, a triangular factor holds what these leave of the others.
    free, left = triangle[forced:, forced:-1], triangle[forced:, -1]
    vectors = free[:, members].transpose(1, 2, 0)
    right = vectors @ left
    falls = np.sum(right * solve_normal(vectors @ vectors.transpose(0, 2, 1), right, squares), axis=1)
    best = int(np.argmax(falls))
    return [(float(left @ left - falls[best]), tuple(offered[j] for j in members[best]))]


def _factor(reduced: Reduced, forced: Sequence[Regressor], offered: Sequence[Regressor]) -> Factor:
    """The factor of these columns, without those that nothing is left of."""
    batch, columns = reduced.batch((*forced, *offered)), (*forced, *offered)
    triangle = reduced.triangle(batch)
    spent = frozenset(reduced.spent(batch, triangle).tolist())
    kept = [j for j in range(len(columns)) if j not in spent]
    return Factor(
        tuple(columns[j] for j in kept), sum(j < len(forced) for j in kept), triangle[:, [*kept, len(columns)]]
    )
