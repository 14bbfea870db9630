"""The columns on offer, and the best subsets of them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.model.columns import Column, Theta, candidates, theta_grid
from brv_hypo.model.time_variation import TimeFunction
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.problem import Problem
from brv_hypo.subset import best_subsets


@dataclass(frozen=True)
class Offers:
    """Sets of columns to choose from.

    `single`: one set for each theta of the mechanisms' grids, where one theta serves all terms. `joint`: the
    sets in which terms of several theta may stand side by side.
    """

    single: tuple[tuple[Column, ...], ...]
    joint: tuple[tuple[Column, ...], ...]

    @property
    def count(self) -> int:
        """Number of different columns, which the search pays for."""
        return len({column for offer in self.joint or self.single for column in offer})


def offers(problem: Problem, frame: RateFrame, mechanisms: Sequence[Mechanism]) -> Offers:
    """The columns on offer for a hypothesis."""

    def product(grids: list[list[tuple[Theta, ...]]]) -> tuple[tuple[Column, ...], ...]:
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
            [
                [theta_grid(m)] if m.several_parameters_at_once else [(t,) for t in theta_grid(m)]
                for m in mechanisms
            ]
        ),
    )


def _columns_of(
    problem: Problem, frame: RateFrame, mechanism: Mechanism, thetas: Sequence[Theta]
) -> tuple[Column, ...]:
    own = mechanism.knots(frame.motions[0])
    return candidates(mechanism, frame.motions[0], problem.knots if own is None else own, thetas)


def best_by_size(
    problem: Problem, frame: RateFrame, offered: Sequence[tuple[Column, ...]], n_best: int = 2
) -> dict[int, list[tuple[Column, ...]]]:
    """The `n_best` subsets of least RSS for each number of columns above 0, over all offers."""
    found: dict[int, list[tuple[float, tuple[Column, ...]]]] = {}
    forced = problem.design(frame, problem.baseline)
    for columns in offered:
        for rss, chosen in _subsets(problem, frame, forced, columns, problem.exact_terms, n_best):
            found.setdefault(len(chosen), []).append((rss, chosen))
    return {
        size: [chosen for _, chosen in sorted(ranked, key=lambda pair: pair[0])[:n_best]]
        for size, ranked in found.items()
        if size > 0
    }


def extended(
    problem: Problem,
    frame: RateFrame,
    columns: tuple[Column, ...],
    mechanisms: Sequence[Mechanism],
    offered: Sequence[tuple[Column, ...]],
) -> tuple[Column, ...] | None:
    """A model's selected columns with the best further term of its own offer; None where it is full."""
    selected = columns[len(problem.baseline) :]
    size = max(2 if column.tied else 1 for column in selected)
    if len(selected) + size > problem.max_terms:
        return None
    forced = problem.design(frame, columns)
    found = [
        (rss, chosen)
        for offer in _compatible(selected, mechanisms, offered)
        for rss, chosen in _subsets(problem, frame, forced, offer, size)
        if chosen
    ]
    return (*selected, *min(found, key=lambda pair: pair[0])[1]) if found else None


def narrowed(problem: Problem, frame: RateFrame, columns: tuple[Column, ...]) -> list[tuple[Column, ...]]:
    """The two best subsets of each size among all courses at a model's own knots and thetas.

    It finds the plainer model where refinement has moved several terms to one place.
    """
    selected = columns[len(problem.baseline) :]
    forced = problem.design(frame, problem.baseline)
    own: dict[Column, None] = {}
    for column in selected:
        mechanism = frame.mechanisms[column.mechanism]
        mine = [c for c in selected if c.mechanism == column.mechanism]
        knots = _merged([c.course.start for c in mine if c.course.kind != "constant"], _spacing(problem) / 4.0)
        thetas = _merged_thetas(mine)
        own.update(dict.fromkeys(candidates(mechanism, frame.motions[0], knots, thetas)))
    smaller = max(len(selected), 1)
    return [chosen for _, chosen in _subsets(problem, frame, forced, tuple(own), smaller, n_best=2) if chosen]


def _spacing(problem: Problem) -> float:
    return float(np.min(np.diff(problem.knots))) if problem.knots.size > 1 else 0.0


def _merged(values: Sequence[float], tolerance: float) -> FloatArray:
    """The values in order, those within `tolerance` of their neighbour replaced by their mean."""
    ordered = np.sort(np.asarray(values, dtype=float))
    if ordered.size == 0:
        return ordered
    clusters = np.split(ordered, np.flatnonzero(np.diff(ordered) > tolerance) + 1)
    return np.array([cluster.mean() for cluster in clusters])


def _merged_thetas(columns: Sequence[Column], tolerance: float = 0.1) -> list[Theta]:
    """The thetas of the columns; single delays within a tenth of each other become one."""
    thetas = list(dict.fromkeys(column.theta for column in columns))
    if any(len(theta) != 1 for theta in thetas):
        return thetas
    name = thetas[0][0][0]
    logarithms = _merged([float(np.log(theta[0][1])) for theta in thetas], tolerance)
    return [((name, float(np.exp(value))),) for value in logarithms]


def _compatible(
    selected: Sequence[Column], mechanisms: Sequence[Mechanism], offered: Sequence[tuple[Column, ...]]
) -> list[tuple[Column, ...]]:
    """The offers with the model's own theta, where a mechanism allows one theta at a time."""
    single = {m.name for m in mechanisms if m.parameters() and not m.several_parameters_at_once}
    theta = {c.mechanism: c.theta for c in selected if c.mechanism in single}
    renamed = [tuple(replace(c, theta=theta.get(c.mechanism, c.theta)) for c in offer) for offer in offered]
    return list(dict.fromkeys(renamed))


def _subsets(
    problem: Problem,
    frame: RateFrame,
    forced: FloatArray,
    offered: tuple[Column, ...],
    max_terms: int,
    n_best: int = 1,
) -> list[tuple[float, tuple[Column, ...]]]:
    """(RSS, columns) of the best subsets of each size beside the forced columns."""
    size = forced.shape[1]
    vectors: dict[tuple[str, Theta, TimeFunction], list[int]] = {}
    for j, column in enumerate(offered):
        if column.tied:
            vectors.setdefault(column.vector, []).append(size + j)
    # The triangular factor has the same residual sums of squares as the rows, and is small.
    rows = np.column_stack([forced, problem.design(frame, offered), problem.response])
    triangle: FloatArray = np.asarray(np.linalg.qr(rows, mode="r"), dtype=float)
    result = best_subsets(
        triangle[:, :-1],
        triangle[:, -1],
        max_terms=min(max_terms, len(offered)),
        forced=tuple(range(size)),
        n_best=n_best,
        groups=tuple(tuple(members) for members in vectors.values()) or None,
    )
    return [(s.rss, tuple(offered[j - size] for j in s.columns)) for s in result.subsets]
