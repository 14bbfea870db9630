"""How well the variances of filter error are known, and which of them went to 0."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.likelihood.joint_errors import with_unknown_variances
from brv_hypo.likelihood.scoring import Directions, marginals, score_of
from brv_hypo.likelihood.step import Iterate, Problem, Sensitivity


@dataclass(frozen=True)
class NoiseErrors:
    """Standard errors of the standard deviations, `process` (n_states,) per root second and `measurement`
    (n_outputs,); nan where they were given or vanished, and in output error. `covariance` (p, p) is that of theta, what
    not knowing the variances adds to it included. `remarks` name those that vanished.
    """

    process: FloatArray
    measurement: FloatArray
    covariance: FloatArray
    remarks: tuple[str, ...] = ()

    @classmethod
    def unknown(cls, problem: Problem, iterate: Iterate, covariance: FloatArray) -> NoiseErrors:
        """None, `covariance` as it is."""
        return cls(
            np.full(problem.process_noise.size, np.nan), np.full(iterate.covariance.shape[0], np.nan), covariance
        )


def noise_errors(
    problem: Problem,
    iterate: Iterate,
    directions: Directions,
    segments: Sequence[Sensitivity],
    covariance: FloatArray,
) -> NoiseErrors:
    """Errors from the expected Hessian; `covariance` (p, p) is that of theta with the variances as they are."""
    unknown = NoiseErrors.unknown(problem, iterate, covariance)
    process, measurement = unknown.process, unknown.measurement
    if not directions.count or not np.any(problem.process_noise):
        return unknown
    linear = marginals(problem, iterate)
    score = score_of(problem, iterate, directions, linear)
    if score is None:
        return unknown
    gone = score.vanished
    live = np.flatnonzero(~gone)
    spread = np.zeros((directions.count, directions.count))
    spread[np.ix_(live, live)] = np.linalg.pinv(score.information[np.ix_(live, live)], rcond=1e-12)
    driven = list(directions.driven)
    known = ~gone[: len(driven)]
    error = 0.5 * problem.process_noise[driven] * np.sqrt(np.maximum(np.diag(spread)[: len(driven)], 0.0))
    process[driven] = np.where(known, error, np.nan)
    if directions.entries:
        root = np.linalg.cholesky(iterate.covariance)
        twice = [1.0 if a == b else 2.0 for a, b in directions.entries]
        change = np.stack(
            [w * root[:, a] * root[:, b] for w, (a, b) in zip(twice, directions.entries, strict=True)], 1
        )
        variance = np.einsum("ij,jk,ik->i", change, spread[len(driven) :, len(driven) :], change)
        measurement = np.sqrt(np.maximum(variance, 0.0) / np.diag(iterate.covariance)) / 2.0
        measurement[measurement == 0.0] = np.nan
    if segments:
        covariance = with_unknown_variances(
            problem, iterate, directions, linear, segments, spread, covariance
        )
    return NoiseErrors(process, measurement, covariance, _remarks(directions, gone, _unseen(problem)))


def _unseen(problem: Problem) -> BoolArray:
    """Outputs that were never measured, (n_outputs,)."""
    return np.asarray(~np.any([grid.measured.any(axis=1) for grid in problem.grids], axis=0))


def _remarks(directions: Directions, gone: BoolArray, unseen: BoolArray) -> tuple[str, ...]:
    """What went to 0, by state and output; outputs that were never measured have no noise that could."""
    states = [state for state, lost in zip(directions.driven, gone, strict=False) if lost]
    lost = gone[len(directions.driven) :]
    outputs = [a for (a, b), each in zip(directions.entries, lost, strict=True) if each and a == b and not unseen[a]]
    found = []
    if states:
        found.append(
            f"the process noise of states {states} went to 0: their dynamics are exact as far as the data say. Leave "
            "it out (0 in process_noise), where the fit is also faster"
        )
    if outputs:
        found.append(
            f"the measurement noise of outputs {outputs} went to 0: process noise explains all that is left of them. "
            "Likely causes: sensors far better than the motion is smooth, or too slow a rate to tell the two apart. "
            "Give noise_covariance where it is known"
        )
    return tuple(found)
