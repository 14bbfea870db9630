"""Delays and knots as continuous parameters: Gauss-Newton on the whitened problem.

In the weak form a jump's column is a continuous function of the time of the jump, so that knots have
derivatives and standard errors like any other parameter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.model.columns import Column
from brv_hypo.regression.linear import solve_scaled

# A step that gains less than this, in units of twice the log-likelihood, ends the iteration.
SMALLEST_GAIN = 0.2

DesignOf = Callable[[Sequence[Column]], FloatArray]


@dataclass(frozen=True)
class Nonlinear:
    """One continuous parameter and the columns that it moves: a theta of a mechanism, or a knot (s)."""

    kind: Literal["theta", "knot"]
    name: str
    mechanism: str
    value: float
    bounds: tuple[float, float]
    columns: tuple[int, ...]

    def around(self, points: int) -> FloatArray:
        """Values to try: over the bounds of a knot; for a theta, within a factor of 1.6."""
        low, high = self.bounds
        if self.kind == "theta" and self.value > 0.0:
            return np.geomspace(max(low, self.value / 1.6), min(high, self.value * 1.6), points)
        return np.linspace(low, high, points)

    def moved(self, columns: Sequence[Column], value: float) -> tuple[Column, ...]:
        """The columns with this parameter at `value`."""
        out = list(columns)
        for j in self.columns:
            if self.kind == "knot":
                out[j] = replace(out[j], course=replace(out[j].course, start=value))
            else:
                theta = tuple((key, value if key == self.name else old) for key, old in out[j].theta)
                out[j] = replace(out[j], theta=theta)
        return tuple(out)


@dataclass(frozen=True)
class Refined:
    """Columns with refined delays and knots, and the fit at them; `residual` (rows,) is whitened."""

    columns: tuple[Column, ...]
    values: FloatArray
    residual: FloatArray
    nonlinear: tuple[Nonlinear, ...]


def refine(
    columns: tuple[Column, ...],
    nonlinear: tuple[Nonlinear, ...],
    fresh: frozenset[int],
    design_of: DesignOf,
    response: FloatArray,
    samples: int,
    iterations: int = 6,
) -> Refined:
    """Gauss-Newton over delays and knots with the coefficients; a step that does not lower RSS is halved.

    Parameters that move a column of `fresh` are scanned over their bounds first.
    """
    nonlinear, columns = _scan(nonlinear, columns, fresh, design_of, response)
    design = design_of(columns)
    values = solve_scaled(design, response)
    residual = response - design @ values
    for _ in range(iterations if nonlinear else 0):
        slopes = prediction_slopes(nonlinear, columns, values, design_of)
        step = solve_scaled(np.column_stack([design, slopes]), residual)[values.size :]
        rss = float(residual @ residual)
        improved = _line_search(nonlinear, columns, step, design_of, response, rss)
        if improved is None:
            break
        nonlinear, columns, design, values, residual = improved
        left = float(residual @ residual)
        if samples * (rss - left) < SMALLEST_GAIN * left:
            break
    return Refined(columns, values, residual, nonlinear)


def nonlinear_parameters(
    columns: Sequence[Column], baseline_size: int, mechanisms: Mapping[str, Mechanism], knots: FloatArray
) -> tuple[Nonlinear, ...]:
    """The delays and knots of a model: knots may move by their spacing, delays within their bounds."""
    reach = float(np.min(np.diff(knots))) if knots.size > 1 else 0.0
    found: dict[tuple[Literal["theta", "knot"], str, float, str], list[int]] = {}
    for j, column in enumerate(columns[baseline_size:], start=baseline_size):
        for name, value in column.theta:
            found.setdefault(("theta", column.mechanism, value, name), []).append(j)
        if column.course.kind != "constant" and reach > 0.0:
            found.setdefault(("knot", column.mechanism, column.course.start, "knot"), []).append(j)
    out = []
    for (kind, mechanism, value, name), members in found.items():
        if kind == "knot":
            bounds = (value - reach, value + reach)
        else:
            bounds = next(p.bounds for p in mechanisms[mechanism].parameters() if p.name == name)
        out.append(Nonlinear(kind, name, mechanism, value, bounds, tuple(members)))
    return tuple(out)


def _scan(
    nonlinear: tuple[Nonlinear, ...],
    columns: tuple[Column, ...],
    fresh: frozenset[int],
    design_of: DesignOf,
    response: FloatArray,
    points: int = 7,
) -> tuple[tuple[Nonlinear, ...], tuple[Column, ...]]:
    """One coordinate at a time over its bounds: a jump in an oscillating quantity has several minima."""
    settled = []
    for parameter in nonlinear:
        if fresh.isdisjoint(parameter.columns):
            settled.append(parameter)
            continue
        others = [j for j in range(len(columns)) if j not in parameter.columns]
        basis, _ = np.linalg.qr(design_of([columns[j] for j in others]))
        left = response - basis @ (basis.T @ response)
        scores = {}
        for value in (parameter.value, *parameter.around(points)):
            moved = parameter.moved(columns, float(value))
            own = design_of([moved[j] for j in parameter.columns])
            own = own - basis @ (basis.T @ own)
            scores[float(value)] = float(np.sum((left - own @ solve_scaled(own, left)) ** 2))
        best = min(scores, key=lambda value: scores[value])
        columns = parameter.moved(columns, best)
        settled.append(replace(parameter, value=best))
    return tuple(settled), columns


def prediction_slopes(
    nonlinear: Sequence[Nonlinear], columns: tuple[Column, ...], values: FloatArray, design_of: DesignOf
) -> FloatArray:
    """Derivative of the prediction with respect to each nonlinear parameter (2 rows, parameters)."""
    out = []
    for parameter in nonlinear:
        width = 2e-3 * (parameter.bounds[1] - parameter.bounds[0])
        chosen = [columns[j] for j in parameter.columns]
        weights = values[list(parameter.columns)]
        local = replace(parameter, columns=tuple(range(len(chosen))))
        high = design_of(local.moved(chosen, parameter.value + width)) @ weights
        low = design_of(local.moved(chosen, parameter.value - width)) @ weights
        out.append((high - low) / (2.0 * width))
    return np.column_stack(out)


def _line_search(
    nonlinear: tuple[Nonlinear, ...],
    columns: tuple[Column, ...],
    step: FloatArray,
    design_of: DesignOf,
    response: FloatArray,
    rss: float,
    halvings: int = 4,
) -> tuple[tuple[Nonlinear, ...], tuple[Column, ...], FloatArray, FloatArray, FloatArray] | None:
    for halving in range(halvings):
        trial = columns
        moved = []
        for parameter, full in zip(nonlinear, step, strict=True):
            value = float(np.clip(parameter.value + full * 0.5**halving, *parameter.bounds))
            trial = parameter.moved(trial, value)
            moved.append(replace(parameter, value=value))
        design = design_of(trial)
        values = solve_scaled(design, response)
        residual = response - design @ values
        if float(residual @ residual) < rss:
            return tuple(moved), trial, design, values, residual
    return None
