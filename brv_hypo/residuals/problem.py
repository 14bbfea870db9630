"""The regression of one step: a model as it stands on the fitted part of the record, and what may join it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.mechanisms.contract import RecordEffect
from brv_hypo.mechanisms.registry import nuisance_effects
from brv_hypo.model.term import Regressor, TimeBasis, default_knots
from brv_hypo.regression.build import linearised, on_rows, with_vehicle
from brv_hypo.regression.channels import Noise, Rows
from brv_hypo.regression.fit import HypothesisFit
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.linear import covariance_of, solve_scaled
from brv_hypo.regression.noise import estimated_noise, first_noise, raised_noise
from brv_hypo.regression.nuisance import Errors, nuisances
from brv_hypo.regression.problem import GivenColumns, Problem, WhitenedRows
from brv_hypo.regression.response import LinearisedFlight
from brv_hypo.residuals.baseline import TOLERATED, tolerated
from brv_hypo.residuals.config import TraceConfig
from brv_hypo.residuals.linearisation import Corrected, Model


def linearised_at(data: Corrected, model: Model, values: FloatArray) -> tuple[LinearisedFlight, ...]:
    """Each flight, linearised about the model with coefficients (columns,) and its vehicle's known errors."""
    return tuple(_linearised_at(data, number, model, values) for number in range(len(data.records)))


def _linearised_at(data: Corrected, number: int, model: Model, values: FloatArray) -> LinearisedFlight:
    own = [j for j, column in enumerate(model.columns) if column.acts_on(number)]
    columns = tuple(model.columns[j] for j in own)
    vehicle = tolerated(model, data.flights[number])
    known = with_vehicle(data.frame, columns, values[own], vehicle, data.corrections[number])
    return linearised(data.records[number], data.reconstructions[number], *known)


def problem_of(
    data: Corrected,
    model: Model,
    flights: Sequence[LinearisedFlight],
    config: TraceConfig,
    given: Mapping[str, Rows] | None = None,
    noise: Noise | None = None,
    processes: Sequence[RecordEffect] = (),
) -> Problem:
    """The model's regression on the fitted part; `given` are histories that may be asked for as columns.

    Components of record effects that the model holds are free, all others bounded by their tolerances. Without a
    `noise`, it is what the record itself says, raised to what the model leaves. `processes` of the record may act too.
    """
    frame = data.frame
    free = [
        {(a.effect.name, a.component): a.effect for a in model.applied if a.flight == number}
        for number in range(len(flights))
    ]
    vehicle = tolerated(model, data.flights[0])
    unknown = nuisances(frame, flights, (*nuisance_effects(), *processes), vehicle, free, data.corrections)
    force, _ = on_rows(frame, flights)
    time = frame.time
    problem = Problem(
        frame=frame.with_mechanisms([GivenColumns()]),
        records=data.records,
        force=force,
        rows=WhitenedRows(data.fitted, noise or first_noise(flights), unknown),
        baseline=model.columns,
        knots=default_knots(float(time.min()), float(time.max()), config.knot_count),
        max_terms=config.max_terms * len(flights),
        exact_terms=config.max_terms,
        given=dict(given or {}),
    )
    return problem if noise is not None else problem.under(raised_noise(problem.under(estimated_noise(problem))))


def with_efficiency(problem: Problem, fit: HypothesisFit) -> Problem:
    """The problem with the effective share of samples that a fit's residual shows."""
    return replace(problem, efficiency=problem.efficiency_of(fit.residual))


def left_by(problem: Problem, fit: HypothesisFit) -> Rows:
    """What a fit to the problem's own part leaves of rates (but for a constant a piece) and force (frame rows,)."""
    values, others = problem.solution(fit.frame, fit.columns)
    return problem.left(fit.frame, fit.columns, values, others)


def is_carried(problem: Problem, effect: str) -> bool:
    """Whether every fit holds the effect already, within its tolerance."""
    items = problem.rows.nuisances.items
    return any(items[k].name == effect for k in problem.rows.nuisances.bounded)


def left_without(problem: Problem, fit: HypothesisFit, effect: str) -> Rows:
    """What a fit leaves, as `left_by`, where an effect that every fit holds within its tolerance is held at zero."""
    items = problem.rows.nuisances.items
    others = np.array([item.present if item.name == effect else np.nan for item in items])
    return constrained(problem, fit.frame, fit.columns, np.full(len(fit.columns), np.nan), others).left


def increments(problem: Problem, others: FloatArray) -> dict[Regressor, float]:
    """What the baseline is more within its priors, as columns with their coefficients; `others` (unknowns,)."""
    always, items = TimeBasis("constant"), problem.rows.nuisances.items
    return {
        Regressor(item.name, item.component, (), always, item.units): float(value) * item.size
        for item, value in zip(items, others, strict=True)
        if item.name in TOLERATED
    }


@dataclass(frozen=True)
class Constrained:
    """Coefficients (columns,), their covariance (0 for those that were held), and what is left (frame rows,).

    `others` (unknowns,) are the nuisances.
    """

    values: FloatArray
    others: FloatArray
    covariance: FloatArray
    left: Rows


def constrained(
    problem: Problem, frame: RateFrame, columns: Sequence[Regressor], held: FloatArray, others: FloatArray
) -> Constrained:
    """Columns and nuisances fitted together, those held (columns,), (unknowns,) at their values; NaN where free."""
    constants = 2 * len(problem.rows.part.levels)
    fixed = np.concatenate([held, np.full(constants, np.nan), others])
    free, values = np.isnan(fixed), np.nan_to_num(fixed)
    design = problem.whole_design(frame, columns)
    response = problem.raw_response - design @ values
    values[free] = solve_scaled(design[:, free], response)
    error = problem.raw_response - design @ values
    covariance = np.zeros((fixed.size, fixed.size))
    covariance[np.ix_(free, free)] = covariance_of(
        design[:, free], error, problem.samples, problem.efficiency_of(error)
    )
    count = len(columns)
    found = values[count + constants :]
    left = problem.left(frame, columns, values[:count], found)
    return Constrained(values[:count], found, covariance[:count, :count], left)


def errors_beside(problem: Problem, fit: HypothesisFit) -> tuple[Errors, ...]:
    """What the errors of record and vehicle come to beside a fit, in SI: one mapping a flight."""
    _, others = problem.solution(fit.frame, fit.columns)
    return problem.rows.nuisances.values(others, len(problem.records))
