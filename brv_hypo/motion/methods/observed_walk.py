"""The Gauss-Newton problem of the joint method: nominal motion, random walk, globals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.constants import (
    BENT,
    FREE_GRAVITY,
    MOTION_CONVERGED,
    MOTION_FAR_START,
    MOTION_LEAST_RELAXED,
    MOTION_MOST_STEPS,
    MOTION_START,
)
from brv_hypo.errors import UnanswerableError
from brv_hypo.motion.config import ReconstructionConfig
from brv_hypo.motion.effect_responses import EffectFit, EffectResponses, projected_variance
from brv_hypo.motion.frames import effective
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.kept_rows import blocks
from brv_hypo.motion.observations import Stretch, TieModel
from brv_hypo.motion.random_walk import Columns, Tie, WalkEquations, WalkSolution, walk_equations
from brv_hypo.motion.wind import (
    WindStart,
    across_impulse,
    body_crossflow,
    direction_by_impulse,
    force_impulse,
    gravity_magnitude,
    start_from_nose,
    transverse_axes,
)

_Axes = tuple[FloatArray, FloatArray]
# Parts of gravity: they stand before the errors of the record among the globals.
_GRAVITY = 3


_RAN_AWAY = (
    "the attitude to the wind runs away from step to step instead of settling: forces and rates of this record do not "
    "belong to one motion. Likely causes: wrong axes, signs or units, or errors beyond all tolerance. See `brv-hypo "
    "inspect`, or take `--method rates`, which uses the gyros alone."
)


@dataclass(frozen=True)
class TiedFit:
    """A converged fit: where the nominal motion starts, what the ties' coefficients are, and the crossflow.

    `residual` (n,) is what is left of the last tie; `score` is the Bayesian information criterion.
    `response` is the crossflow's change (n, k), in wind axes, per unit of each global; None where nobody will ask how
    well it is known, for it is large. `wander` (n,) is its
    standard deviation given the globals; `turn` (n,) the unit number from wind to body axes.
    """

    ties: tuple[TieModel, ...]
    start: WindStart
    coefficients: tuple[FloatArray, ...]
    crossflow: ComplexArray
    residual: ComplexArray
    covariance: FloatArray
    effects: EffectFit
    response: Columns | None
    wander: FloatArray
    turn: ComplexArray
    score: float

    @property
    def near(self) -> Near:
        """Where another fit may begin."""
        return Near(self.start, self.crossflow)

    def sigmas(self) -> tuple[FloatArray, FloatArray]:
        """Standard deviations (n,) of the crossflow along itself and across itself."""
        assert self.response is not None
        along = self.crossflow / np.maximum(np.abs(self.crossflow), 1e-12)
        turned = (self.turn * np.conj(along))[:, None]
        radial, tangential = np.empty((2, along.size))
        for rows in blocks(along.size):
            projected = self.response[rows] * turned[rows]
            for sigma, part in ((radial, projected.real), (tangential, projected.imag)):
                sigma[rows] = np.sqrt(self.wander[rows] ** 2 + projected_variance(part, self.covariance))
        return radial, tangential


@dataclass(frozen=True)
class Near:
    """A start and a crossflow (n,) from which a fit may begin."""

    start: WindStart
    crossflow: ComplexArray


class TiedWalk:
    """The problem of one record; its attributes are what stays the same over ties and iterations.

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

    def solve_from_scratch(self, ties: tuple[TieModel, ...]) -> TiedFit:
        """Fit from the nose's mean, and from the linear fit of the ties about it; the better of the two."""
        starts = [self.nose_start, *(s for tie in ties if (s := self._linear_start(tie)) is not None)]
        fits = [self._iterate(ties, start) for start in starts]
        return min(fits, key=lambda fit: fit.score)

    def solve(self, ties: tuple[TieModel, ...], near: Near) -> TiedFit:
        """Fit from one that is near."""
        return self._iterate(ties, near.start, near.crossflow)

    def _linear_start(self, tie: TieModel) -> WindStart | None:
        """With offset x of the nominal direction, scale slope (xi + turn x): linear in slope and slope x."""
        direction = self.direction(self.nose_start)
        xi = body_crossflow(self.record, direction)
        turn = self._turn(transverse_axes(direction))
        seen = np.isfinite(tie.sigma)
        weight = 1.0 / tie.sigma[seen]
        ones = np.ones_like(xi)
        columns = np.column_stack(
            [tie.scale * effective(xi), tie.scale * turn, tie.scale * turn * self.record.time, ones]
        )
        answer = np.linalg.lstsq(columns[seen] * weight[:, None], tie.observed[seen] * weight, rcond=None)[0]
        offset = answer[1] / answer[0] if answer[0] != 0.0 else np.inf
        if not abs(offset) < MOTION_FAR_START:
            return None
        return _moved(self.nose_start, transverse_axes(direction), offset, np.zeros(3))

    def _iterate(
        self, ties: tuple[TieModel, ...], start: WindStart, crossflow: ComplexArray | None = None
    ) -> TiedFit:
        """Gauss-Newton from a start, and a crossflow if one is known; part of each step where steps overshoot."""
        if crossflow is None:
            crossflow = body_crossflow(self.record, self.direction(start))
        coefficients: tuple[FloatArray, ...] = ()
        share, last = 1.0, None
        equations: WalkEquations | None = None
        for _ in range(MOTION_MOST_STEPS):
            direction = self.direction(start)
            axes = transverse_axes(direction)
            nominal, turn = body_crossflow(self.record, direction), self._turn(axes)
            xi = crossflow
            coefficients = coefficients or tuple(self._first_coefficients(tie, xi) for tie in ties)
            drift = _Drift(self.record, self.responses, axes)
            equations = None  # large, and about to be replaced
            equations = self._linear(ties, coefficients, xi, turn, (xi - nominal) * np.conj(turn), drift)
            solution = equations.solve(*self._priors(ties, coefficients, start))
            shift = (solution.walk + drift.of(solution.theta[: self.shared])) / self.speed
            step = nominal + turn * shift - xi
            if not np.all(np.isfinite(step)):
                raise UnanswerableError(_RAN_AWAY)
            share, last = share if last is None else relaxed(share, last, step), step
            crossflow = np.asarray(xi + share * step)
            start = _moved(
                start, axes, share * solution.walk[0] / self.speed[0], share * solution.theta[:_GRAVITY]
            )
            coefficients = _added(coefficients, share * solution.theta[self.shared :])
            wander = np.sqrt(equations.walk_variance) / self.speed
            if np.all(np.abs(step) < np.maximum(MOTION_CONVERGED * wander, self.rough * _rms(xi))):
                break
        assert equations is not None
        seen = sum(2 * int(np.count_nonzero(np.isfinite(tie.sigma))) for tie in ties)
        return TiedFit(
            ties=ties,
            start=start,
            coefficients=coefficients,
            crossflow=crossflow,
            residual=_unstretched(equations, solution),
            covariance=solution.covariance,
            effects=self._effects(solution),
            response=_Response(equations, drift, self.speed),
            wander=wander,
            turn=turn,
            score=solution.cost + sum(tie.unknowns for tie in ties) * float(np.log(seen)),
        )

    def _effects(self, solution: WalkSolution) -> EffectFit:
        errors = slice(_GRAVITY, self.shared)
        value = self.known + solution.theta[errors]
        return EffectFit(self.responses, self.known, value, solution.covariance[errors, errors])

    def _linear(
        self,
        ties: Sequence[TieModel],
        coefficients: Sequence[FloatArray],
        xi: ComplexArray,
        turn: ComplexArray,
        offset: ComplexArray,
        drift: _Drift,
    ) -> WalkEquations:
        """The linear problem about the crossflow `xi`, which lies `offset` from the nominal one in wind
        axes."""
        ends = np.cumsum([self.shared, *(tie.unknowns for tie in ties)])
        rows = []
        for tie, values, at in zip(ties, coefficients, ends, strict=False):
            own = tie.columns(xi)
            slope = tie.gain(xi, values) * turn
            gain = slope / self.speed
            stretch, residual, sigma = tie.stretch(xi, values), tie.observed - own @ values, tie.sigma
            if stretch is not None:
                residual, own, sigma = stretch.of(residual), stretch.of(own), sigma * stretch.noise
            columns = _TieColumns(tie, gain, drift, tie.tied(xi, values), own, int(at), int(ends[-1]), stretch)
            rows.append(Tie(residual + slope * offset, gain, columns, sigma))
        return walk_equations(rows, self.step_variance, (MOTION_START * self.speed[0]) ** 2)

    def _priors(
        self, ties: Sequence[TieModel], coefficients: Sequence[FloatArray], start: WindStart
    ) -> tuple[FloatArray, FloatArray]:
        """Mean and information of the globals, those of gravity and of the ties counted from the nominal."""
        mean = -np.concatenate([start.gravity, self.known, *coefficients])
        information = np.zeros(mean.size)
        information[:_GRAVITY], information[_GRAVITY : self.shared] = self.gravity_information, 1.0
        at = self.shared
        for tie, values in zip(ties, coefficients, strict=True):
            if tie.bends:
                slope = float(np.mean(np.abs(tie.slope(values))))
                information[at + tie.slope_basis.shape[1]] = (BENT**2 / slope) ** 2
            at += tie.unknowns
        return mean, information

    def _turn(self, axes: _Axes) -> ComplexArray:
        """Unit number (n,) that turns a transverse pair from wind axes into body axes."""
        second, third = (self.record.to_body(axis) for axis in axes)
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


@dataclass(frozen=True)
class _TieColumns:
    """Columns (n, size) of one tie: those of gravity and errors, and from `first` on the tie's `own` (n, unknowns).

    `gain` (n,) is what the tie sees of the velocity, through `stretch` where it has one; `tied` (n,) what it makes of
    the crossflow.
    """

    tie: TieModel
    gain: ComplexArray
    drift: _Drift
    tied: ComplexArray
    own: ComplexArray
    first: int
    size: int
    stretch: Stretch | None

    def __getitem__(self, rows: slice) -> ComplexArray:
        own, drift = self.own[rows], self.drift[rows]
        out = np.zeros((own.shape[0], self.size), dtype=complex)
        shared = drift.shape[1]
        self.tie.add_effects(out[:, _GRAVITY:shared], rows, self.tied)
        if self.stretch is not None:
            out[:, _GRAVITY:shared] = self.stretch.of(out[:, _GRAVITY:shared], rows)
        out[:, :shared] += self.gain[rows, np.newaxis] * drift
        out[:, self.first : self.first + own.shape[1]] = own
        return out


@dataclass(frozen=True)
class _Response:
    """Change of the crossflow (n, k), in wind axes, per unit of each global."""

    equations: WalkEquations
    drift: _Drift
    speed: FloatArray

    def __getitem__(self, rows: slice) -> ComplexArray:
        drift, out = self.drift[rows], self.equations.sensitivity(rows)
        out[:, : drift.shape[1]] += drift
        out /= self.speed[rows, np.newaxis]
        return out


def _unstretched(equations: WalkEquations, solution: WalkSolution) -> ComplexArray:
    """What is left of the last tie (n,), as it was observed."""
    last = len(equations.ties) - 1
    left, columns = equations.residual(last, solution), equations.ties[last].columns
    stretch = columns.stretch if isinstance(columns, _TieColumns) else None
    return left if stretch is None else stretch.back(left)


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


def _rms(xi: ComplexArray) -> float:
    return float(np.sqrt(np.mean(np.abs(xi) ** 2)))


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
