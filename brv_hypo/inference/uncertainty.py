"""What a regression says beside its coefficients: the moments of its residual, and the errors of what it found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray
from brv_hypo.inference.fit import HypothesisFit
from brv_hypo.inference.problem import Problem
from brv_hypo.inference.refinement import prediction_slopes
from brv_hypo.linearisation.frame import RateFrame
from brv_hypo.linearisation.linear import covariance_of
from brv_hypo.linearisation.nuisance import Errors
from brv_hypo.model.term import Regressor
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.signals import derivatives

# ---- Residual rates as moment coefficients: what a model leaves, in the terms in which it is told ----


@dataclass(frozen=True)
class ResidualMoments:
    """C_m + i C_n measured less modelled (rows, ...) of a frame, and on which rows it is usable.

    `noise` (rows,) is the standard deviation of C_m and of C_n that the gyros' noise makes of them, by their filter.
    """

    body: ComplexArray
    usable: BoolArray
    noise: FloatArray


def residual_moments(frame: RateFrame, records: Sequence[InertialRecord], rates: ComplexArray) -> ResidualMoments:
    """Moments from what a model leaves of the derolled rates, (rows,) rad/s, or several models (rows, models).

    The filter that differentiates the rates acts on measurement and model alike, so that it rounds no
    corner of the one that the other keeps.
    """
    body = np.zeros(rates.shape, dtype=complex)
    usable = np.zeros(rates.shape[0], dtype=bool)
    noise = np.full(rates.shape[0], np.inf)
    for segment, (a, b) in zip(frame.segments, frame.pieces, strict=True):
        record, rows = records[segment.flight], segment.rows
        spin = record.spin_rate
        if b - a <= 2 * spin.half_width:
            continue
        both = np.stack([rates[a:b].real.T, rates[a:b].imag.T])
        rate = derivatives(both, spin.order, spin.half_width, record.flight.step)
        body[a:b] = ((rate[0] + 1j * rate[1]) * (np.exp(-1j * record.spin_angle[rows]) / record.moment_scale[rows])).T
        usable[a:b] = (record.measured & spin.interior)[rows]
        noise[a:b] = (record.rate_noise / np.abs(record.moment_scale))[rows]
    return ResidualMoments(body, usable, noise)


def with_errors(problem: Problem, fit: HypothesisFit) -> HypothesisFit:
    """The fit with the uncertainty of coefficients, delays and knots at the problem's effective sample size."""
    design = problem.design(fit.frame, fit.columns)
    if fit.nonlinear:
        slopes = prediction_slopes(fit.nonlinear, fit.selected, fit.values[fit.baseline_size :], fit.frame)
        design = np.column_stack([design, problem.rows.projected(problem.rows.of_moments(slopes))])
    covariance = covariance_of(design, fit.residual, problem.samples, problem.efficiency)
    return with_others(problem, replace(fit, efficiency=problem.efficiency, joint_covariance=covariance))


def with_others(problem: Problem, fit: HypothesisFit) -> HypothesisFit:
    """The fit with the nuisances beside it."""
    return replace(fit, others=problem.others_beside(fit.frame, fit.columns, fit.values))


@dataclass(frozen=True)
class Regressed:
    """Errors of every flight: `applied` as corrections of its record before, `found` in all; one mapping each.

    `rates` (rows,) rad/s are the de-rolled rates as they follow from coefficients and errors; `free`, one a flight, are
    the errors that no tolerance bounds.
    """

    applied: tuple[Errors, ...]
    found: tuple[Errors, ...]
    rates: ComplexArray
    free: tuple[frozenset[tuple[str, str]], ...]

    @classmethod
    def of(
        cls, problem: Problem, frame: RateFrame, columns: Sequence[Regressor], values: FloatArray, others: FloatArray
    ) -> Regressed:
        """What a fit of these columns with `values` and nuisances `others` (unknowns,) says."""
        nuisances, flights = problem.rows.nuisances, len(problem.records)
        return cls(
            nuisances.values(np.zeros(others.size), flights),
            nuisances.values(others, flights),
            problem.frame.observed - problem.left(frame, columns, values, others).rates,
            (frozenset(),) * flights,
        )

    def beside(self, held: Sequence[Errors]) -> Regressed:
        """With errors, one mapping a flight, that a model holds: its records are without them, and they are free."""
        applied, found = (
            tuple({**own, **{key: own.get(key, 0.0) + value for key, value in more.items()}} for own, more in pairs)
            for pairs in (zip(each, held, strict=True) for each in (self.applied, self.found))
        )
        return replace(self, applied=applied, found=found, free=tuple(map(frozenset, held)))
