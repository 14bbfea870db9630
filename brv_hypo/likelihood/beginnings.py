"""Several beginnings of one fit: a model that is not quite right has more than one optimum.

Which of them the search finds depends on the noise that it first believes, since that decides how closely the first
states follow the outputs. The likelihoods of the ends are compared, and a disagreement is said.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.noise import least_variance, noise_from_differences
from brv_hypo.likelihood.result import Beginning, FitResult

_SUSPECT = 1e-3
"""p-value of an output's whiteness below which a second beginning is worth its time."""
_APART = 1.0
"""Difference of log-likelihoods from which two ends are different optima."""
_LONGEST = 100_000
"""Samples up to which a second beginning is tried."""
_POOR = 3.0
"""Mean square of residuals over that of the known noise above which a second beginning is worth its time."""
_WINDOW = 9
"""Samples of the running mean whose residual is the third guess of the noise."""


@dataclass(frozen=True)
class FirstNoise:
    """A first guess of the noise covariance (n_outputs, n_outputs), and where it is from."""

    source: str
    covariance: FloatArray


def first_noises(y: FloatArray) -> tuple[FirstNoise, ...]:
    """Guesses from the outputs (n_outputs, n), nan in gaps; the smallest first, which is right for a right model."""
    floor = least_variance(y)
    variances = np.array([np.var(row[np.isfinite(row)]) if np.isfinite(row).any() else 1.0 for row in y])
    return (
        FirstNoise("differences of the outputs", noise_from_differences(y)),
        FirstNoise("residual of smoothed outputs", np.diag(np.maximum(_unsmooth(y), floor))),
        FirstNoise("variances of the outputs", np.diag(np.maximum(variances, floor))),
    )


def best_of(
    noises: Sequence[FirstNoise],
    run: Callable[[FloatArray], FitResult],
    samples: int,
    known: bool = False,
) -> FitResult:
    """The fit of the greatest likelihood; others than the first are tried where its residuals are not white, or, where
    the noise is `known`, far larger than it.
    """
    ends = [(noises[0].source, run(noises[0].covariance))]
    first = ends[0][1]
    sound = _as_small_as_known(first) if known else all(test.p_value >= _SUSPECT for test in first.whiteness)
    if not (first.converged and sound) and samples <= _LONGEST:
        ends += [(noise.source, run(noise.covariance)) for noise in noises[1:]]
    return chosen(ends)


def chosen(ends: Sequence[tuple[str, FitResult]]) -> FitResult:
    """The end of the greatest likelihood; among those as good as it, one that converged."""
    likelihoods = np.array([found.log_likelihood for _, found in ends])
    greatest = np.max(likelihoods, initial=-np.inf, where=np.isfinite(likelihoods))
    best = min(
        (found for (_, found), value in zip(ends, likelihoods, strict=True) if not value < greatest - _APART),
        key=lambda found: (not found.converged, -found.log_likelihood),
    )
    beginnings = tuple(Beginning(source, found.status, found.log_likelihood) for source, found in ends)
    apart = [each for each in beginnings if not each.log_likelihood >= greatest - _APART]
    message = best.message
    if apart:
        others = "; ".join(f"{b.log_likelihood:.6g} ({b.status}, from {b.source})" for b in apart)
        message += (
            f". Beginnings disagree: log-likelihood {best.log_likelihood:.6g} here, elsewhere {others}. The model has "
            "several optima on these data: compare their residuals, and start from values that are known"
        )
    return replace(best, message=message, beginnings=beginnings)


def _as_small_as_known(found: FitResult) -> bool:
    """Whether residuals are no larger than the noise that they are weighed by, or process noise explains them."""
    together = np.concatenate(found.innovations, axis=1)
    squares = np.nanmean(together**2, axis=1) / np.diag(found.noise_covariance)
    return bool(np.any(found.process_noise)) or not np.mean(squares) > _POOR


def _unsmooth(y: FloatArray) -> FloatArray:
    """Variance of each output about its running mean, (n_outputs,)."""
    found = np.zeros(len(y))
    for i, row in enumerate(y):
        seen = row[np.isfinite(row)]
        if seen.size >= _WINDOW:
            smooth = np.convolve(seen, np.full(_WINDOW, 1.0 / _WINDOW), mode="valid")
            found[i] = np.var(seen[_WINDOW // 2 : -(_WINDOW // 2)] - smooth)
    return found
