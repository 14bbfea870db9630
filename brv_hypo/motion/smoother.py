"""Random-walk smoother with global parameters, and its Gauss-Newton iteration for the joint method.

Measurement k is   y = h_k z_k + A_k theta + noise,   z_k = z_(k-1) + step,

with noise and steps Gaussian and alike in both parts of the complex numbers. Given the globals theta the walk has a
tridiagonal information matrix, so that solution and covariance cost a time linear in n: the fixed-interval smoother
(Rauch, Tung and Striebel, AIAA J. 3:1445, 1965) in information form, `walk_equations`. In `RandomWalkSmoother` the
walk is the direction of the velocity as the gyros' white noise lets it drift; the globals are gravity, errors of the
record and coefficients of the measurement models.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky_banded
from scipy.linalg.lapack import dtbtrs

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.errors import UnanswerableError
from brv_hypo.motion.inertial import (
    FREE_GRAVITY,
    InertialRecord,
    WindStart,
    across_impulse,
    body_crossflow,
    direction_by_impulse,
    force_impulse,
    gravity_magnitude,
    start_from_nose,
    transverse_axes,
    wind_to_body,
)
from brv_hypo.motion.interpolation import blocks
from brv_hypo.motion.measurement import BENT, LocalScaling, MeasurementModel
from brv_hypo.motion.methods import ReconstructionConfig
from brv_hypo.motion.motion import effective, unit
from brv_hypo.motion.responses import EffectFit, EffectResponses, projected_variance
from brv_hypo.motion.signals import rms

MOTION_MOST_STEPS = 25  # Gauss-Newton steps; bounds the time where they do not settle
MOTION_CONVERGED = 1e-2  # of the crossflow's standard deviation given the globals, by which the last step changes it
MOTION_LEAST_RELAXED = 0.1  # of the share before, that is taken of a step
MOTION_FAR_START = 0.5  # of the speed: a start off the nose's mean by more is not tried
MOTION_START = 0.3  # of the speed, 1-sigma of the walk at the first sample


# Keeps unknowns that the data do not see from making the normal equations singular; they stay at zero.
_RIDGE = 1e-11
# All steps together vary by this share at least of the variance that the measurements leave of one level, which changes
# no answer: steps without noise, of rates that were computed, make the information singular in double precision.
_LEAST_STEP_VARIANCE = 1e-4


Columns = Callable[[slice], ComplexArray]
"""Makes rows of columns (n, k), which need not all exist at once."""


@dataclass(frozen=True)
class LinearMeasurement:
    """One observation at each of n samples."""

    residual: ComplexArray
    """(n,)"""
    gain: ComplexArray
    """h (n,)."""
    columns: Columns
    """A (n, k)."""
    sigma: FloatArray
    """Standard deviation (n,) of each part of the complex noise; inf where nothing is measured."""


@dataclass(frozen=True)
class WalkEquations:
    """The problem once the walk is eliminated: normal equations of the globals.

    `answer` (n, 2 k + 2): the walk at theta = 0 and less its change per unit of each global, real parts before
    imaginary ones; `walk_variance` (n,) per part, given the globals; `gram` (k + 1, k + 1): inner products of residual
    (first) and columns, whitened.
    """

    measurements: tuple[LinearMeasurement, ...]
    answer: FloatArray
    walk_variance: FloatArray
    gram: FloatArray

    def sensitivity(self, rows: slice = slice(None)) -> ComplexArray:
        """Change of the walk per unit of each global (rows, k)."""
        count = self.gram.shape[0]
        return np.asarray(-(self.answer[rows, 1:count] + 1j * self.answer[rows, count + 1 :]))

    def solve(self, mean: FloatArray, information: FloatArray) -> WalkSolution:
        """Walk and globals with Gaussian priors of the globals: mean (k,), information (k,), 0 where free."""
        normal = self.gram[1:, 1:] + np.diag(information)
        scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
        inverse = np.linalg.inv(normal * scale[:, None] * scale + _RIDGE * np.eye(mean.size))
        covariance = inverse * scale[:, None] * scale
        theta = covariance @ (self.gram[1:, 0] + information * mean)
        cost = self.gram[0, 0] - 2.0 * theta @ self.gram[1:, 0] + theta @ self.gram[1:, 1:] @ theta
        cost += float(information @ (theta - mean) ** 2)
        weights = np.append(1.0, -theta)
        walk = self.answer[:, : weights.size] @ weights + 1j * (self.answer[:, weights.size :] @ weights)
        return WalkSolution(walk, theta, covariance, float(cost))

    def residual(self, solution: WalkSolution) -> ComplexArray:
        """Residual (n,) of the last measurement."""
        last = self.measurements[-1]
        fitted = [last.columns(rows) @ solution.theta for rows in blocks(last.residual.size)]
        return np.asarray(last.residual - np.concatenate(fitted) - last.gain * solution.walk)


@dataclass(frozen=True)
class WalkSolution:
    """Walk (n,), globals (k,), their covariance (k, k), and minus twice the log of likelihood times prior."""

    walk: ComplexArray
    theta: FloatArray
    covariance: FloatArray
    cost: float


def walk_equations(
    measurements: Sequence[LinearMeasurement], step_variance: FloatArray, start_variance: float
) -> WalkEquations:
    """Eliminate the walk, which starts at 0 with `start_variance`; `step_variance` (n - 1,) per part."""
    n = measurements[0].residual.size
    information = np.zeros((2, n))
    information[1, 0] = 1.0 / start_variance
    for measurement in measurements:
        information[1] += np.abs(measurement.gain) ** 2 / measurement.sigma**2
    steps = 1.0 / np.maximum(step_variance, _LEAST_STEP_VARIANCE / (n * information[1].sum()))
    information[1, :-1] += steps
    information[1, 1:] += steps
    information[0, 1:] = -steps
    gram, projected = _normal_equations(measurements)
    factor = cholesky_banded(information)
    half, _ = dtbtrs(factor, projected, uplo="U", trans="T", overwrite_b=True)
    for part in (half[:, : gram.shape[0]], half[:, gram.shape[0] :]):
        gram -= part.T @ part
    answer, _ = dtbtrs(factor, half, uplo="U", overwrite_b=True)
    return WalkEquations(tuple(measurements), answer, _inverse_diagonal(information), gram)


def _normal_equations(measurements: Sequence[LinearMeasurement]) -> tuple[FloatArray, FloatArray]:
    """Inner products (k + 1, k + 1) of whitened residual and columns; their projection on the walk (n, 2 k + 2)."""
    n, count = measurements[0].residual.size, measurements[0].columns(slice(1)).shape[1] + 1
    gram, projected = np.zeros((count, count)), np.zeros((n, 2 * count), order="F")
    for measurement in measurements:
        gain = np.conj(measurement.gain) / measurement.sigma
        for rows in blocks(n):
            white = np.column_stack([measurement.residual[rows], measurement.columns(rows)])
            white /= measurement.sigma[rows, np.newaxis]
            both = np.concatenate([white.real, white.imag])
            gram += both.T @ both
            white *= gain[rows, np.newaxis]
            projected[rows, :count] += white.real
            projected[rows, count:] += white.imag
    return gram, projected


def _inverse_diagonal(band: FloatArray) -> FloatArray:
    """Diagonal of the inverse of a tridiagonal matrix: its pivots from both ends meet at each sample."""
    upward = cholesky_banded(band)[1] ** 2
    reverse = np.zeros_like(band)
    reverse[1], reverse[0, 1:] = band[1, ::-1], band[0, :0:-1]
    downward = cholesky_banded(reverse)[1, ::-1] ** 2
    return np.asarray(1.0 / (upward + downward - band[1]))


# ---- The Gauss-Newton problem of the joint method: nominal motion, random walk, globals ----


_Axes = tuple[FloatArray, FloatArray]
# Parts of gravity: they stand before the errors of the record among the globals.
_GRAVITY = 3


_RAN_AWAY = (
    "the attitude to the wind diverges from step to step instead of converging: forces and rates of this record do not "
    "belong to one motion. Likely causes: wrong axes, signs or units, or errors beyond all tolerance. See `brv-hypo "
    "inspect`, or take `--method rates`, which uses the gyros alone."
)


@dataclass(frozen=True)
class SmoothedMotion:
    """A converged fit."""

    measurements: tuple[MeasurementModel, ...]
    """What was fitted."""
    start: WindStart
    """Where the nominal motion starts."""
    coefficients: tuple[FloatArray, ...]
    """Those of each measurement (unknowns,)."""
    crossflow: ComplexArray
    """(n,)"""
    residual: ComplexArray
    """Of the last measurement (n,)."""
    covariance: FloatArray
    """Of the globals (k, k)."""
    effects: EffectFit
    """The estimated errors of the record."""
    response: Columns | None
    """Change of the crossflow (n, k), in wind axes, by each global; None where not needed, for it is large."""
    walk_sigma: FloatArray
    """Standard deviation (n,) of the crossflow given the globals."""
    turn: ComplexArray
    """Unit number (n,) from wind to body axes."""
    score: float
    """Bayesian information criterion."""

    @property
    def near(self) -> StartingPoint:
        """Where another fit may begin."""
        return StartingPoint(self.start, self.crossflow)

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


@dataclass(frozen=True)
class StartingPoint:
    """A start and a crossflow (n,) from which a fit may begin."""

    start: WindStart
    crossflow: ComplexArray


class RandomWalkSmoother:
    """The problem of one record; its attributes are what stays the same over measurements and iterations.

    `known` (k,) of the errors of the record are taken out of it already. Iterations also end where the
    crossflow changes by less than the share `rough` of its rms.
    """

    def __init__(
        self,
        record: InertialRecord,
        config: ReconstructionConfig,
        responses: EffectResponses,
        known: FloatArray,
        rough: float = 0.0,
    ) -> None:
        self.record = record
        self.known = known
        self.rough = rough
        self.responses = responses
        self.shared = _GRAVITY + len(responses.effects)
        flight = record.flight
        self.speed = flight.velocity
        self.gravity_size = config.gravity_magnitude or gravity_magnitude(flight)
        self.impulse = force_impulse(record)
        self.step_variance = _step_variance(record)
        size = self.gravity_size or FREE_GRAVITY
        self.gravity_information = 1.0 / size**2
        self.nose_start = start_from_nose(record, self.gravity_size)

    def direction(self, start: WindStart) -> FloatArray:
        """Unit velocity (n, 3) in the axes of the first sample."""
        return direction_by_impulse(self.record, start, self.impulse)

    def solve(self, measurements: tuple[MeasurementModel, ...], near: StartingPoint | None = None) -> SmoothedMotion:
        """Fit from a motion that is near; without one from the nose's mean, or better.

        The other starts are the linear fits of the measurements about that mean; the best of the fits counts.
        """
        if near is not None:
            return self._iterate(measurements, near.start, near.crossflow)
        starts = [self.nose_start, *map(self._linear_start, measurements)]
        fits = [self._iterate(measurements, start) for start in starts if start is not None]
        return min(fits, key=lambda fit: fit.score)

    def _linear_start(self, measurement: MeasurementModel) -> WindStart | None:
        """With offset x of the nominal direction, scale slope (xi + turn x): linear in slope and slope x."""
        direction = self.direction(self.nose_start)
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
        self, measurements: tuple[MeasurementModel, ...], start: WindStart, crossflow: ComplexArray | None = None
    ) -> SmoothedMotion:
        """Gauss-Newton from a start, and a crossflow if one is known; part of each step where steps overshoot."""
        if crossflow is None:
            crossflow = body_crossflow(self.record, self.direction(start))
        coefficients: tuple[FloatArray, ...] = ()
        share, last = 1.0, None
        equations: WalkEquations | None = None
        for _ in range(MOTION_MOST_STEPS):
            direction = self.direction(start)
            axes = transverse_axes(direction)
            nominal, turn = body_crossflow(self.record, direction), wind_to_body(self.record, direction)
            xi = crossflow
            coefficients = coefficients or tuple(_first_coefficients(each, xi) for each in measurements)
            drift = _Drift(self.record, self.responses, axes)
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
            start = _moved(start, axes, share * solution.walk[0] / self.speed[0], share * solution.theta[:_GRAVITY])
            ends = np.cumsum([values.size for values in coefficients])[:-1]
            steps = np.split(share * solution.theta[self.shared :], ends)
            coefficients = tuple(old + new for old, new in zip(coefficients, steps, strict=True))
            walk_sigma = np.sqrt(equations.walk_variance) / self.speed
            if np.all(np.abs(step) < np.maximum(MOTION_CONVERGED * walk_sigma, self.rough * rms(xi))):
                break
        assert equations is not None
        final = equations
        observations = sum(2 * int(np.count_nonzero(np.isfinite(each.sigma))) for each in measurements)
        errors = slice(_GRAVITY, self.shared)
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
        )

    def _linear(
        self,
        measurements: Sequence[MeasurementModel],
        coefficients: Sequence[FloatArray],
        xi: ComplexArray,
        turn: ComplexArray,
        offset: ComplexArray,
        drift: _Drift,
    ) -> tuple[WalkEquations, LocalScaling | None]:
        """The linear problem about the crossflow `xi`, which lies `offset` from the nominal one in wind axes.

        With it the scaling of the last measurement.
        """
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
                errors, shared = out[:, _GRAVITY : self.shared], out[:, : self.shared]
                measurement.add_effects(errors, rows, modelled)
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
        information[:_GRAVITY], information[_GRAVITY : self.shared] = self.gravity_information, 1.0
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


class _Drift:
    """Transverse velocity (n, 3 + errors) in wind axes per unit of gravity, and of each error's size.

    `responses` have the drift of the errors in the axes of the first sample. Gravity turns the velocity by what of it
    is across the velocity at each instant.
    """

    def __init__(self, record: InertialRecord, responses: EffectResponses, axes: _Axes) -> None:
        self._responses, self._axes = responses, axes
        identity = np.broadcast_to(np.eye(3), (record.time.size, 3, 3))
        self._fallen = across_impulse(np.cross(*axes), record.time[:, np.newaxis, np.newaxis] * identity)
        self._whole = self._of(slice(0, record.time.size)) if len(blocks(record.time.size)) == 1 else None

    def __getitem__(self, rows: slice) -> ComplexArray:
        return self._of(rows) if self._whole is None else self._whole[rows]

    def _of(self, rows: slice) -> ComplexArray:
        second, third = (axis[rows] for axis in self._axes)
        out = np.empty((second.shape[0], _GRAVITY + len(self._responses.effects)), dtype=complex)
        out[:, :_GRAVITY] = np.einsum("ni,nij->nj", second + 1j * third, self._fallen[rows])
        across = np.stack([second, third], axis=1) @ self._responses.rows.all_of(self._responses.drift, rows)
        np.negative(across[:, 0], out=out.real[:, _GRAVITY:])
        np.negative(across[:, 1], out=out.imag[:, _GRAVITY:])
        return out

    def of(self, unknowns: FloatArray) -> ComplexArray:
        """The velocity (n,) by parts of gravity and errors of these sizes (3 + errors,)."""
        of_errors = self._responses.rows.all_of(np.asarray(self._responses.drift @ unknowns[_GRAVITY:]))
        moved = self._fallen @ unknowns[:_GRAVITY] - of_errors
        second, third = (np.einsum("ni,ni->n", axis, moved) for axis in self._axes)
        return np.asarray(second + 1j * third)


def _moved(start: WindStart, axes: _Axes, offset: complex, gravity: FloatArray) -> WindStart:
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


def _step_variance(record: InertialRecord) -> FloatArray:
    """Variance (n - 1,) (m/s)^2 per part of the walk's steps: instruments' noise, and what gaps hide."""
    step = record.flight.step
    speed = 0.5 * (record.flight.velocity[1:] + record.flight.velocity[:-1])
    variance = (speed * record.gyro_sigma * step) ** 2 + (record.accel_sigma * step) ** 2
    hidden = ~(record.measured[1:] & record.measured[:-1])
    rate = float(np.sqrt(np.mean(np.abs(record.transverse_rate[record.measured]) ** 2)))
    length = max(int(np.count_nonzero(hidden)), 1) * step
    return np.asarray(np.where(hidden, variance + (speed * rate) ** 2 * length * step, variance))
