"""Coefficients of the final model with their errors, and the static slope that they make by Mach number."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.constants import STABLE_SIGMAS
from brv_hypo.inference.derivatives import Derivative, along_flight
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.mechanisms.yaml_mechanism import YamlMechanism
from brv_hypo.model.term import Regressor, Theta, TimeBasis
from brv_hypo.motion.motion import Motion
from brv_hypo.regression.fit import fit_hypothesis
from brv_hypo.regression.linear import covariance_of, solve_scaled
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.reduced import Reduced
from brv_hypo.regression.refinement import FINAL, nonlinear_parameters, prediction_slopes, refine
from brv_hypo.residuals.baseline import TOLERATED
from brv_hypo.residuals.candidates_at_step import Analysis
from brv_hypo.residuals.linearisation import Corrected
from brv_hypo.residuals.problem import with_efficiency

# ---- The model's coefficients on the whole record, and how well they are known ----


def placed_by_the_whole(here: Analysis) -> Analysis:
    """The look with delays and knots where the whole record has them: the sizes that go with them are of all of it."""
    columns, frame = here.null.columns, here.null.frame
    problem = with_efficiency(here.problem, here.null).on(here.data.whole)
    nonlinear = nonlinear_parameters(columns, 0, frame, problem.knots)
    if not nonlinear:
        return here
    reduced = Reduced(replace(problem, baseline=()), frame)
    found = refine(columns, nonlinear, frozenset(), reduced, steps=FINAL).columns
    problem = replace(here.problem, baseline=found)
    return replace(here, problem=problem, null=fit_hypothesis(problem, "none", ()))


def whole_fit(here: Analysis) -> tuple[FloatArray, FloatArray]:
    """Coefficients and nuisances on the whole record, constants of integration left out, and their covariance.

    Delays and knots are as uncertain as the record leaves them.
    """
    problem = with_efficiency(here.problem, here.null).on(here.data.whole)
    design, response = problem.whole_design(here.null.frame, here.null.columns), problem.raw_response
    values = solve_scaled(design, response)
    left = response - design @ values
    covariance = covariance_of(_with_slopes(problem, here, values, design), left, problem.samples, problem.efficiency)
    count, constants = len(here.null.columns), 2 * len(problem.rows.part.levels)
    kept = np.r_[:count, count + constants : values.size]
    return values[kept], covariance[np.ix_(kept, kept)]


def _with_slopes(problem: Problem, here: Analysis, values: FloatArray, design: FloatArray) -> FloatArray:
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


def coefficients_of(here: Analysis) -> Coefficients:
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
        (*columns, *more), scale * values[chosen], covariance[np.ix_(chosen, chosen)] * np.outer(scale, scale)
    )


# What a static moment may be a function of.
_FLOW = ("time", "alpha", "velocity", "dynamic_pressure", "mach", "log_reynolds")
# Differences of the angle of attack, rad: the moment of a power of it is linear over less than 1e-7 of itself.
_STEP = 1e-4


def static_slopes(data: Corrected, found: Coefficients) -> tuple[Derivative, ...]:
    """Of each flight, what its wind-fixed terms make of dC_N'/d alpha, at no angle of attack and at that flown."""
    return tuple(_of_flight(data, found, number) for number in range(len(data.reconstructions)))


def _of_flight(data: Corrected, found: Coefficients, number: int) -> Derivative:
    motion = data.reconstructions[number].motion
    return along_flight(
        motion,
        number,
        lambda alpha, places: _with_error(slopes_at(data, motion, found.columns, number, alpha)[places], found),
    )


def slopes_at(
    data: Corrected, motion: Motion, columns: Sequence[Regressor], number: int, alpha: FloatArray
) -> FloatArray:
    """d C_N'/d alpha (n, columns) per unit of each coefficient about angles of attack (n,) rad."""
    out = np.zeros((motion.time.size, len(columns)))
    more, less = (replace(motion, alpha=alpha + side * _STEP, history=None) for side in (1.0, 0.0))
    known: dict[tuple[str, Theta], dict[str, FloatArray]] = {}
    for j, column in enumerate(columns):
        mechanism, key = data.frame.mechanisms[column.mechanism], (column.mechanism, column.theta)
        if not (column.acts_on(number) and _is_static(mechanism)):
            continue
        if key not in known:
            ends = (mechanism.terms(each, dict(column.theta)) for each in (more, less))
            known[key] = {high.name: (high.in_plane - low.in_plane) / _STEP for high, low in zip(*ends, strict=True)}
        out[:, j] = known[key][column.term] * column.time_basis(motion.coefficient_time)
    return out


def _is_static(mechanism: Mechanism) -> bool:
    """Whether its moment lies in the plane of alpha, and is one of the angle of attack and the flow alone."""
    if not isinstance(mechanism, YamlMechanism):
        return mechanism.wind_fixed
    return all(
        term.axis == "in_plane" and not (term.turn or term.delay) and all(f.of in _FLOW for f in term.factors)
        for term in mechanism.definition
    )


def _with_error(slopes: FloatArray, found: Coefficients) -> tuple[FloatArray, FloatArray]:
    """Slopes (places, columns) with the coefficients found, and their standard errors."""
    variance = np.einsum("nj,jk,nk->n", slopes, found.covariance, slopes)
    return slopes @ found.values, np.sqrt(np.maximum(variance, 0.0))


def stability_in_words(slopes: Sequence[Derivative], moment: str = "static moment", doubt: bool = True) -> str:
    """Where a flight's moment at zero alpha is unstable, or, with `doubt`, not significantly stable; else empty."""
    return " ".join(filter(None, (_of_one(each, _whose(each, slopes, moment), doubt) for each in slopes)))


def _whose(slope: Derivative, slopes: Sequence[Derivative], moment: str) -> str:
    return f"{moment} of flight {slope.flight + 1}" if len(slopes) > 1 else moment


def _of_one(slope: Derivative, moment: str, doubt: bool) -> str:
    values, errors = np.array(slope.at_zero), np.array(slope.at_zero_std_error)
    doubtful = np.flatnonzero(values + (STABLE_SIGMAS if doubt else -STABLE_SIGMAS) * errors >= 0.0)
    if doubtful.size == 0:
        return ""
    runs = np.split(doubtful, np.flatnonzero(np.diff(doubtful) > 1) + 1)
    worst = int(doubtful[np.argmax((values / np.maximum(errors, 1e-300))[doubtful])])
    unstable = values[worst] > STABLE_SIGMAS * errors[worst]
    said = "is unstable" if unstable else "is not significantly stable"
    return (
        f"At alpha = 0 the {moment} {said} {' and '.join(_when(slope, run) for run in runs)}: "
        f"{values[worst]:.2g} ± {errors[worst]:.1g} per rad at {slope.time_s[worst]:.0f} s, and "
        f"{slope.at_flown[worst]:.2g} ± {slope.at_flown_std_error[worst]:.1g} at the "
        f"{np.degrees(slope.alpha_rad[worst]):.2g} deg flown there."
    )


def _when(slope: Derivative, run: IntArray) -> str:
    """Times and, where they are known, Mach numbers of neighbouring places."""
    first, last = int(run[0]), int(run[-1])
    mach = f" (Mach {slope.mach[first]:.3g} to {slope.mach[last]:.3g})" if np.isfinite(slope.mach[first]) else ""
    return f"from {slope.time_s[first]:.4g} to {slope.time_s[last]:.4g} s{mach}"
