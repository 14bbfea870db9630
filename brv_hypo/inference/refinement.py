"""Delays and knots as continuous parameters: Gauss-Newton on the whitened problem.

In the weak form a jump's column is a continuous function of the time of the jump, so that knots have
derivatives and standard errors like any other parameter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.inference.reduced import Batch, Fitted, Reduced
from brv_hypo.linearisation.frame import RateFrame
from brv_hypo.linearisation.linear import solve_normal
from brv_hypo.model.term import Regressor, TimeBasis

# Bound the time; held by `tests.studies.independent.study` (how often the truth wins where it can).
SCANNED = 7  # values of a parameter that are tried before Gauss-Newton
SCANNED_FACTOR = 1.6  # of a theta either way
REFINED_WIDTH = 2e-3  # half the width of differences by knots and delays, of their bounds
REFINED_HALVINGS = 4  # lengths of a step that are tried
_SAME = 1e-12  # relative difference of values of a parameter that are one
WIDEST = 0.4  # of the record: what comes on over more of it is a drift, which processes are
NARROWEST = 0.05  # of the knots' spacing: the least width of an onset
KNOT_MARGIN = 0.25  # of the knots' spacing, by which one stays away from the ends of the record


class Steps(NamedTuple):
    """How Gauss-Newton goes: at most so many steps, to one that gains less than `gain` in twice the log-likelihood."""

    most: int
    gain: float


ROUGH = Steps(2, 0.2)  # of models that are compared: a tenth of what one term costs
CLOSELY = (1.0 / 3.0, 1.0 / 9.0, 1.0 / 27.0)  # of bounds, in which a knot finds the best of the minima about it
FINAL = Steps(40, 1e-6)  # of one that is reported, or linearised about


@dataclass(frozen=True)
class Nonlinear:
    """One continuous parameter, in `units`, and which of the selected columns it moves. A theta of a mechanism, a knot,
    or the width of an onset that a ramp with an end describes; its knot is the middle.
    """

    kind: Literal["theta", "knot", "width"]
    name: str
    mechanism: str
    value: float
    bounds: tuple[float, float]
    columns: tuple[int, ...]
    units: str = "s"

    def others(self, part: float = 1.0) -> list[float]:
        """Other values to try: of a knot over a part of its bounds, of a theta within a factor of `SCANNED_FACTOR`."""
        low, high = self.bounds
        if self.kind == "theta" and self.value > 0.0:
            factor = SCANNED_FACTOR**part
            around = np.geomspace(max(low, self.value / factor), min(high, self.value * factor), SCANNED)
        elif part == 1.0:
            around = np.linspace(low, high, SCANNED)
        else:
            around = self.value + 0.5 * part * (high - low) * np.linspace(-1.0, 1.0, SCANNED)
        values = dict.fromkeys(np.clip(around, low, high).tolist())
        return [value for value in values if not math.isclose(value, self.value, rel_tol=_SAME)]

    def moved(self, columns: Sequence[Regressor], value: float) -> tuple[Regressor, ...]:
        """The columns with this parameter at `value`."""
        return tuple(self._moved(column, value) if j in self.columns else column for j, column in enumerate(columns))

    def _moved(self, column: Regressor, value: float) -> Regressor:
        basis = column.time_basis
        if self.kind == "theta":
            return column.at(tuple((key, value if key == self.name else old) for key, old in column.theta), basis)
        if not has_width(basis):
            return column.at(column.theta, TimeBasis(basis.kind, value, basis.stop))
        at, width = (value, basis.stop - basis.start) if self.kind == "knot" else (middle(basis), value)
        return column.at(column.theta, TimeBasis("ramp", at - 0.5 * width, at + 0.5 * width))


def shift_sigma(step: float) -> float:
    """Standard deviation (s) of a jump's time within a sample (`step` s), uniform: filters of sensors shift it so."""
    return step / math.sqrt(12.0)


def middle(basis: TimeBasis) -> float:
    """When a change happens, s: of a ramp with an end the middle."""
    return 0.5 * (basis.start + basis.stop) if has_width(basis) else basis.start


def has_width(basis: TimeBasis) -> bool:
    """Whether it is an onset that takes time: a ramp with an end."""
    return basis.kind == "ramp" and math.isfinite(basis.stop)


@dataclass(frozen=True)
class Refined:
    """Selected columns, the delays and knots that move them, and the fit at these."""

    nonlinear: tuple[Nonlinear, ...]
    columns: tuple[Regressor, ...]
    batch: Batch
    fitted: Fitted


def refine(
    columns: tuple[Regressor, ...],
    nonlinear: tuple[Nonlinear, ...],
    fresh: frozenset[int],
    reduced: Reduced,
    steps: Steps = ROUGH,
    parts: Sequence[float] = (1.0,),
) -> Refined:
    """Gauss-Newton over delays and knots of selected columns; a step that does not lower RSS is halved. Parameters that
    move a column of `fresh` are scanned first, over these parts of their bounds in turn.
    """
    state = _scanned(reduced, nonlinear, columns, fresh, parts)
    for _ in range(steps.most if nonlinear else 0):
        step, before = _step(reduced, state), state.fitted.rss
        trials = (_moved(reduced, state, 0.5**halving * step) for halving in range(REFINED_HALVINGS))
        improved = next((trial for trial in trials if trial.fitted.rss < before), None)
        if improved is None:
            break
        state = improved
        if reduced.problem.samples * (before - state.fitted.rss) < steps.gain * state.fitted.rss:
            break
    return state


def nonlinear_parameters(columns: Sequence[Regressor], frame: RateFrame, knots: FloatArray) -> tuple[Nonlinear, ...]:
    """The delays and knots of selected columns: knots may move by their spacing, delays within their bounds. A knot
    stays within the record, away from its ends: beyond them nothing depends on where it is, next to them hardly.
    """
    reach = float(np.min(np.diff(knots))) if knots.size > 1 else 0.0
    start, stop = float(frame.coefficient_time.min()), float(frame.coefficient_time.max())
    found: dict[tuple[Literal["theta", "knot", "width"], str, float, str, TimeBasis | int | None], list[int]] = {}
    for j, column in enumerate(columns):
        for name, value in column.theta:
            found.setdefault(("theta", column.mechanism, value, name, None), []).append(j)
        basis = column.time_basis
        if basis.kind != "constant" and reach > 0.0:
            found.setdefault(("knot", column.mechanism, middle(basis), "knot", column.flight), []).append(j)
            if has_width(basis):
                place = (column.mechanism, basis.stop - basis.start, "onset width", basis)
                found.setdefault(("width", *place), []).append(j)
    out = []
    for (kind, mechanism, value, name, _), members in found.items():
        if kind == "knot":
            inside = (min(start + KNOT_MARGIN * reach, value), max(stop - KNOT_MARGIN * reach, value))
            bounds, units = (max(value - reach, inside[0]), min(value + reach, inside[1])), "s"
        elif kind == "width":
            at = middle(columns[members[0]].time_basis)
            widest = min(2.0 * (at - start), 2.0 * (stop - at), WIDEST * (stop - start))
            bounds, units = (min(NARROWEST * reach, value), max(widest, value)), "s"
        else:
            parameter = next(p for p in frame.mechanisms[mechanism].parameters() if p.name == name)
            bounds, units = parameter.bounds, parameter.units
        out.append(Nonlinear(kind, name, mechanism, value, bounds, tuple(members), units))
    return tuple(out)


def _scanned(
    reduced: Reduced,
    nonlinear: tuple[Nonlinear, ...],
    columns: tuple[Regressor, ...],
    fresh: frozenset[int],
    parts: Sequence[float],
) -> Refined:
    """One coordinate at a time over parts of its bounds: a jump in an oscillating quantity has several minima."""
    batch = reduced.batch(columns)
    placed = list(nonlinear)
    for part in parts:
        for k, parameter in enumerate(placed):
            if fresh.isdisjoint(parameter.columns):
                continue
            values = (parameter.value, *parameter.others(part))
            best, moved = _best_of(reduced, batch, columns, parameter, values)
            columns = parameter.moved(columns, values[best])
            batch = batch.with_columns(parameter.columns, moved)
            placed[k] = replace(parameter, value=values[best])
    return Refined(tuple(placed), columns, batch, reduced.fit(batch))


def _best_of(
    reduced: Reduced, batch: Batch, columns: Sequence[Regressor], parameter: Nonlinear, values: Sequence[float]
) -> tuple[int, Batch]:
    """Which value fits best, the other columns held, and the moved columns at it: one stack of normal equations."""
    count, size = len(values), len(parameter.columns)
    others = batch.of([j for j in range(len(columns)) if j not in parameter.columns])
    rest = others.rows.shape[1]
    trials = [parameter.moved(columns, value) for value in values]
    moved = reduced.batch([trial[j] for trial in trials for j in parameter.columns])
    products = np.empty((count, rest + size, rest + size))
    products[:, :rest, :rest] = others.products(others)
    across = others.products(moved).reshape(rest, count, size).transpose(1, 0, 2)
    products[:, :rest, rest:], products[:, rest:, :rest] = across, across.transpose(0, 2, 1)
    own = moved.products(moved).reshape(count, size, count, size)
    products[:, rest:, rest:] = own[np.arange(count), :, np.arange(count)]
    right = np.hstack([np.tile(reduced.right(others), (count, 1)), reduced.right(moved).reshape(count, -1)])
    squares = np.hstack([np.tile(others.squares, (count, 1)), moved.squares.reshape(count, -1)])
    found = solve_normal(products, right, squares)
    best = int(np.argmax(np.sum(right * found, axis=1)))
    return best, moved.of(slice(best * size, (best + 1) * size))


def prediction_slopes(
    nonlinear: Sequence[Nonlinear], columns: Sequence[Regressor], values: FloatArray, frame: RateFrame
) -> ComplexArray:
    """Derivative of the predicted rates with respect to each nonlinear parameter (frame rows, parameters). By central
    differences over `REFINED_WIDTH` of its bounds to either side, all in one batch: where a knot lies at a sample, the
    derivatives on its two sides differ, and their mean is wanted.
    """
    moved: list[Regressor] = []
    weights: list[tuple[int, float]] = []
    for p, parameter in enumerate(nonlinear):
        width = REFINED_WIDTH * (parameter.bounds[1] - parameter.bounds[0])
        for sign in (1.0, -1.0):
            there = parameter.moved(columns, parameter.value + sign * width)
            moved += [there[j] for j in parameter.columns]
            weights += [(p, sign * float(values[j]) / (2.0 * width)) for j in parameter.columns]
    mixed = np.zeros((len(moved), len(nonlinear)))
    for row, (p, weight) in enumerate(weights):
        mixed[row, p] = weight
    return np.asarray(frame.columns(moved) @ mixed, dtype=complex)


def _step(reduced: Reduced, state: Refined) -> FloatArray:
    """Gauss-Newton step of the nonlinear parameters, the coefficients free."""
    values = state.fitted.values
    rates = prediction_slopes(state.nonlinear, state.columns, values, reduced.frame)
    slopes = reduced.batch_of(reduced.problem.rows.white_moments(rates))
    across = state.batch.products(slopes)
    inside, count = state.fitted.products, values.size
    products = np.empty((count + len(state.nonlinear),) * 2)
    products[:count, :count], products[count:, count:] = inside, slopes.products(slopes)
    products[:count, count:], products[count:, :count] = across, across.T
    right = np.concatenate([state.fitted.right - inside @ values, reduced.right(slopes) - across.T @ values])
    return solve_normal(products, right, np.concatenate([state.batch.squares, slopes.squares]))[count:]


def _moved(reduced: Reduced, state: Refined, step: FloatArray) -> Refined:
    """The fit where a step (parameters,) leads, within their bounds."""
    places = sorted({j for parameter in state.nonlinear for j in parameter.columns})
    columns = state.columns
    moved = []
    for parameter, change in zip(state.nonlinear, step.tolist(), strict=True):
        low, high = parameter.bounds
        value = min(max(parameter.value + change, low), high)
        columns = parameter.moved(columns, value)
        moved.append(replace(parameter, value=value))
    batch = state.batch.with_columns(places, reduced.batch([columns[j] for j in places]))
    return Refined(tuple(moved), columns, batch, reduced.fit(batch))
