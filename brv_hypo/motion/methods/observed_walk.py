"""The Gauss-Newton problem of the joint method: nominal motion, random walk, globals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.motion.attitude import running_integral
from brv_hypo.motion.config import ReconstructionConfig
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.observations import TieModel, effective
from brv_hypo.motion.random_walk import GlobalPriors, Tie, WalkEquations, walk_equations
from brv_hypo.motion.wind import (
    FREE_GRAVITY,
    WindStart,
    body_crossflow,
    force_impulse,
    gravity_magnitude,
    start_from_nose,
    transverse_axes,
)

_MOST_STEPS = 15
# Largest change of the crossflow in the last step, as a share of its standard deviation given the globals.
_CONVERGED = 1e-2
# Possible sizes of the instruments' errors, as shares of the largest expected, and how likely each is.
_LEVELS = (1.0, 0.1, 0.01, 0.001)
_LEVEL_WEIGHTS = (0.2, 0.2, 0.2, 0.4)
# Three parts each of gravity and gyro bias, two of accelerometer bias.
_SHARED = 8


@dataclass(frozen=True)
class TiedFit:
    """A converged fit: where the nominal motion starts, what the ties' coefficients are, and the crossflow.

    `residual` (n,) is what is left of the last tie; `score` is the Bayesian information criterion.
    `response` (n, k) is the crossflow's change, in wind axes, per unit of each global; `wander` (n,) its
    standard deviation given the globals; `turn` (n,) the unit number from wind to body axes.
    """

    ties: tuple[TieModel, ...]
    start: WindStart
    coefficients: tuple[FloatArray, ...]
    crossflow: ComplexArray
    residual: ComplexArray
    covariance: FloatArray
    response: ComplexArray
    wander: FloatArray
    turn: ComplexArray
    score: float

    def sigmas(self) -> tuple[FloatArray, FloatArray]:
        """Standard deviations (n,) of the crossflow along itself and across itself."""
        along = self.crossflow / np.maximum(np.abs(self.crossflow), 1e-12)
        projected = self.response * (self.turn * np.conj(along))[:, None]
        radial = np.einsum("nk,kl,nl->n", projected.real, self.covariance, projected.real)
        tangential = np.einsum("nk,kl,nl->n", projected.imag, self.covariance, projected.imag)
        radial, tangential = (self.wander**2 + np.maximum(part, 0.0) for part in (radial, tangential))
        return np.sqrt(radial), np.sqrt(tangential)


class TiedWalk:
    """The problem of one record; its attributes are what stays the same over ties and iterations."""

    def __init__(self, record: InertialRecord, config: ReconstructionConfig) -> None:
        self.record = record
        flight = record.flight
        self.speed = flight.velocity
        self.gravity_size = config.gravity_magnitude or gravity_magnitude(flight)
        self.impulse = force_impulse(record)
        self.step_variance = _step_variance(record)
        size = self.gravity_size or FREE_GRAVITY
        biases = np.concatenate([np.full(3, config.gyro_bias_sigma), np.full(2, config.accel_bias_sigma)])
        self.prior_sigma = np.concatenate([np.full(3, size), np.maximum(biases, 1e-12)])
        nose_start = start_from_nose(record, self.gravity_size)
        self.nose_start = nose_start
        nominal = self.speed[:, None] * self.direction(nose_start)
        attitude = record.attitude
        gyro = [-np.cross(attitude[:, :, axis], nominal) for axis in range(3)]
        accel = [-attitude[:, :, axis] for axis in (1, 2)]
        self.bias_drift = running_integral(record.time, np.stack([*gyro, *accel], axis=2))

    def direction(self, start: WindStart) -> FloatArray:
        """Unit velocity (n, 3) in the axes of the first sample."""
        velocity = self.speed[0] * start.direction + self.impulse + self.record.time[:, None] * start.gravity
        return np.asarray(velocity / np.linalg.norm(velocity, axis=1, keepdims=True))

    def solve_from_scratch(self, ties: tuple[TieModel, ...]) -> TiedFit:
        """Fit from the nose's mean, and from the linear fit of the ties about it; the better of the two."""
        starts = [self.nose_start, *(s for tie in ties if (s := self._linear_start(tie)) is not None)]
        fits = [self._iterate(ties, start) for start in starts]
        return min(fits, key=lambda fit: fit.score)

    def solve(self, ties: tuple[TieModel, ...], near: TiedFit) -> TiedFit:
        """Fit from a fit that is near."""
        return self._iterate(ties, near.start, near.crossflow)

    def _linear_start(self, tie: TieModel) -> WindStart | None:
        """With offset x of the nominal direction, scale slope (xi + turn x): linear in slope and slope x."""
        direction = self.direction(self.nose_start)
        xi = body_crossflow(self.record, direction)
        turn = self._turn(direction)
        seen = np.isfinite(tie.sigma)
        weight = 1.0 / tie.sigma[seen]
        ones = np.ones_like(xi)
        columns = np.column_stack(
            [tie.scale * effective(xi), tie.scale * turn, tie.scale * turn * self.record.time, ones]
        )
        answer = np.linalg.lstsq(columns[seen] * weight[:, None], tie.observed[seen] * weight, rcond=None)[0]
        offset = answer[1] / answer[0] if answer[0] != 0.0 else np.inf
        if not abs(offset) < 0.5:
            return None
        return self._moved(self.nose_start, direction, offset, np.zeros(3))

    def _iterate(
        self, ties: tuple[TieModel, ...], start: WindStart, crossflow: ComplexArray | None = None
    ) -> TiedFit:
        """Gauss-Newton from a start, and a crossflow if one is known."""
        if crossflow is None:
            crossflow = body_crossflow(self.record, self.direction(start))
        coefficients: tuple[FloatArray, ...] = ()
        for _ in range(_MOST_STEPS):
            direction = self.direction(start)
            nominal, turn = body_crossflow(self.record, direction), self._turn(direction)
            xi = crossflow
            coefficients = coefficients or tuple(self._first_coefficients(tie, xi) for tie in ties)
            drift = self._drift(direction)
            equations = self._linear(ties, coefficients, xi, turn, (xi - nominal) * np.conj(turn), drift)
            solution = equations.solve(self._priors(ties, coefficients, start))
            shift = (solution.walk + drift @ solution.theta[:_SHARED]) / self.speed
            crossflow = np.asarray(nominal + turn * shift)
            start = self._moved(start, direction, solution.walk[0] / self.speed[0], solution.theta[:3])
            coefficients = _added(coefficients, solution.theta[_SHARED:])
            wander = np.sqrt(equations.walk_variance) / self.speed
            if np.all(np.abs(crossflow - xi) < _CONVERGED * wander):
                break
        response = equations.sensitivity.copy()
        response[:, :_SHARED] += drift
        seen = sum(2 * int(np.count_nonzero(np.isfinite(tie.sigma))) for tie in ties)
        return TiedFit(
            ties=ties,
            start=start,
            coefficients=coefficients,
            crossflow=crossflow,
            residual=equations.residual(len(ties) - 1, solution),
            covariance=solution.covariance,
            response=response / self.speed[:, None],
            wander=wander,
            turn=turn,
            score=solution.cost + sum(tie.unknowns for tie in ties) * float(np.log(seen)),
        )

    def _linear(
        self,
        ties: Sequence[TieModel],
        coefficients: Sequence[FloatArray],
        xi: ComplexArray,
        turn: ComplexArray,
        offset: ComplexArray,
        drift: ComplexArray,
    ) -> WalkEquations:
        """The linear problem about the crossflow `xi`, which lies `offset` from the nominal one in wind
        axes."""
        unknowns = [tie.unknowns for tie in ties]
        first = np.cumsum([_SHARED, *unknowns])
        rows = []
        for tie, values, at in zip(ties, coefficients, first, strict=False):
            own = tie.columns(xi)
            stretched = np.abs(effective(xi)) / np.maximum(np.abs(xi), 1e-12)
            slope = tie.scale * tie.slope(values) * stretched * turn
            gain = slope / self.speed
            columns = np.zeros((xi.size, first[-1]), dtype=complex)
            columns[:, :_SHARED] = gain[:, None] * drift
            if tie.accelerometers:
                columns[:, 6:8] += np.array([1.0, 1j])
            columns[:, at : at + tie.unknowns] = own
            rows.append(Tie(tie.observed - own @ values + slope * offset, gain, columns, tie.sigma))
        return walk_equations(rows, self.step_variance, (0.3 * self.speed[0]) ** 2)

    def _priors(
        self, ties: Sequence[TieModel], coefficients: Sequence[FloatArray], start: WindStart
    ) -> GlobalPriors:
        """Priors of the globals, counted from the nominal.

        How large the instruments' errors are is itself unknown: gyro bias, accelerometer bias and
        misalignment each may be any of `_LEVELS` of the largest expected, and are as likely negligible as
        not.
        """
        mean = -np.concatenate([start.gravity, np.zeros(_SHARED - 3), *coefficients])
        sigma = np.concatenate([self.prior_sigma, *(tie.prior_sigma() for tie in ties)])
        group = np.concatenate([np.repeat([0, 1, 2], [3, 3, 2]), *(3 * tie.is_error() for tie in ties)])
        chosen = list(product(range(len(_LEVELS)), repeat=int(group.max())))
        levels = np.array([[1.0, *(_LEVELS[i] for i in row)] for row in chosen])[:, group]
        log_weight = np.log([np.prod([_LEVEL_WEIGHTS[i] for i in row]) for row in chosen])
        return GlobalPriors(mean, 1.0 / (sigma * levels) ** 2, log_weight)

    def _drift(self, direction: FloatArray) -> ComplexArray:
        """Transverse velocity (n, 8) in wind axes per unit of gravity, gyro bias, accelerometer bias."""
        second, third = transverse_axes(direction)
        axes = second + 1j * third
        gravity = self.record.time[:, None] * axes
        return np.concatenate([gravity, np.einsum("ni,nij->nj", axes, self.bias_drift)], axis=1)

    def _turn(self, direction: FloatArray) -> ComplexArray:
        """Unit number (n,) that turns a transverse pair from wind axes into body axes."""
        second, third = (self.record.to_body(axes) for axes in transverse_axes(direction))
        turn = second[:, 1] + 1j * second[:, 2] - 1j * (third[:, 1] + 1j * third[:, 2])
        return np.asarray(turn / np.maximum(np.abs(turn), 1e-12))

    def _first_coefficients(self, tie: TieModel, xi: ComplexArray) -> FloatArray:
        """Coefficients that fit the observation about the crossflow as it stands."""
        seen = np.isfinite(tie.sigma)
        weight = 1.0 / tie.sigma[seen]
        columns = tie.columns(xi)[seen] * weight[:, None]
        right = tie.observed[seen] * weight
        stacked = np.concatenate([columns.real, columns.imag])
        return np.asarray(np.linalg.lstsq(stacked, np.concatenate([right.real, right.imag]), rcond=None)[0])

    def _moved(
        self, start: WindStart, direction: FloatArray, offset: complex, gravity: FloatArray
    ) -> WindStart:
        second, third = transverse_axes(direction[:1])
        moved = start.direction + second[0] * offset.real + third[0] * offset.imag
        return WindStart(moved / np.linalg.norm(moved), start.gravity + gravity)


def _added(coefficients: tuple[FloatArray, ...], step: FloatArray) -> tuple[FloatArray, ...]:
    ends = np.cumsum([values.size for values in coefficients])[:-1]
    return tuple(old + new for old, new in zip(coefficients, np.split(step, ends), strict=True))


def _step_variance(record: InertialRecord) -> FloatArray:
    """Variance (n - 1,) (m/s)^2 per part of the walk's steps: instruments' noise, and what gaps hide."""
    step = record.flight.step
    speed = 0.5 * (record.flight.velocity[1:] + record.flight.velocity[:-1])
    variance = (speed * record.gyro_sigma * step) ** 2 + (record.accel_sigma * step) ** 2
    hidden = ~(record.measured[1:] & record.measured[:-1])
    rate = float(np.sqrt(np.mean(np.abs(record.transverse_rate[record.measured]) ** 2)))
    length = max(int(np.count_nonzero(hidden)), 1) * step
    return np.asarray(np.where(hidden, variance + (speed * rate) ** 2 * length * step, variance))
