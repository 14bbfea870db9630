"""Method 3 with Section 3.2.3: gyros, accelerometers, initial conditions and gravity in one least-squares
problem.

Gyros carry the attitude; their white noise makes the apparent direction of the velocity a random walk. A
tie (normal force, static moment) sees the crossflow at each sample through a slowly varying, unknown slope.
Gravity, the errors of the record and the slope's coefficients are globals. The walk is linear, the globals
nearly: a few Gauss-Newton steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray
from brv_hypo.constants import (
    MOTION_LINEARISATIONS,
    MOTION_MOVED,
    MOTION_ROUGH,
    TIE_FORCE_ENOUGH,
    TIE_FORCE_FAR_LESS,
    TIE_FORCE_OUTLIER,
    TIE_MOMENT_ANOMALY,
    TIE_MOMENT_ROUNDS,
    TIE_MOMENT_SLOPE,
    TIE_MOMENT_UNCORRELATED,
    TIE_MOMENT_WINDOW_LEAST,
    TIE_MOMENT_WINDOWS,
    TIE_PATIENCE,
    TIE_ROUGH_SLOPE,
    TIE_SLOPE_COUNTS,
)
from brv_hypo.motion.config import ReconstructionConfig
from brv_hypo.motion.effect_responses import corrected, effect_responses, no_responses, telling
from brv_hypo.motion.inertial import InertialRecord, inertial_record
from brv_hypo.motion.inputs import with_smooth_air
from brv_hypo.motion.methods.observed_walk import Near, TiedFit, TiedWalk
from brv_hypo.motion.methods.wind_history import WindHistory
from brv_hypo.motion.observations import TieModel, force_tie, moment_tie
from brv_hypo.motion.perturbation import Perturbation


def joint(
    record: InertialRecord,
    config: ReconstructionConfig,
    perturbations: Sequence[Perturbation],
) -> WindHistory:
    """The default method; see the module's description.

    The errors of the record are linearised about the motion that is found without them. The air data are freed of noise
    first: as a factor of the normal force it would be in what the force is explained by.
    """
    record = replace(record, flight=with_smooth_air(record.flight))
    problem, near, left = TiedWalk(record, config, no_responses(record), np.zeros(0)), None, 1.0
    if perturbations:
        problem, near, left = _linearised(record, config, perturbations)
    fit, warnings = _fitted(problem, config, near, left)
    return _history(problem, fit, warnings)


def _linearised(
    record: InertialRecord,
    config: ReconstructionConfig,
    perturbations: Sequence[Perturbation],
) -> tuple[TiedWalk, Near, float]:
    """The problem with the record's errors, linearised where they are taken out; a rough fit, and what it leaves.

    The force counts for what the fit before leaves of it: were it believed to its noise from the start, errors of tens
    of tolerances would be asked of the record, from where no step leads back.
    """
    flight = record.flight
    fit = _rough_fit(TiedWalk(record, config, no_responses(record), np.zeros(0), MOTION_ROUGH), config, None)
    force, near = _normal_force(record, fit), fit.near
    del fit  # large, like the responses: only the last are kept
    responses = telling(effect_responses(record, near.crossflow, force, perturbations))
    known, left = np.zeros(len(responses.effects)), _left(record, force)
    for _ in range(MOTION_LINEARISATIONS):
        before, effects = near.crossflow, responses.effects
        fit = _rough_fit(TiedWalk(record, config, responses, known, MOTION_ROUGH), config, near, left)
        moved, near = _size(fit.crossflow - before) / _size(np.hypot(*fit.sigmas())), fit.near
        known = fit.effects.value
        record = inertial_record(corrected(flight, fit.effects), config)
        force = _normal_force(record, fit)
        left = _left(record, force)
        del fit, responses
        responses = effect_responses(record, near.crossflow, force, effects)
        if moved < MOTION_MOVED:
            break
    return TiedWalk(record, config, responses, known), near, left


def _rough_fit(
    problem: TiedWalk, config: ReconstructionConfig, near: Near | None, louder: float = 1.0
) -> TiedFit:
    """A fit with simple slopes, of the force alone where it says enough; the force's noise so many times as loud.

    What a force does that these do not would be asked of the record's errors, far beyond their tolerances.
    """
    record, responses = problem.record, problem.responses
    solve = problem.solve_from_scratch if near is None else partial(problem.solve, near=near)
    tie = force_tie(record, responses).with_slope_count(record.time, TIE_ROUGH_SLOPE)
    force = replace(tie, bends=True, sigma=louder * tie.sigma)
    moment = moment_tie(record, responses)
    moment = replace(moment, sigma=moment.sigma + TIE_MOMENT_ANOMALY * _rms(moment.observed, moment.sigma))
    if config.ties == "moment":
        return solve((moment,))
    fit = solve((force,))
    enough = _relative_error(fit, record.measured) < TIE_FORCE_ENOUGH
    return fit if enough else problem.solve_from_scratch((force, moment))


def _fitted(
    problem: TiedWalk, config: ReconstructionConfig, near: Near | None, left: float
) -> tuple[TiedFit, tuple[str, ...]]:
    """The fit with the ties that are wanted, or needed, and what is to be said of them."""
    record, responses = problem.record, problem.responses
    moment = moment_tie(record, responses)
    if config.ties == "moment":
        return _with_moment(problem, (), moment), ()
    fit = _with_force(problem, force_tie(record, responses), near, left)
    alone = _relative_error(fit, record.measured)
    too_little = config.ties == "auto" and alone > TIE_FORCE_ENOUGH
    if config.ties == "both" or too_little:
        fit = _with_moment(problem, fit.ties, moment)
    if not too_little:
        return fit, ()
    return fit, (
        f"the normal force alone knows alpha to {100.0 * alone:.0f} % of its rms; the static moment "
        "was used to tie the attitude to the wind as well. Better accelerometers or a window of "
        "higher dynamic pressure would do without it",
    )


def _normal_force(record: InertialRecord, fit: TiedFit) -> ComplexArray:
    """The transverse force (n,) m/s^2 that the fit makes of its crossflow; as measured where it has no slope."""
    for tie, coefficients in zip(fit.ties, fit.coefficients, strict=True):
        if tie.name == "force":
            return tie.tied(fit.crossflow, coefficients)
    return record.transverse_force


def _with_force(
    problem: TiedWalk, tie: TieModel, near: Near | None, left: float
) -> TiedFit:
    """Fit by the normal force: slope chosen by evidence, spikes left out, noise raised to left over, `left` times
    itself to begin with.
    """
    fit = _slope_under_noise(problem, tie, near, left)
    residual = fit.residual
    clean = np.abs(residual) <= TIE_FORCE_OUTLIER * np.sqrt(2.0) * tie.sigma * max(_misfit(residual, tie.sigma), 1.0)
    sigma = np.where(clean, tie.sigma, np.inf) * max(_misfit(residual[clean], tie.sigma[clean]), 1.0)
    return problem.solve((replace(fit.ties[-1], sigma=sigma),), fit.near)


def _slope_under_noise(problem: TiedWalk, tie: TieModel, near: Near | None, left: float) -> TiedFit:
    """The slope chosen under the noise that it leaves, which may be louder than that of neighbouring samples.

    It is chosen again where it leaves far less than was taken for noise.
    """
    while True:
        fit = _choose_slope(problem, (), replace(tie, sigma=left * tie.sigma), near)
        less = max(_misfit(fit.residual, tie.sigma), 1.0)
        if less > TIE_FORCE_FAR_LESS * left:
            return fit
        near, left = fit.near, less


def _with_moment(problem: TiedWalk, others: tuple[TieModel, ...], tie: TieModel) -> TiedFit:
    """Fit by the static moment too, its noise set so that anomalies count for what they are: not white."""
    tie = tie.with_slope_count(problem.record.time, TIE_MOMENT_SLOPE)
    tie = replace(tie, sigma=tie.sigma + TIE_MOMENT_ANOMALY * _rms(tie.observed, tie.sigma))
    fit = problem.solve_from_scratch((*others, tie))
    for _ in range(TIE_MOMENT_ROUNDS):
        tie = replace(tie, sigma=_coloured_sigma(fit.residual, tie.sigma))
        fit = problem.solve((*others, tie), fit.near)
    fit = _choose_slope(problem, others, tie, None)
    sigma = _coloured_sigma(fit.residual, tie.sigma)
    return problem.solve((*others, replace(fit.ties[-1], sigma=sigma)), fit.near)


def _choose_slope(
    problem: TiedWalk, others: tuple[TieModel, ...], tie: TieModel, near: Near | None
) -> TiedFit:
    """The slope's course in time, and whether it bends, by the Bayesian information criterion.

    (Schwarz, Ann. Stat. 6:461, 1978.) How well the crossflow is known is not told of it. Fits begin with the bend: what
    is left of one that lacks it is asked of the record's errors, from where no step leads back.
    """
    time, bends = problem.record.time, not tie.complex_slope
    first = (*others, replace(tie.with_slope_count(time, 1), bends=bends))
    best = problem.solve(first, near) if near else problem.solve_from_scratch(first)
    best, worse = replace(best, response=None), 0
    for count in TIE_SLOPE_COUNTS[1:]:
        ties = (*others, best.ties[-1].with_slope_count(time, count))
        fit = replace(problem.solve(ties, best.near), response=None)
        if fit.score < best.score:
            best, worse = fit, 0
        else:
            worse += 1
        if worse == TIE_PATIENCE:
            break
    return _straight(problem, best) if bends else best


def _straight(problem: TiedWalk, fit: TiedFit) -> TiedFit:
    """The fit with a force in proportion to alpha, where the same criterion has it so."""
    ties = (*fit.ties[:-1], replace(fit.ties[-1], bends=False))
    found = replace(problem.solve(ties, fit.near), response=None)
    return found if found.score < fit.score else fit


def _left(record: InertialRecord, force: ComplexArray) -> float:
    """What a normal force (n,) leaves of the measured one over its noise, at least 1."""
    return max(_misfit((record.transverse_force - force)[record.measured], record.force_sigma[record.measured]), 1.0)


def _misfit(residual: ComplexArray, sigma: FloatArray) -> float:
    """Residual over stated noise, by the median: spikes do not count."""
    seen = np.isfinite(sigma)
    return float(np.median(np.abs(residual[seen]) / sigma[seen]) / np.sqrt(2.0 * np.log(2.0)))


def _size(values: ComplexArray | FloatArray) -> float:
    return float(np.sqrt(np.mean(np.abs(values) ** 2)))


def _rms(values: ComplexArray, sigma: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.abs(values[np.isfinite(sigma)]) ** 2)))


def _coloured_sigma(residual: ComplexArray, sigma: FloatArray) -> FloatArray:
    """Sigma (n,) of white noise as informative as the residual: local rms times root of correlation time."""
    seen = np.isfinite(sigma)
    values = residual[seen]
    width = max(values.size // TIE_MOMENT_WINDOWS, TIE_MOMENT_WINDOW_LEAST)
    local = np.sqrt(
        np.convolve(
            np.pad(np.abs(values) ** 2 / 2.0, width, mode="reflect"),
            np.ones(2 * width + 1) / (2 * width + 1),
            "valid",
        )
    )
    spectrum = np.abs(np.fft.fft(values / local, 2 * values.size)) ** 2
    correlation = np.abs(np.fft.ifft(spectrum)[: values.size])
    first_low = int(np.argmax(correlation < TIE_MOMENT_UNCORRELATED * correlation[0]))
    samples = 1.0 + 2.0 * float(np.sum(correlation[1 : first_low + 1]) / correlation[0])
    answer = np.full(residual.size, np.inf)
    answer[seen] = local * np.sqrt(samples)
    return answer


def _relative_error(fit: TiedFit, measured: BoolArray) -> float:
    radial, _ = fit.sigmas()
    return _size(radial[measured]) / max(_size(fit.crossflow[measured]), 1e-150)


def _history(problem: TiedWalk, fit: TiedFit, warnings: tuple[str, ...]) -> WindHistory:
    radial, tangential = fit.sigmas()
    slope, terms, bend = np.full(fit.crossflow.size, np.nan), 0, 0.0
    accel_sigma = problem.record.accel_sigma
    for tie, coefficients in zip(fit.ties, fit.coefficients, strict=True):
        if tie.name == "force":
            slope, terms = tie.slope(coefficients).real, int(tie.slope_basis.shape[1])
            bend = tie.bend(coefficients)
            accel_sigma = float(np.median(tie.sigma[np.isfinite(tie.sigma)]))
    return WindHistory(
        record=problem.record,
        crossflow=fit.crossflow,
        radial_sigma=radial,
        tangential_sigma=tangential,
        gravity=fit.start.gravity,
        effects=fit.effects,
        normal_force_slope=slope,
        normal_force_terms=terms,
        normal_force_bend=bend,
        accel_sigma=accel_sigma,
        warnings=warnings,
    )
