"""The model's coefficients on the whole record, and how well they are known."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.model.term import Regressor, TimeBasis
from brv_hypo.regression.fit import fit_hypothesis
from brv_hypo.regression.linear import covariance_of, solve_scaled
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.reduced import Reduced
from brv_hypo.regression.refinement import SETTLED, nonlinear_parameters, prediction_slopes, refine
from brv_hypo.residuals.baseline import TOLERATED
from brv_hypo.residuals.candidates_at_step import Look
from brv_hypo.residuals.problem import with_efficiency


def placed_by_the_whole(here: Look) -> Look:
    """The look with delays and knots where the whole record has them: the sizes that go with them are of all of it."""
    columns, frame = here.null.columns, here.null.frame
    problem = with_efficiency(here.problem, here.null).on(here.seen.whole)
    nonlinear = nonlinear_parameters(columns, 0, frame, problem.knots)
    if not nonlinear:
        return here
    reduced = Reduced(replace(problem, baseline=()), frame)
    found = refine(columns, nonlinear, frozenset(), reduced, steps=SETTLED).columns
    problem = replace(here.problem, baseline=found)
    return replace(here, problem=problem, null=fit_hypothesis(problem, "none", ()))


def whole_fit(here: Look) -> tuple[FloatArray, FloatArray]:
    """Coefficients and nuisances on the whole record, constants of integration left out, and their covariance.

    Delays and knots are as uncertain as the record leaves them.
    """
    problem = with_efficiency(here.problem, here.null).on(here.seen.whole)
    design, response = problem.whole_design(here.null.frame, here.null.columns), problem.raw_response
    values = solve_scaled(design, response)
    left = response - design @ values
    covariance = covariance_of(_with_slopes(problem, here, values, design), left, problem.samples, problem.efficiency)
    count, constants = len(here.null.columns), 2 * len(problem.rows.part.levels)
    kept = np.r_[:count, count + constants : values.size]
    return values[kept], covariance[np.ix_(kept, kept)]


def _with_slopes(problem: Problem, here: Look, values: FloatArray, design: FloatArray) -> FloatArray:
    """The design (rows, unknowns) with what delays and knots would change after it."""
    columns, frame = here.null.columns, here.null.frame
    nonlinear = nonlinear_parameters(columns, 0, frame, problem.knots)
    if not nonlinear:
        return design
    slopes = prediction_slopes(nonlinear, columns, values[: len(columns)], frame)
    return np.column_stack([design, problem.rows.of_moments(slopes)])


@dataclass(frozen=True)
class Coefficients:
    """Columns of moments with their coefficients (columns,) and these' covariance."""

    columns: tuple[Regressor, ...]
    values: FloatArray
    covariance: FloatArray


def coefficients_of(here: Look) -> Coefficients:
    """The model's columns, and what its baseline is more after them, which has a prior in the fit."""
    values, covariance = whole_fit(here)
    columns = here.null.columns
    count, always = len(columns), TimeBasis("constant")
    items = here.problem.rows.nuisances.items
    places = [k for k, item in enumerate(items) if item.name in TOLERATED]
    scale = np.array([*np.ones(count), *(items[k].size for k in places)])
    chosen = np.array([*range(count), *(count + k for k in places)], dtype=int)
    more = (Regressor(items[k].name, items[k].component, (), always, items[k].units) for k in places)
    return Coefficients(
        (*columns, *more),
        scale * values[chosen],
        covariance[np.ix_(chosen, chosen)] * np.outer(scale, scale),
    )
