"""From where the search ended to the result: errors, likelihood, innovations, and what cannot be trusted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.likelihood.colour import coloured_covariance, inflation
from brv_hypo.likelihood.filtering import kalman_innovations
from brv_hypo.likelihood.initial import by_initial_states, initial_state_errors, linearised
from brv_hypo.likelihood.noise import estimate_covariance, negative_log_likelihood
from brv_hypo.likelihood.result import FitResult
from brv_hypo.likelihood.search import Options, Outcome, residuals
from brv_hypo.likelihood.step import (
    Iterate,
    Problem,
    Sensitivity,
    SingularStatesError,
    information_factor,
    sensitivities,
)
from brv_hypo.likelihood.uncertainty import (
    covariance_from_information,
    identifiability,
    whiteness,
)

_LAGS = 20
"""Lags of the whiteness test."""


def assess(outcome: Outcome, options: Options) -> FitResult:
    """The result of a search; errors are nan where they cannot be had."""
    problem, iterate = outcome.problem, outcome.iterate
    parameters = problem.parameters
    innovations, nllf = _innovations(problem, iterate)
    together = np.concatenate(innovations, axis=1)
    seen = np.isfinite(together)
    samples = int(seen.sum())
    theta = parameters.as_mapping(iterate.theta)
    at_bound = (iterate.theta <= parameters.lower) | (iterate.theta >= parameters.upper)
    p = len(parameters.names)
    estimated = np.flatnonzero(~at_bound)
    triangle = np.full((p, p), np.nan)
    white = coloured = np.full((p, p), np.nan)
    try:
        segments = outcome.segments or sensitivities(problem, iterate)
    except SingularStatesError:
        segments = ()
    if segments:
        triangle = information_factor(problem, segments)[:p, :p]
        white, coloured = _covariances(problem, segments, triangle, samples, estimated, options)
    starts = by_initial_states(problem, iterate, segments)
    taken_out = _taken_out(samples, _unknowns(problem, estimated)) if options.estimate_noise else 1.0
    return FitResult(
        status=outcome.status,
        message=outcome.message,
        names=parameters.names,
        theta=theta,
        std_error=_by_name(parameters.names, white),
        std_error_coloured=_by_name(parameters.names, coloured),
        covariance=white,
        covariance_coloured=coloured,
        log_likelihood=-nllf,
        innovation_covariance=estimate_covariance(
            together, seen, options.noise, iterate.covariance, options.floor
        ),
        noise_covariance=iterate.covariance,
        process_noise=problem.process_noise,
        iterations=len(outcome.history),
        history=outcome.history,
        identifiability=identifiability(np.nan_to_num(triangle), parameters.prior_std, parameters.names),
        whiteness=whiteness(innovations, min(_LAGS, together.shape[1] // 4)),
        states=iterate.x,
        initial_state_std_error=initial_state_errors(problem, starts, segments, white, taken_out),
        innovations=innovations,
        at_bound=tuple(name for name, stuck in zip(parameters.names, at_bound, strict=True) if stuck),
        derivatives=problem.model.method,
        samples=samples,
        linear=linearised(problem, iterate, starts, segments, estimated),
    )


def _covariances(
    problem: Problem,
    segments: Sequence[Sensitivity],
    triangle: FloatArray,
    samples: int,
    estimated: IntArray,
    options: Options,
) -> tuple[FloatArray, FloatArray]:
    """Covariance for white residuals and corrected for coloured ones, (p, p); nan where they cannot be had.

    Both make up for what the fit took out of the residuals' variance, where the noise was estimated from
    them.
    """
    parameters = problem.parameters
    raw = covariance_from_information(triangle, parameters.prior_std, estimated)
    unknowns = _unknowns(problem, estimated)
    white = raw * (_taken_out(samples, unknowns) if options.estimate_noise else 1.0)
    known = np.flatnonzero(np.isfinite(np.diag(raw)))
    if np.any(problem.process_noise) or not known.size:
        return white, white
    block = np.ix_(known, known)
    sensitivity, residual = _whitened(problem, segments)
    prior = 1.0 / parameters.prior_std[known] ** 2
    corrected = coloured_covariance(raw[block], prior, [s[:, :, known] for s in sensitivity], residual)
    if options.estimate_noise:
        corrected = corrected * inflation(raw[block], corrected, unknowns, samples)
    coloured = np.full_like(raw, np.nan)
    coloured[block] = corrected
    return white, coloured


def _unknowns(problem: Problem, estimated: IntArray) -> int:
    """Parameters and free initial states."""
    return len(estimated) + sum(int(np.isinf(g.start_std).sum()) for g in problem.grids)


def _taken_out(samples: int, unknowns: int) -> float:
    """Factor for what fitting the unknowns took out of the variance of white residuals."""
    return samples / max(samples - unknowns, 1)


def _innovations(problem: Problem, iterate: Iterate) -> tuple[tuple[FloatArray, ...], float]:
    """Innovations by segment, and the NLLF of Eq. 3.10 (E8).

    With process noise they are the filter's, else the residuals.
    """
    if np.any(problem.process_noise):
        filtered = kalman_innovations(problem, iterate)
        return tuple(f.innovations for f in filtered), sum(f.nllf for f in filtered)
    found = residuals(problem, iterate)
    together = np.concatenate(found, axis=1)
    return found, negative_log_likelihood(together, np.isfinite(together), iterate.covariance)


def _whitened(problem: Problem, segments: Sequence[Sensitivity]) -> tuple[list[FloatArray], list[FloatArray]]:
    """Whitened sensitivities (n, n_outputs, p) and residuals (n, n_outputs) by segment."""
    p = len(problem.parameters.names)
    spread, residual = [], []
    for segment, index in zip(segments, problem.parameters.segment_index, strict=True):
        columns = np.zeros((*segment.residual.shape[:2], p))
        columns[:, :, index] = segment.residual[:, :, 1:]
        spread.append(columns)
        residual.append(segment.residual[:, :, 0])
    return spread, residual


def _by_name(names: Sequence[str], covariance: FloatArray) -> dict[str, float]:
    return dict(zip(names, np.sqrt(np.diag(covariance)).tolist(), strict=True))
