"""Method 3 with Section 3.2.3: gyros, accelerometers, start and gravity in one least-squares problem.

Gyros carry the attitude; their white noise makes the apparent direction of the velocity a random walk. A
measurement (normal force, static moment) gives the crossflow at each sample through a slowly varying, unknown slope.
Gravity, the errors of the record and the slope's coefficients are globals. The walk is linear, the globals
are not: damped Gauss-Newton steps. In `RandomWalkSmoother` the walk is the direction of the velocity as the noise of
the gyros lets it drift; the globals are its start, gravity, errors of the record and coefficients of measurements.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray
from brv_hypo.errors import UnanswerableError
from brv_hypo.motion import inertial, smoother
from brv_hypo.motion.inertial import InertialRecord, NominalMotion, WindStart
from brv_hypo.motion.interpolation import blocks
from brv_hypo.motion.methods import ReconstructionConfig
from brv_hypo.motion.motion import unit
from brv_hypo.motion.reconstruction import WindHistory
from brv_hypo.motion.responses import EffectFit, EffectResponses, Perturbation, effect_responses, projected_variance
from brv_hypo.motion.signals import rms, with_smooth_air
from brv_hypo.motion.smoother import Columns, LinearMeasurement, MeasurementModel, WalkEquations, WalkSolution
from brv_hypo.thresholds import FORCE_UNEXPLAINED

START_PARTS = 5  # unknowns before the errors of the record: direction and gravity at the first sample
MOTION_MOST_STEPS = 60  # of a search for the motion; bounds the time where it does not converge
# A search ends where a step would lower the cost by less, the square of what anything moves in standard deviations: at
# the end, for the motion about which errors are linearised, and where slopes are compared by their scores.
MOTION_CONVERGED = 1e-3
MOTION_ROUGH = 0.1
MOTION_COMPARED = 1.0
MOTION_DAMPING = 1e-4  # of what the measurements say of each global, by which a step that failed is damped first
MOTION_DAMPED = 10.0  # times as much damping after a step that failed, and as little after one that succeeded
MOTION_DAMPING_MOST = 1e6  # with which nothing moves
MOTION_TRUSTED = 0.25  # of the gain that was predicted: with less a step has failed, with all but this succeeded
ROUGH_SLOPE_COUNT = 3  # coefficients of the force's slope before it is chosen: a parabola
SLOPE_COUNTS = (1, 2, 3, 4, 6, 9, 13)  # coefficients of its basis in time that are tried, by BIC
SLOPE_PATIENCE = 2  # of these that may go by without a gain
MOMENT_SLOPE_COUNT = 4  # coefficients of the moment's slope while its noise is found
MOMENT_ANOMALY = 0.1  # of the moment's rms, that is taken for noise at first
MOMENT_NOISE_ROUNDS = 2  # of its noise
MOMENT_WINDOWS = 12  # its noise is that of this part of the record on either side
MOMENT_WINDOW_LEAST = 8  # samples of that part
MOMENT_UNCORRELATED = 0.1  # to which the noise's correlation falls within its correlation time
FORCE_OUTLIER = 6.0  # standard deviations from which a force is a spike, far beyond Gaussian noise
FORCE_ENOUGH = 0.1  # of alpha's rms: the force alone is enough where alpha is then known to this
FORCE_FAR_LESS = 0.8  # of what was taken for noise: a slope that leaves less is chosen again
WANDERS = 1.05  # residual of a force over its noise, from which the velocity is taken to wander
WANDER_STEP, WANDER_MOST = 16.0, 1e6  # factors of the walk's variance: from one to the next, and at most
MOTION_LINEARISATIONS = 6  # at most, of the errors of the record, each about what was found of them
MOTION_MOVED = 0.1  # of the crossflow's standard deviation, by which it moves: errors are linearised again

Measurements = tuple[MeasurementModel, ...]  # the normal force, and the static moment where that is too little
StartingPoint = tuple[WindStart, ComplexArray, FloatArray | None]  # a start, crossflow (n,) and errors beyond the known


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
    walk_covariance: FloatArray  # of the crossflow in wind axes given the globals (n, 2, 2)
    turn: ComplexArray  # unit number (n,) from wind to body axes
    score: float  # Bayesian information criterion
    converged: bool  # whether a further step would lower the cost by next to nothing

    @property
    def near(self) -> StartingPoint:
        """Where another fit may begin."""
        return self.start, self.crossflow, self.effects.value - self.effects.known

    @property
    def normal_force(self) -> ComplexArray:
        """The transverse force (n,) m/s^2 by the first measurement."""
        return self.measurements[0].modelled(self.crossflow, self.coefficients[0])

    def sigmas(self) -> tuple[FloatArray, FloatArray]:
        """Standard deviations (n,) of the crossflow along itself and across itself."""
        assert self.response is not None
        turned, sigma = self.turn * np.conj(unit(self.crossflow)), np.empty((2, self.turn.size))
        axes = np.array([[turned.real, -turned.imag], [turned.imag, turned.real]])
        for rows in blocks(turned.size):
            projected, walk = self.response(rows) * turned[rows, np.newaxis], self.walk_covariance[rows]
            for k, part in enumerate((projected.real, projected.imag)):
                given = np.einsum("in,nij,jn->n", axes[k, :, rows], walk, axes[k, :, rows])
                sigma[k, rows] = np.sqrt(given + projected_variance(part, self.covariance))
        return sigma[0], sigma[1]


@dataclass(frozen=True)
class _Point:
    """Where a search is: a nominal motion, and what is off it."""

    measurements: Measurements  # what is fitted
    nominal: NominalMotion
    walk: ComplexArray  # transverse velocity that noise makes, in wind axes (n,) m/s
    errors: FloatArray  # of the record beyond the known ones, in units of their sizes (e,)
    coefficients: tuple[FloatArray, ...]  # those of each measurement
    crossflow: ComplexArray  # (n,)
    scaled: Measurements  # under these errors
    columns: tuple[ComplexArray, ...]  # of their coefficients (n, unknowns)
    residuals: tuple[ComplexArray, ...]  # of each measurement (n,)


class RandomWalkSmoother:
    """The problem of one record; its attributes are what stays the same over measurements and iterations. `known` (k,)
    of the errors of the record are taken out of it already.
    """

    def __init__(
        self, record: InertialRecord, responses: EffectResponses | None = None, known: FloatArray | None = None
    ) -> None:
        self.record = record
        self.responses = EffectResponses.none(record) if responses is None else responses
        self.known = np.zeros(len(self.responses.effects)) if known is None else known
        self.shared = START_PARTS + len(self.responses.effects)
        self.speed = record.flight.velocity
        # Variance (n,) (m/s)^2 per part of the walk's steps from 0.
        step = record.flight.step
        speed = 0.5 * (self.speed[1:] + self.speed[:-1])
        variance = (speed * record.gyro_sigma * step) ** 2 + (record.accel_sigma * step) ** 2
        self.step_variance = np.append(variance[0], variance)
        # Variance (n,) rad^2 per part of the crossflow in gaps, of which the ends alone are known: a Brownian bridge.
        self.in_gaps = np.zeros(self.speed.size)
        rate = rms(record.transverse_rate[record.measured]) / np.sqrt(2.0)
        for gap in record.flight.gaps:
            share = np.linspace(0.0, 1.0, gap.stop - gap.start + 2)[1:-1]
            self.in_gaps[gap] = (rate * step * (gap.stop - gap.start)) ** 2 * share * (1.0 - share)
        self.nose_start = inertial.start_from_nose(record)

    def solve(
        self, measurements: Measurements, near: StartingPoint | None = None, enough: float = MOTION_CONVERGED
    ) -> SmoothedMotion:
        """Levenberg and Marquardt's search from a motion that is near; else from the nose's mean. (Marquardt, J. SIAM
        11:431, 1963.) A step that does not lower the cost is tried again with the globals kept nearer. The search ends
        where a whole step would lower the cost by less than `enough`.
        """
        start, crossflow, errors = near or (self.nose_start, None, None)
        errors = np.zeros(self.known.size) if errors is None else errors
        nominal, walk = NominalMotion(self.record, start), np.zeros_like(self.speed, dtype=complex)
        if crossflow is not None:
            off = crossflow - self._crossflow(nominal, walk, self._drift_by(errors))
            walk = off * np.conj(nominal.turn) * self.speed
        point, damping, converged = self._point(measurements, nominal, walk, errors), 0.0, False
        for _ in range(MOTION_MOST_STEPS):
            drift, prior = self._drift(point), self._prior(point)
            equations, step = self._linear(point, drift), (prior[0] - self._globals(point), prior[1])
            cost = self._cost(point, equations, *prior)
            solution = equations.solve(*step)
            if not np.isfinite(cost + solution.cost):
                raise UnanswerableError(
                    "forces and rates of this record do not belong to one motion: are axes, signs and units right?"
                    " See `brv-hypo inspect`, or take `--method rates`, which uses the gyros alone."
                )
            converged = cost - solution.cost < enough
            if converged:
                break
            gained = 0.0
            while gained <= 0.0 and damping < MOTION_DAMPING_MOST:
                damped = equations.solve(*step, damping) if damping > 0.0 else solution
                with np.errstate(over="ignore", invalid="ignore"):
                    moved = self._moved(point, damped)
                    change = cost - self._cost(moved, equations, *prior)
                gained = np.nan_to_num(change / (cost - damped.cost), nan=-1.0)
                if gained < MOTION_TRUSTED:
                    damping = max(damping * MOTION_DAMPED, MOTION_DAMPING)
            if gained <= 0.0:
                break
            point = moved
            if gained > 1.0 - MOTION_TRUSTED:
                damping = damping / MOTION_DAMPED if damping > MOTION_DAMPING else 0.0
        observations = sum(2 * int(np.count_nonzero(np.isfinite(each.sigma))) for each in measurements)
        own, value = slice(START_PARTS, self.shared), self.known + point.errors

        def response(rows: slice) -> ComplexArray:
            moved, out = drift(rows), equations.sensitivity(rows)
            out[:, : moved.shape[1]] += moved
            out /= self.speed[rows, np.newaxis]
            return out

        return SmoothedMotion(
            measurements=measurements,
            start=point.nominal.start,
            coefficients=point.coefficients,
            crossflow=point.crossflow,
            residual=point.residuals[-1],
            covariance=solution.covariance,
            effects=EffectFit(self.responses, self.known, value, solution.covariance[own, own]),
            response=response,
            walk_covariance=equations.walk_covariance / self.speed[:, np.newaxis, np.newaxis] ** 2
            + self.in_gaps[:, np.newaxis, np.newaxis] * np.eye(2),
            turn=point.nominal.turn,
            score=cost + sum(each.unknowns for each in measurements) * float(np.log(observations)),
            converged=converged,
        )

    def _point(
        self,
        measurements: Measurements,
        nominal: NominalMotion,
        walk: ComplexArray,
        errors: FloatArray,
        coefficients: tuple[FloatArray, ...] = (),
    ) -> _Point:
        """A motion with these coefficients; without any, with those that fit it best."""
        crossflow = self._crossflow(nominal, walk, self._drift_by(errors))
        coefficients = coefficients or tuple(_first_coefficients(each, crossflow) for each in measurements)
        scaled = tuple(each.with_errors(errors) for each in measurements)
        columns = tuple(each.columns(crossflow) for each in scaled)
        residuals = tuple(
            each.observed - own @ values - each.kept.all_of(np.asarray(each.effects @ errors))
            for each, own, values in zip(measurements, columns, coefficients, strict=True)
        )
        return _Point(measurements, nominal, walk, errors, coefficients, crossflow, scaled, columns, residuals)

    def _drift_by(self, errors: FloatArray) -> FloatArray:
        return self.responses.rows.all_of(np.asarray(self.responses.drift @ errors))

    def _crossflow(self, nominal: NominalMotion, walk: ComplexArray, drift: FloatArray) -> ComplexArray:
        return nominal.with_offset((walk + nominal.across(drift[:, :, np.newaxis])[:, 0]) / self.speed)

    def _moved(self, point: _Point, solution: WalkSolution) -> _Point:
        theta, ends = solution.theta, np.cumsum([values.size for values in point.coefficients])[:-1]
        steps = np.split(theta[self.shared :], ends)
        coefficients = tuple(old + new for old, new in zip(point.coefficients, steps, strict=True))
        start = point.nominal.start.moved(complex(*theta[:2]), theta[2:START_PARTS])
        errors = point.errors + theta[START_PARTS : self.shared]
        return self._point(point.measurements, NominalMotion(self.record, start), solution.walk, errors, coefficients)

    def _drift(self, point: _Point) -> Columns:
        """Transverse velocity (n, shared) m/s in wind axes by each global that is none of a measurement's."""
        nominal, responses, drift = point.nominal, self.responses, self._drift_by(point.errors)
        by_start = nominal.by_start(lambda moved: self._crossflow(moved, point.walk, drift))
        by_start *= (np.conj(nominal.turn) * self.speed)[:, np.newaxis]

        def rows_of(rows: slice) -> ComplexArray:
            own = nominal.across(responses.rows.all_of(responses.drift, rows), rows)
            return np.concatenate([by_start[rows], own], axis=1)

        if len(blocks(self.speed.size)) > 1:
            return rows_of
        columns = rows_of(slice(0, self.speed.size))
        return lambda rows: np.asarray(columns[rows])

    def _cost(self, point: _Point, equations: WalkEquations, mean: FloatArray, information: FloatArray) -> float:
        """Minus twice the log of likelihood times prior, with these priors; infinite where no flow can be."""
        if not np.max(np.abs(point.crossflow)) < 1.0:
            return np.inf
        steps = np.diff(point.walk, prepend=0.0)
        cost = float(equations.step_information @ (steps * np.conj(steps)).real)
        off = self._globals(point) - mean
        cost += float(off @ information @ off)
        for measurement, residual in zip(point.measurements, point.residuals, strict=True):
            cost += float(np.sum(np.abs(residual / measurement.sigma) ** 2))
        return cost

    def _linear(self, point: _Point, drift: Columns) -> WalkEquations:
        ends = np.cumsum([self.shared, *(measurement.unknowns for measurement in point.measurements)])
        xi, walk, found = point.crossflow, point.walk, list[LinearMeasurement]()

        def columns(first: int, own: ComplexArray, gain: ComplexArray, by_errors: Columns, rows: slice) -> ComplexArray:
            moved = drift(rows)
            out = np.zeros((moved.shape[0], int(ends[-1])), dtype=complex)
            out[:, START_PARTS : self.shared] = by_errors(rows)
            out[:, : self.shared] += gain[rows, :1] * moved.real + gain[rows, 1:] * moved.imag
            out[:, first : first + own.shape[1]] = own[rows]
            return out

        for k, measurement in enumerate(point.measurements):
            gain = point.scaled[k].gain(xi, point.coefficients[k], point.nominal.turn) / self.speed[:, np.newaxis]
            by_errors = partial(measurement.by_errors, measurement.modelled(xi, point.coefficients[k]))
            of_globals = partial(columns, int(ends[k]), point.columns[k], gain, by_errors)
            without_walk = point.residuals[k] + gain[:, 0] * walk.real + gain[:, 1] * walk.imag
            found.append(LinearMeasurement(without_walk, gain, of_globals, measurement.sigma))
        return smoother.walk_equations(found, self.step_variance)

    def _globals(self, point: _Point) -> FloatArray:
        """The globals at a point, from which a step counts them; no direction is likelier than another."""
        gravity, errors = point.nominal.start.gravity, self.known + point.errors
        return np.concatenate([np.zeros(2), gravity, errors, *point.coefficients])

    def _prior(self, point: _Point) -> tuple[FloatArray, FloatArray]:
        """Mean (k,) and information (k, k) of the globals, about a point."""
        mean, known = np.zeros((2, self._globals(point).size))
        known[START_PARTS : self.shared] = 1.0
        at = self.shared
        for measurement, values in zip(point.measurements, point.coefficients, strict=True):
            if measurement.bends:
                slope = float(np.mean(np.abs(measurement.slope(values))))
                known[at + measurement.slope_basis.shape[1]] = (smoother.BENT**2 / slope) ** 2
            at += measurement.unknowns
        information, gravity = np.diag(known), slice(2, START_PARTS)
        mean[gravity], information[gravity, gravity] = inertial.gravity_known(point.nominal)
        return mean, information


def _first_coefficients(measurement: MeasurementModel, xi: ComplexArray) -> FloatArray:
    """Coefficients that fit the observation about the present crossflow."""
    valid = np.isfinite(measurement.sigma)
    weight = 1.0 / measurement.sigma[valid]
    columns, right = measurement.columns(xi)[valid] * weight[:, None], measurement.observed[valid] * weight
    stacked = np.concatenate([columns.real, columns.imag])
    return np.asarray(np.linalg.lstsq(stacked, np.concatenate([right.real, right.imag]), rcond=None)[0])


# ---- The method: which measurements, with what slopes and noise ----


def joint(record: InertialRecord, config: ReconstructionConfig, perturbations: Sequence[Perturbation]) -> WindHistory:
    """The default method; see the module's description. The errors of the record are linearised about the motion that
    is found without them. The air data are freed of noise first: it is a factor of the normal force.
    """
    record = replace(record, flight=with_smooth_air(record.flight))
    problem, near, left, converged = RandomWalkSmoother(record), None, 1.0, True
    if perturbations:
        problem, near, left, converged = _linearised(record, config, perturbations)
    measurement = smoother.force_measurement(problem.record, problem.responses)
    fit, wander = _with_force(problem, measurement, near, left), 0.0
    measured, warnings = problem.record.measured, tuple[str, ...]()
    alone, residual = _relative_error(fit, measured), fit.residual[measured]
    share = rms(residual) / max(rms(problem.record.transverse_force[measured]), 1e-150)
    noise = _misfit(residual, problem.record.force_sigma[measured])
    if share >= FORCE_UNEXPLAINED[0] and noise >= FORCE_UNEXPLAINED[1]:
        warnings += (
            f"no motion by these gyros explains {100.0 * share:.0f} % of the transverse force (rms), {noise:.0f} times "
            "its noise: wrong units, axes or signs of gyros or accelerometers, or a wrong speed, are likely",
        )
    if alone > FORCE_ENOUGH:
        fit = _with_moment(problem, fit.measurements, smoother.moment_measurement(problem.record, problem.responses))
        warnings += (
            f"the normal force alone determines alpha to {100.0 * alone:.0f} % of its rms; the static moment measures "
            "the attitude to the wind as well",
        )
    else:
        wander = _wander(problem, fit, measurement.sigma)
    (radial, tangential), force, coefficients = fit.sigmas(), fit.measurements[0], fit.coefficients[0]
    return WindHistory(
        record=problem.record,
        crossflow=fit.crossflow,
        radial_sigma=radial,
        tangential_sigma=tangential,
        wander=wander,
        gravity=fit.start.gravity,
        normal_force_slope=force.slope(coefficients).real,
        normal_force_bend=force.bend(coefficients),
        accel_sigma=float(np.median(force.sigma[np.isfinite(force.sigma)])),
        effects=fit.effects,
        warnings=warnings,
        converged=fit.converged and converged,
    )


def _linearised(
    record: InertialRecord, config: ReconstructionConfig, perturbations: Sequence[Perturbation]
) -> tuple[RandomWalkSmoother, StartingPoint, float, bool]:
    """The problem with the record's errors, linearised where they are taken out; a rough fit, what it leaves, and
    whether it converged. The noise of the force is that of the residual before: with its own noise from the start,
    errors of the record would be estimated at tens of tolerances, from where no step leads back.
    """
    flight, problem = record.flight, RandomWalkSmoother(record)
    # Noise that is understated would pay for gravity of any size: at first it is the whole force.
    near, left, before = None, _left(record, np.zeros_like(record.transverse_force)), np.inf
    while left < FORCE_FAR_LESS * before:
        fit = _rough_fit(problem, near, left)
        force, near, before = fit.normal_force, (*fit.near[:2], None), left
        left = _left(record, force)
        del fit  # large, like the responses: only the last are kept
    assert near is not None
    responses = effect_responses(record, near[1], force, perturbations).nonzero()
    known = np.zeros(len(responses.effects))
    for _ in range(MOTION_LINEARISATIONS):
        old, effects = near[1], responses.effects
        fit = _rough_fit(RandomWalkSmoother(record, responses, known), near, left)
        moved, near = rms(fit.crossflow - old) / rms(np.hypot(*fit.sigmas())), (*fit.near[:2], None)
        known = fit.effects.value
        record = inertial.inertial_record(fit.effects.corrected(flight), config)
        force = fit.normal_force
        left, converged = _left(record, force), fit.converged
        del fit
        if moved < MOTION_MOVED:
            break
        del responses
        responses = effect_responses(record, near[1], force, effects)
    return RandomWalkSmoother(record, responses, known), near, left, converged


def _rough_fit(problem: RandomWalkSmoother, near: StartingPoint | None, noise_factor: float) -> SmoothedMotion:
    """A fit with simple slopes, of the force alone where it says enough; its noise larger by what slopes lack."""
    record, responses = problem.record, problem.responses
    measurement = smoother.force_measurement(record, responses).with_slope_count(record.time, ROUGH_SLOPE_COUNT)
    force = replace(measurement, bends=True, sigma=noise_factor * measurement.sigma)
    fit = problem.solve((force,), near, MOTION_ROUGH)
    if _relative_error(fit, record.measured) < FORCE_ENOUGH:
        return fit
    return problem.solve((force, _with_anomalies(smoother.moment_measurement(record, responses))), enough=MOTION_ROUGH)


def _with_force(
    problem: RandomWalkSmoother, measurement: MeasurementModel, near: StartingPoint | None, left: float
) -> SmoothedMotion:
    """Fit by the normal force: slope chosen by evidence, spikes left out, noise raised to what is left. The slope is
    chosen under the noise that it leaves, `left` times that of neighbouring samples to begin with, and again where it
    leaves far less than was taken for noise.
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


def _wander(problem: RandomWalkSmoother, fit: SmoothedMotion, sigma: FloatArray) -> float:
    """Rms of a component of the crossflow if what the force has beyond noise (n,) were wander of the velocity."""
    used, other, times = np.isfinite(fit.measurements[0].sigma), fit, 1.0
    measurement = replace(fit.measurements[0], sigma=np.where(used, sigma, np.inf))
    while _misfit(other.residual[used], sigma[used]) > WANDERS and times < WANDER_MOST:
        times *= WANDER_STEP
        wandering = copy(problem)
        wandering.step_variance = times * problem.step_variance
        other = wandering.solve((measurement,), other.near, MOTION_COMPARED)
    return rms((other.crossflow - fit.crossflow)[used]) / float(np.sqrt(2.0))


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
    """The slope's basis in time, and whether it bends, by the Bayesian information criterion. (Schwarz, Ann. Stat.
    6:461, 1978.) How well the crossflow is known does not enter. Fits begin with the bend: the residual of one that
    lacks it would go to the record's errors, from where no step leads back.
    """
    time, bends = problem.record.time, not measurement.complex_slope

    def fitted(last: MeasurementModel, near: StartingPoint | None) -> SmoothedMotion:
        return replace(problem.solve((*others, last), near, MOTION_COMPARED), response=None)

    best, worse = fitted(replace(measurement.with_slope_count(time, 1), bends=bends), near), 0
    for count in SLOPE_COUNTS[1:]:
        fit = fitted(best.measurements[-1].with_slope_count(time, count), near or best.near)
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
