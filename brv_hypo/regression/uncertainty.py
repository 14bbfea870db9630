"""The uncertainty of what a fit says: coefficients, delays and knots, and the moments of the design within priors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from brv_hypo.model.columns import Column
from brv_hypo.model.time_variation import TimeFunction
from brv_hypo.regression.fit import DesignMoment, HypothesisFit
from brv_hypo.regression.linear import covariance_of
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.refinement import prediction_slopes


def with_errors(problem: Problem, fit: HypothesisFit) -> HypothesisFit:
    """The fit with the uncertainty of all that it says, at the problem's effective sample size."""
    return with_design(problem, with_covariance(problem, fit))


def with_covariance(problem: Problem, fit: HypothesisFit) -> HypothesisFit:
    """The fit with the uncertainty of its coefficients, delays and knots, at the problem's effective sample size."""
    design = problem.design(fit.frame, fit.columns)
    if fit.nonlinear:
        slopes = prediction_slopes(fit.nonlinear, fit.columns, fit.values, fit.frame)
        design = np.column_stack([design, problem.rows.projected(problem.rows.of_moments(slopes))])
    covariance = covariance_of(design, fit.residual, problem.samples, problem.efficiency)
    return replace(fit, efficiency=problem.efficiency, joint_covariance=covariance)


def with_design(problem: Problem, fit: HypothesisFit) -> HypothesisFit:
    """The fit with the nuisances beside it, and of these the tolerated moments that all flights share."""
    items = problem.rows.nuisances.items
    _, others = problem.solution(fit.frame, fit.columns)
    fit = replace(fit, others=others)
    shared = [k for k, item in enumerate(items) if item.flight is None]
    if not shared:
        return fit
    always = TimeFunction("constant")
    columns = tuple(Column(items[k].name, items[k].component, (), always, items[k].units) for k in shared)
    sizes = np.array([items[k].size for k in shared])
    count = len(fit.columns)
    design = problem.whole_design(fit.frame, fit.columns)
    which = [*range(count), *(design.shape[1] - len(items) + k for k in shared)]
    whole = covariance_of(design, fit.residual, problem.samples, problem.efficiency)
    scale = np.append(np.ones(count), sizes)
    covariance = scale[:, None] * whole[np.ix_(which, which)] * scale
    return replace(fit, design=DesignMoment(columns, sizes * others[shared], covariance))
