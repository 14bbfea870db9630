"""Method 3 with Section 3.2.3: gyros, accelerometers, start and gravity in one least-squares problem.

Gyros carry the attitude; their white noise makes the apparent direction of the velocity a random walk. A
measurement (normal force, static moment) gives the crossflow at each sample through a slowly varying, unknown slope.
Gravity, the errors of the record and the slope's coefficients are globals. The walk is linear, the globals
nearly: a few Gauss-Newton steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray
from brv_hypo.motion.inertial import InertialRecord, inertial_record
from brv_hypo.motion.measurement import MeasurementModel, force_measurement, moment_measurement
from brv_hypo.motion.methods import ReconstructionConfig
from brv_hypo.motion.reconstruction import WindHistory
from brv_hypo.motion.responses import Perturbation, corrected, effect_responses, no_responses, nonzero_responses
from brv_hypo.motion.signals import rms, with_smooth_air
from brv_hypo.motion.smoother import RandomWalkSmoother, SmoothedMotion, StartingPoint

ROUGH_SLOPE_COUNT = 3  # coefficients of the force's slope before it is chosen: a parabola
SLOPE_COUNTS = (1, 2, 3, 4, 6, 9, 13)  # coefficients of its basis in time that are tried, by BIC
SLOPE_PATIENCE = 2  # of these that may go by without a gain
MOMENT_SLOPE_COUNT = 4  # coefficients of the moment's slope while its noise is found
MOMENT_ANOMALY = 0.1  # of the moment's rms, that is taken for noise at first
MOMENT_NOISE_ROUNDS = 2  # of its noise
# Its noise is that of a twelfth of the record (at least so many samples) on either side, correlated to where the
# correlation has fallen to this.
MOMENT_WINDOWS = 12
MOMENT_WINDOW_LEAST = 8
MOMENT_UNCORRELATED = 0.1
FORCE_OUTLIER = 6.0  # standard deviations from which a force is a spike, far beyond Gaussian noise
FORCE_ENOUGH = 0.1  # of alpha's rms: the force alone is enough where alpha is then known to this
FORCE_FAR_LESS = 0.8  # of what was taken for noise: a slope that leaves less is chosen again
MOTION_ROUGH = 0.01  # of the crossflow's rms, to which the motion is found about which errors are linearised
# They are linearised anew about what was found of them, at most so often, and again where that had moved the
# crossflow by more than this share of its standard deviation.
MOTION_LINEARISATIONS = 6
MOTION_MOVED = 0.1


def joint(record: InertialRecord, config: ReconstructionConfig, perturbations: Sequence[Perturbation]) -> WindHistory:
    """The default method; see the module's description.

    The errors of the record are linearised about the motion that is found without them. The air data are freed of noise
    first: as a factor of the normal force it would be in what the force is explained by.
    """
    record = replace(record, flight=with_smooth_air(record.flight))
    problem, near, left = RandomWalkSmoother(record, config, no_responses(record), np.zeros(0)), None, 1.0
    if perturbations:
        problem, near, left = _linearised(record, config, perturbations)
    fit, warnings = _fitted(problem, config, near, left)
    return _history(problem, fit, warnings)


def _linearised(
    record: InertialRecord, config: ReconstructionConfig, perturbations: Sequence[Perturbation]
) -> tuple[RandomWalkSmoother, StartingPoint, float]:
    """The problem with the record's errors, linearised where they are taken out; a rough fit, and what it leaves.

    The noise of the force is that of the residual before: with its own noise from the start, errors of the record would
    be estimated at tens of tolerances, from where no step leads back.
    """
    flight = record.flight
    fit = _rough_fit(RandomWalkSmoother(record, config, no_responses(record), np.zeros(0), MOTION_ROUGH), config, None)
    force, near = _normal_force(record, fit), fit.near
    del fit  # large, like the responses: only the last are kept
    responses = nonzero_responses(effect_responses(record, near.crossflow, force, perturbations))
    known, left = np.zeros(len(responses.effects)), _left(record, force)
    for _ in range(MOTION_LINEARISATIONS):
        before, effects = near.crossflow, responses.effects
        fit = _rough_fit(RandomWalkSmoother(record, config, responses, known, MOTION_ROUGH), config, near, left)
        moved, near = rms(fit.crossflow - before) / rms(np.hypot(*fit.sigmas())), fit.near
        known = fit.effects.value
        record = inertial_record(corrected(flight, fit.effects), config)
        force = _normal_force(record, fit)
        left = _left(record, force)
        del fit, responses
        responses = effect_responses(record, near.crossflow, force, effects)
        if moved < MOTION_MOVED:
            break
    return RandomWalkSmoother(record, config, responses, known), near, left


def _rough_fit(
    problem: RandomWalkSmoother, config: ReconstructionConfig, near: StartingPoint | None, noise_factor: float = 1.0
) -> SmoothedMotion:
    """A fit with simple slopes, of the force alone where it says enough; the force's noise so many times as loud.

    What these slopes lack would go to the record's errors, far beyond their tolerances.
    """
    record, responses = problem.record, problem.responses
    measurement = force_measurement(record, responses).with_slope_count(record.time, ROUGH_SLOPE_COUNT)
    force = replace(measurement, bends=True, sigma=noise_factor * measurement.sigma)
    moment = _with_anomalies(moment_measurement(record, responses))
    if config.measurements == "moment":
        return problem.solve((moment,), near)
    fit = problem.solve((force,), near)
    enough = _relative_error(fit, record.measured) < FORCE_ENOUGH
    return fit if enough else problem.solve((force, moment))


def _fitted(
    problem: RandomWalkSmoother, config: ReconstructionConfig, near: StartingPoint | None, left: float
) -> tuple[SmoothedMotion, tuple[str, ...]]:
    """The fit with the measurements that are wanted, or needed, and warnings about them."""
    record, responses = problem.record, problem.responses
    moment = moment_measurement(record, responses)
    if config.measurements == "moment":
        return _with_moment(problem, (), moment), ()
    fit = _with_force(problem, force_measurement(record, responses), near, left)
    alone = _relative_error(fit, record.measured)
    too_little = config.measurements == "auto" and alone > FORCE_ENOUGH
    if config.measurements == "both" or too_little:
        fit = _with_moment(problem, fit.measurements, moment)
    if not too_little:
        return fit, ()
    return fit, (
        f"the normal force alone determines alpha to {100.0 * alone:.0f} % of its rms; the static moment "
        "was used to measure the attitude to the wind as well. Better accelerometers or a window of "
        "higher dynamic pressure would do without it",
    )


def _normal_force(record: InertialRecord, fit: SmoothedMotion) -> ComplexArray:
    """The transverse force (n,) m/s^2 that the fit makes of its crossflow; as measured where it has no slope."""
    for measurement, coefficients in zip(fit.measurements, fit.coefficients, strict=True):
        if measurement.name == "force":
            return measurement.modelled(fit.crossflow, coefficients)
    return record.transverse_force


def _with_force(
    problem: RandomWalkSmoother, measurement: MeasurementModel, near: StartingPoint | None, left: float
) -> SmoothedMotion:
    """Fit by the normal force: slope chosen by evidence, spikes left out, noise raised to left over, `left` times
    itself to begin with.
    """
    fit = _slope_under_noise(problem, measurement, near, left)
    residual = fit.residual
    clean = np.abs(residual) <= FORCE_OUTLIER * np.sqrt(2.0) * measurement.sigma * max(
        _misfit(residual, measurement.sigma), 1.0
    )
    sigma = np.where(clean, measurement.sigma, np.inf) * max(_misfit(residual[clean], measurement.sigma[clean]), 1.0)
    return problem.solve((replace(fit.measurements[-1], sigma=sigma),), fit.near)


def _slope_under_noise(
    problem: RandomWalkSmoother, measurement: MeasurementModel, near: StartingPoint | None, left: float
) -> SmoothedMotion:
    """The slope chosen under the noise that it leaves, which may be louder than that of neighbouring samples.

    It is chosen again where it leaves far less than was taken for noise.
    """
    while True:
        fit = _choose_slope(problem, (), replace(measurement, sigma=left * measurement.sigma), near)
        less = max(_misfit(fit.residual, measurement.sigma), 1.0)
        if less > FORCE_FAR_LESS * left:
            return fit
        near, left = fit.near, less


def _with_moment(
    problem: RandomWalkSmoother, others: tuple[MeasurementModel, ...], measurement: MeasurementModel
) -> SmoothedMotion:
    """Fit by the static moment too, its noise set so that anomalies count for what they are: not white."""
    measurement = measurement.with_slope_count(problem.record.time, MOMENT_SLOPE_COUNT)
    measurement = _with_anomalies(measurement)
    fit = problem.solve((*others, measurement))
    for _ in range(MOMENT_NOISE_ROUNDS):
        measurement = replace(measurement, sigma=_coloured_sigma(fit.residual, measurement.sigma))
        fit = problem.solve((*others, measurement), fit.near)
    fit = _choose_slope(problem, others, measurement, None)
    sigma = _coloured_sigma(fit.residual, measurement.sigma)
    return problem.solve((*others, replace(fit.measurements[-1], sigma=sigma)), fit.near)


def _with_anomalies(moment: MeasurementModel) -> MeasurementModel:
    """The measurement with a share of its rms as noise."""
    return replace(moment, sigma=moment.sigma + MOMENT_ANOMALY * rms(moment.observed[np.isfinite(moment.sigma)]))


def _choose_slope(
    problem: RandomWalkSmoother,
    others: tuple[MeasurementModel, ...],
    measurement: MeasurementModel,
    near: StartingPoint | None,
) -> SmoothedMotion:
    """The slope's basis in time, and whether it bends, by the Bayesian information criterion.

    (Schwarz, Ann. Stat. 6:461, 1978.) How well the crossflow is known does not enter. Fits begin with the bend: the
    residual of one that lacks it would go to the record's errors, from where no step leads back.
    """
    time, bends = problem.record.time, not measurement.complex_slope
    first = (*others, replace(measurement.with_slope_count(time, 1), bends=bends))
    best, worse = replace(problem.solve(first, near), response=None), 0
    for count in SLOPE_COUNTS[1:]:
        measurements = (*others, best.measurements[-1].with_slope_count(time, count))
        fit = replace(problem.solve(measurements, best.near), response=None)
        if fit.score < best.score:
            best, worse = fit, 0
        else:
            worse += 1
        if worse == SLOPE_PATIENCE:
            break
    if not bends:
        return best
    measurements = (*best.measurements[:-1], replace(best.measurements[-1], bends=False))
    straight = replace(problem.solve(measurements, best.near), response=None)
    return straight if straight.score < best.score else best


def _left(record: InertialRecord, force: ComplexArray) -> float:
    """What a normal force (n,) leaves of the measured one over its noise, at least 1."""
    return max(_misfit((record.transverse_force - force)[record.measured], record.force_sigma[record.measured]), 1.0)


def _misfit(residual: ComplexArray, sigma: FloatArray) -> float:
    """Residual over stated noise, by the median: spikes do not count."""
    valid = np.isfinite(sigma)
    return float(np.median(np.abs(residual[valid]) / sigma[valid]) / np.sqrt(2.0 * np.log(2.0)))


def _coloured_sigma(residual: ComplexArray, sigma: FloatArray) -> FloatArray:
    """Sigma (n,) of white noise as informative as the residual: local rms times root of correlation time."""
    valid = np.isfinite(sigma)
    values = residual[valid]
    width = max(values.size // MOMENT_WINDOWS, MOMENT_WINDOW_LEAST)
    squares, window = np.pad(np.abs(values) ** 2 / 2.0, width, mode="reflect"), np.ones(2 * width + 1) / (2 * width + 1)
    local = np.sqrt(np.convolve(squares, window, "valid"))
    spectrum = np.abs(np.fft.fft(values / local, 2 * values.size)) ** 2
    correlation = np.abs(np.fft.ifft(spectrum)[: values.size])
    first_low = int(np.argmax(correlation < MOMENT_UNCORRELATED * correlation[0]))
    samples = 1.0 + 2.0 * float(np.sum(correlation[1 : first_low + 1]) / correlation[0])
    answer = np.full(residual.size, np.inf)
    answer[valid] = local * np.sqrt(samples)
    return answer


def _relative_error(fit: SmoothedMotion, measured: BoolArray) -> float:
    radial, _ = fit.sigmas()
    return rms(radial[measured]) / max(rms(fit.crossflow[measured]), 1e-150)


def _history(problem: RandomWalkSmoother, fit: SmoothedMotion, warnings: tuple[str, ...]) -> WindHistory:
    radial, tangential = fit.sigmas()
    found = WindHistory(
        record=problem.record,
        crossflow=fit.crossflow,
        radial_sigma=radial,
        tangential_sigma=tangential,
        gravity=fit.start.gravity,
        normal_force_slope=np.full(fit.crossflow.size, np.nan),
        accel_sigma=problem.record.accel_sigma,
        effects=fit.effects,
        warnings=warnings,
    )
    for force, coefficients in zip(fit.measurements, fit.coefficients, strict=True):
        if force.name == "force":
            return replace(
                found,
                normal_force_slope=force.slope(coefficients).real,
                normal_force_bend=force.bend(coefficients),
                accel_sigma=float(np.median(force.sigma[np.isfinite(force.sigma)])),
            )
    return found


METHODS = (joint,)
