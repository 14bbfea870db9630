"""Method 3 with Section 3.2.3: gyros, accelerometers, start and gravity in one least-squares problem.

Gyros carry the attitude; their white noise makes the apparent direction of the velocity a random walk. A
measurement (normal force, static moment) gives the crossflow at each sample through a slowly varying, unknown slope.
Gravity, the errors of the record and the slope's coefficients are globals. The walk is linear, the globals
nearly: a few Gauss-Newton steps. In `RandomWalkSmoother` the walk is the direction of the velocity as the gyros' white
noise lets it drift; the globals are gravity, errors of the record and coefficients of the measurement models.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray
from brv_hypo.errors import UnanswerableError
from brv_hypo.motion.inertial import (
    InertialRecord,
    WindStart,
    body_crossflow,
    gravity_size,
    inertial_record,
    start_from_nose,
    transverse_axes,
    wind_direction,
    wind_to_body,
)
from brv_hypo.motion.interpolation import blocks
from brv_hypo.motion.methods import ReconstructionConfig
from brv_hypo.motion.motion import effective, unit
from brv_hypo.motion.reconstruction import NOT_CONVERGED, WindHistory
from brv_hypo.motion.responses import (
    GRAVITY_PARTS,
    Axes,
    Drift,
    EffectFit,
    EffectResponses,
    Perturbation,
    corrected,
    effect_responses,
    no_responses,
    nonzero_responses,
    projected_variance,
)
from brv_hypo.motion.signals import rms, with_smooth_air
from brv_hypo.motion.smoother import (
    BENT,
    Columns,
    LinearMeasurement,
    LocalScaling,
    MeasurementModel,
    WalkEquations,
    force_measurement,
    moment_measurement,
    walk_equations,
)

MOTION_MOST_STEPS = 25  # Gauss-Newton steps; bounds the time where they do not settle
MOTION_CONVERGED = 1e-2  # of the crossflow's standard deviation given the globals, by which the last step changes it
MOTION_LEAST_RELAXED = 0.1  # of the share before, that is taken of a step
MOTION_FAR_START = 0.5  # of the speed: a start off the nose's mean by more is not tried
MOTION_START = 0.3  # of the speed, 1-sigma of the walk at the first sample
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

_RAN_AWAY = (
    "the attitude to the wind diverges from step to step instead of converging: forces and rates of this record do not "
    "belong to one motion. Likely causes: wrong axes, signs or units, or errors beyond all tolerance. See `brv-hypo "
    "inspect`, or take `--method rates`, which uses the gyros alone."
)

Measurements = tuple[MeasurementModel, ...]  # the normal force, and the static moment where that is too little
StartingPoint = tuple[WindStart, ComplexArray]  # a start and a crossflow (n,) from which a fit may begin


@dataclass(frozen=True)
class SmoothedMotion:
    """A fit."""

    measurements: Measurements  # what was fitted
    start: WindStart  # where the nominal motion starts
    coefficients: tuple[FloatArray, ...]  # those of each measurement (unknowns,)
    crossflow: ComplexArray  # (n,)
    residual: ComplexArray  # of the last measurement (n,)
    covariance: FloatArray  # of the globals (k, k)
    effects: EffectFit  # the estimated errors of the record
    # change of the crossflow (n, k), in wind axes, by each global; None where not needed, for it is large
    response: Columns | None
    walk_sigma: FloatArray  # standard deviation (n,) of the crossflow given the globals
    turn: ComplexArray  # unit number (n,) from wind to body axes
    score: float  # Bayesian information criterion
    converged: bool  # whether the last step was small enough

    @property
    def near(self) -> StartingPoint:
        """Where another fit may begin."""
        return self.start, self.crossflow

    @property
    def normal_force(self) -> ComplexArray:
        """The transverse force (n,) m/s^2 by the first measurement."""
        return self.measurements[0].modelled(self.crossflow, self.coefficients[0])

    def sigmas(self) -> tuple[FloatArray, FloatArray]:
        """Standard deviations (n,) of the crossflow along itself and across itself."""
        assert self.response is not None
        turned = (self.turn * np.conj(unit(self.crossflow)))[:, None]
        radial, tangential = np.empty((2, turned.size))
        for rows in blocks(turned.size):
            projected = self.response(rows) * turned[rows]
            for sigma, part in ((radial, projected.real), (tangential, projected.imag)):
                sigma[rows] = np.sqrt(self.walk_sigma[rows] ** 2 + projected_variance(part, self.covariance))
        return radial, tangential


class RandomWalkSmoother:
    """The problem of one record; its attributes are what stays the same over measurements and iterations.

    `known` (k,) of the errors of the record are taken out of it already. Iterations also end where the
    crossflow changes by less than the share `rough` of its rms.
    """

    def __init__(
        self,
        record: InertialRecord,
        responses: EffectResponses | None = None,
        known: FloatArray | None = None,
        rough: float = 0.0,
    ) -> None:
        self.record, self.rough = record, rough
        self.responses = no_responses(record) if responses is None else responses
        self.known = np.zeros(len(self.responses.effects)) if known is None else known
        self.shared = GRAVITY_PARTS + len(self.responses.effects)
        self.speed = record.flight.velocity
        # Variance (n - 1,) (m/s)^2 per part of the walk's steps: instruments' noise, and what gaps hide.
        step, measured = record.flight.step, record.measured
        speed = 0.5 * (self.speed[1:] + self.speed[:-1])
        variance = (speed * record.gyro_sigma * step) ** 2 + (record.accel_sigma * step) ** 2
        hidden = ~(measured[1:] & measured[:-1])
        rate = float(np.sqrt(np.mean(np.abs(record.transverse_rate[measured]) ** 2)))
        length = max(int(np.count_nonzero(hidden)), 1) * step
        self.step_variance = np.where(hidden, variance + (speed * rate) ** 2 * length * step, variance)
        self.nose_start = start_from_nose(record)

    def solve(self, measurements: Measurements, near: StartingPoint | None = None) -> SmoothedMotion:
        """Fit from a motion that is near; else the best from the nose's mean and from linear fits about that."""
        if near is not None:
            return self._iterate(measurements, *near)
        starts = [self.nose_start, *map(self._linear_start, measurements)]
        fits = [self._iterate(measurements, start) for start in starts if start is not None]
        return min(fits, key=lambda fit: fit.score)

    def _linear_start(self, measurement: MeasurementModel) -> WindStart | None:
        """With offset x of the nominal direction, scale slope (xi + turn x): linear in slope and slope x."""
        direction = wind_direction(self.record, self.nose_start)
        xi = body_crossflow(self.record, direction)
        turn = wind_to_body(self.record, direction)
        valid = np.isfinite(measurement.sigma)
        weight = 1.0 / measurement.sigma[valid]
        turned = measurement.scale * turn
        columns = np.column_stack(
            [measurement.scale * effective(xi), turned, turned * self.record.time, np.ones_like(xi)]
        )
        answer = np.linalg.lstsq(columns[valid] * weight[:, None], measurement.observed[valid] * weight, rcond=None)[0]
        offset = answer[1] / answer[0] if answer[0] != 0.0 else np.inf
        if not abs(offset) < MOTION_FAR_START:
            return None
        return _moved(self.nose_start, transverse_axes(direction), offset, np.zeros(3))

    def _iterate(
        self, measurements: Measurements, start: WindStart, crossflow: ComplexArray | None = None
    ) -> SmoothedMotion:
        """Gauss-Newton from a start, and a crossflow if one is known; part of each step where steps overshoot."""
        if crossflow is None:
            crossflow = body_crossflow(self.record, wind_direction(self.record, start))
        coefficients: tuple[FloatArray, ...] = ()
        share, last, equations, converged = 1.0, None, None, False
        for _ in range(MOTION_MOST_STEPS):
            direction = wind_direction(self.record, start)
            axes = transverse_axes(direction)
            nominal, turn = body_crossflow(self.record, direction), wind_to_body(self.record, direction)
            xi = crossflow
            coefficients = coefficients or tuple(_first_coefficients(each, xi) for each in measurements)
            drift = Drift(self.record, self.responses, axes)
            equations = None  # large, and about to be replaced
            offset = (xi - nominal) * np.conj(turn)
            equations, scaling = self._linear(measurements, coefficients, xi, turn, offset, drift)
            solution = equations.solve(*self._priors(measurements, coefficients, start))
            shift = (solution.walk + drift.of(solution.theta[: self.shared])) / self.speed
            step = nominal + turn * shift - xi
            if not np.all(np.isfinite(step)):
                raise UnanswerableError(_RAN_AWAY)
            share, last = share if last is None else relaxed(share, last, step), step
            crossflow = np.asarray(xi + share * step)
            gravity = share * solution.theta[:GRAVITY_PARTS]
            start = _moved(start, axes, share * solution.walk[0] / self.speed[0], gravity)
            ends = np.cumsum([values.size for values in coefficients])[:-1]
            steps = np.split(share * solution.theta[self.shared :], ends)
            coefficients = tuple(old + new for old, new in zip(coefficients, steps, strict=True))
            walk_sigma = np.sqrt(equations.walk_variance) / self.speed
            converged = bool(np.all(np.abs(step) < np.maximum(MOTION_CONVERGED * walk_sigma, self.rough * rms(xi))))
            if converged:
                break
        assert equations is not None
        final = equations
        observations = sum(2 * int(np.count_nonzero(np.isfinite(each.sigma))) for each in measurements)
        errors = slice(GRAVITY_PARTS, self.shared)
        left = equations.residual(solution)

        def response(rows: slice) -> ComplexArray:
            moved, out = drift[rows], final.sensitivity(rows)
            out[:, : moved.shape[1]] += moved
            out /= self.speed[rows, np.newaxis]
            return out

        value, covariance = self.known + solution.theta[errors], solution.covariance[errors, errors]
        return SmoothedMotion(
            measurements=measurements,
            start=start,
            coefficients=coefficients,
            crossflow=crossflow,
            residual=left if scaling is None else scaling.back(left),
            covariance=solution.covariance,
            effects=EffectFit(self.responses, self.known, value, covariance),
            response=response,
            walk_sigma=walk_sigma,
            turn=turn,
            score=solution.cost + sum(each.unknowns for each in measurements) * float(np.log(observations)),
            converged=converged,
        )

    def _linear(
        self,
        measurements: Sequence[MeasurementModel],
        coefficients: Sequence[FloatArray],
        xi: ComplexArray,
        turn: ComplexArray,
        offset: ComplexArray,
        drift: Drift,
    ) -> tuple[WalkEquations, LocalScaling | None]:
        """The linear problem about the crossflow `xi`, `offset` from the nominal one; the scaling of the last."""
        ends = np.cumsum([self.shared, *(measurement.unknowns for measurement in measurements)])

        def linear(
            measurement: MeasurementModel, values: FloatArray, first: int
        ) -> tuple[LinearMeasurement, LocalScaling | None]:
            own, sigma, modelled = measurement.columns(xi), measurement.sigma, measurement.modelled(xi, values)
            residual = measurement.observed - own @ values
            slope = measurement.gain(xi, values) * turn
            gain = slope / self.speed
            scaling = measurement.local_scaling(xi, values)
            if scaling is not None:
                residual, own, sigma = scaling.of(residual), scaling.of(own), sigma * scaling.noise

            def columns(rows: slice) -> ComplexArray:
                here, moved = own[rows], drift[rows]
                out = np.zeros((here.shape[0], int(ends[-1])), dtype=complex)
                errors, shared = out[:, GRAVITY_PARTS : self.shared], out[:, : self.shared]
                # What they add to the observation less what the model makes of it. An error of the scale is at every
                # crossflow what the slope would be: only its prior parts the two.
                errors += measurement.kept.all_of(measurement.effects, rows)
                if measurement.factors is not None:
                    errors -= measurement.kept.all_of(measurement.factors, rows) * modelled[rows, np.newaxis]
                if scaling is not None:
                    errors[:] = scaling.of(errors, rows)
                shared += gain[rows, np.newaxis] * moved
                out[:, first : first + here.shape[1]] = here
                return out

            return LinearMeasurement(residual + slope * offset, gain, columns, sigma), scaling

        each = [
            linear(measurement, values, int(first))
            for measurement, values, first in zip(measurements, coefficients, ends, strict=False)
        ]
        variance = (MOTION_START * self.speed[0]) ** 2
        return walk_equations([one for one, _ in each], self.step_variance, variance), each[-1][1]

    def _priors(
        self, measurements: Sequence[MeasurementModel], coefficients: Sequence[FloatArray], start: WindStart
    ) -> tuple[FloatArray, FloatArray]:
        """Mean and information of the globals, those of gravity and of the measurements counted from the nominal."""
        mean = -np.concatenate([start.gravity, self.known, *coefficients])
        information = np.zeros(mean.size)
        information[:GRAVITY_PARTS] = 1.0 / gravity_size(self.record.flight) ** 2
        information[GRAVITY_PARTS : self.shared] = 1.0
        at = self.shared
        for measurement, values in zip(measurements, coefficients, strict=True):
            if measurement.bends:
                slope = float(np.mean(np.abs(measurement.slope(values))))
                information[at + measurement.slope_basis.shape[1]] = (BENT**2 / slope) ** 2
            at += measurement.unknowns
        return mean, information


def _first_coefficients(measurement: MeasurementModel, xi: ComplexArray) -> FloatArray:
    """Coefficients that fit the observation about the crossflow as it stands."""
    valid = np.isfinite(measurement.sigma)
    weight = 1.0 / measurement.sigma[valid]
    columns = measurement.columns(xi)[valid] * weight[:, None]
    right = measurement.observed[valid] * weight
    stacked = np.concatenate([columns.real, columns.imag])
    return np.asarray(np.linalg.lstsq(stacked, np.concatenate([right.real, right.imag]), rcond=None)[0])


def _moved(start: WindStart, axes: Axes, offset: complex, gravity: FloatArray) -> WindStart:
    second, third = axes
    moved = start.direction + second[0] * offset.real + third[0] * offset.imag
    return WindStart(moved / np.linalg.norm(moved), start.gravity + gravity)


def relaxed(share: float, before: ComplexArray, step: ComplexArray) -> float:
    """The share of a step to take, from what the last share left of the last one.

    Aitken's relaxation of vectors (Irons and Tuck, Int. J. Numer. Meth. Eng. 1:275, 1969): where angles are large full
    steps overshoot, by much the same factor each time.
    """
    change = step - before
    fall = -float(np.vdot(change, before).real)
    return share * min(max(fall / max(float(np.vdot(change, change).real), 1e-300), MOTION_LEAST_RELAXED), 1.0 / share)


# ---- The method: which measurements, with what slopes and noise ----


def joint(record: InertialRecord, config: ReconstructionConfig, perturbations: Sequence[Perturbation]) -> WindHistory:
    """The default method; see the module's description.

    The errors of the record are linearised about the motion that is found without them. The air data are freed of noise
    first: as a factor of the normal force it would be in what the force is explained by.
    """
    record = replace(record, flight=with_smooth_air(record.flight))
    problem, near, left, converged = RandomWalkSmoother(record), None, 1.0, True
    if perturbations:
        problem, near, left, converged = _linearised(record, config, perturbations)
    fit = _with_force(problem, force_measurement(problem.record, problem.responses), near, left)
    alone = _relative_error(fit, problem.record.measured)
    warnings: tuple[str, ...] = ()
    if alone > FORCE_ENOUGH:
        fit = _with_moment(problem, fit.measurements, moment_measurement(problem.record, problem.responses))
        warnings = (
            f"the normal force alone determines alpha to {100.0 * alone:.0f} % of its rms; the static moment "
            "was used to measure the attitude to the wind as well. Better accelerometers or a window of "
            "higher dynamic pressure would do without it",
        )
    warnings = warnings if fit.converged and converged else (*warnings, NOT_CONVERGED)
    radial, tangential = fit.sigmas()
    force, coefficients = fit.measurements[0], fit.coefficients[0]
    return WindHistory(
        record=problem.record,
        crossflow=fit.crossflow,
        radial_sigma=radial,
        tangential_sigma=tangential,
        gravity=fit.start.gravity,
        normal_force_slope=force.slope(coefficients).real,
        normal_force_bend=force.bend(coefficients),
        accel_sigma=float(np.median(force.sigma[np.isfinite(force.sigma)])),
        effects=fit.effects,
        warnings=warnings,
    )


def _linearised(
    record: InertialRecord, config: ReconstructionConfig, perturbations: Sequence[Perturbation]
) -> tuple[RandomWalkSmoother, StartingPoint, float, bool]:
    """The problem with the record's errors, linearised where they are taken out; a rough fit, what it leaves, and
    whether it converged.

    The noise of the force is that of the residual before: with its own noise from the start, errors of the record would
    be estimated at tens of tolerances, from where no step leads back.
    """
    flight = record.flight
    fit = _rough_fit(RandomWalkSmoother(record, rough=MOTION_ROUGH), None)
    force, near = fit.normal_force, fit.near
    del fit  # large, like the responses: only the last are kept
    responses = nonzero_responses(effect_responses(record, near[1], force, perturbations))
    known, left = np.zeros(len(responses.effects)), _left(record, force)
    for _ in range(MOTION_LINEARISATIONS):
        before, effects = near[1], responses.effects
        fit = _rough_fit(RandomWalkSmoother(record, responses, known, MOTION_ROUGH), near, left)
        moved, near = rms(fit.crossflow - before) / rms(np.hypot(*fit.sigmas())), fit.near
        known = fit.effects.value
        record = inertial_record(corrected(flight, fit.effects), config)
        force = fit.normal_force
        left, converged = _left(record, force), fit.converged
        del fit, responses
        responses = effect_responses(record, near[1], force, effects)
        if moved < MOTION_MOVED:
            break
    return RandomWalkSmoother(record, responses, known), near, left, converged


def _rough_fit(problem: RandomWalkSmoother, near: StartingPoint | None, noise_factor: float = 1.0) -> SmoothedMotion:
    """A fit with simple slopes, of the force alone where it says enough; its noise louder, as what slopes lack is in
    it.
    """
    record, responses = problem.record, problem.responses
    measurement = force_measurement(record, responses).with_slope_count(record.time, ROUGH_SLOPE_COUNT)
    force = replace(measurement, bends=True, sigma=noise_factor * measurement.sigma)
    fit = problem.solve((force,), near)
    if _relative_error(fit, record.measured) < FORCE_ENOUGH:
        return fit
    return problem.solve((force, _with_anomalies(moment_measurement(record, responses))))


def _with_force(
    problem: RandomWalkSmoother, measurement: MeasurementModel, near: StartingPoint | None, left: float
) -> SmoothedMotion:
    """Fit by the normal force: slope chosen by evidence, spikes left out, noise raised to what is left.

    The slope is chosen under the noise that it leaves, `left` times that of neighbouring samples to begin with, and
    again where it leaves far less than was taken for noise.
    """
    while True:
        fit = _choose_slope(problem, (), replace(measurement, sigma=left * measurement.sigma), near)
        less = max(_misfit(fit.residual, measurement.sigma), 1.0)
        if less > FORCE_FAR_LESS * left:
            break
        near, left = fit.near, less
    residual = fit.residual
    clean = np.abs(residual) <= FORCE_OUTLIER * np.sqrt(2.0) * measurement.sigma * less
    sigma = np.where(clean, measurement.sigma, np.inf) * max(_misfit(residual[clean], measurement.sigma[clean]), 1.0)
    return problem.solve((replace(fit.measurements[-1], sigma=sigma),), fit.near)


def _with_moment(problem: RandomWalkSmoother, others: Measurements, measurement: MeasurementModel) -> SmoothedMotion:
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
    problem: RandomWalkSmoother, others: Measurements, measurement: MeasurementModel, near: StartingPoint | None
) -> SmoothedMotion:
    """The slope's basis in time, and whether it bends, by the Bayesian information criterion.

    (Schwarz, Ann. Stat. 6:461, 1978.) How well the crossflow is known does not enter. Fits begin with the bend: the
    residual of one that lacks it would go to the record's errors, from where no step leads back.
    """
    time, bends = problem.record.time, not measurement.complex_slope

    def fitted(last: MeasurementModel, near: StartingPoint | None) -> SmoothedMotion:
        return replace(problem.solve((*others, last), near), response=None)

    best, worse = fitted(replace(measurement.with_slope_count(time, 1), bends=bends), near), 0
    for count in SLOPE_COUNTS[1:]:
        fit = fitted(best.measurements[-1].with_slope_count(time, count), best.near)
        best, worse = (fit, 0) if fit.score < best.score else (best, worse + 1)
        if worse == SLOPE_PATIENCE:
            break
    if bends:
        straight = fitted(replace(best.measurements[-1], bends=False), best.near)
        best = straight if straight.score < best.score else best
    return best


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


METHODS = (joint,)
