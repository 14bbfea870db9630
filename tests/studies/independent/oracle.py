"""What could be known from a flight at all: the true motion is given, the gyros' white noise is all that hides.

De-rolled transverse rates (q + i r) e^{i Phi}, Phi = (1 - Ix/I) times the roll angle, are a constant plus the
integral of q_inf S d / I (C_m + i C_n) e^{i Phi}. In them the planted contribution is one known column. Projected
off the baseline and off the record effects with their priors, its squared length over the noise's variance is F; a
rival that reproduces part of it lacks the rest, which is 2 ln L of truth over rival in expectation.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline, PPoly

from tests.studies.independent.flights import Made
from tests.studies.independent.instruments import Errors, inertia_tensor, no_errors, sensed_rates
from tests.studies.independent.mechanisms import LISTED, body_components

DETECTED = 25.0  # F at the detection limit (DESIGN)
DRIFT = 2  # degree in time of the baseline's C_malpha
INTERVALS = 24  # of a rival's first grid of knots over the record
FINER = 6  # by which an interval beside the best knots is divided, each time
PASSES = 2  # of finer grids
DELAYS = np.geomspace(2e-3, 0.15, 12)  # s, of a rival's first grid
FINER_DELAYS = 7  # between the neighbours of the best

# What the true motion does not determine: it moves the gyros, the phase of de-rolling or the equations of motion.
# Dynamic pressure and inertia scale every moment alike, as C_malpha does: the baseline has them.
_GYROS = {"gyro_bias": 3, "gyro_scale": 3, "gyro_misalignment": 6, "time_skew": 1}
_VEHICLE = {"cg_offset": 2, "principal_axis": 2, "inertia_ratio": 1}
_LEAST_PIVOT = 1e-10  # relative: a rival's columns that the baseline already has explain nothing


@dataclass(frozen=True)
class Rival:
    """The best that a rival mechanism can do: `two_ln_l` of truth over it, and where."""

    two_ln_l: float
    start: float
    stop: float
    delay: float | None
    values: tuple[float, ...]


@dataclass(frozen=True)
class Known:
    """`f_ratio` of the planted contribution; the amplitude and share at which it would be DETECTED; the rivals."""

    f_ratio: float
    limit_amplitude: float
    limit_share: float
    against: dict[str, Rival]

    @property
    def nearest(self) -> str:
        """The rival that comes closest to the truth."""
        return min(self.against, key=lambda name: self.against[name].two_ln_l)


class Ground:
    """The weak form on one flight's true motion, and what has to be projected off."""

    def __init__(self, made: Made) -> None:
        self.made, true = made, made.true
        self.vehicle = true.craft.vehicle
        self.time, self.sigma = true.time, true.noise.gyro
        if not self.sigma > 0.0:
            raise ValueError("got gyros without noise, expected some: everything can be known without it")
        self.zeta = CubicSpline(self.time, true.alpha * np.exp(1j * true.meridian))
        self.turn = np.exp(1j * self.phase(true.rates[:, 0]))
        self.weight = true.dynamic_pressure * self.vehicle.moment_scale
        nuisance, priors = self._columns()
        padded = np.vstack([nuisance, priors])
        self.rows = nuisance.shape[0]
        self.basis = np.linalg.qr(padded / np.linalg.norm(padded, axis=0))[0]

    def phase(self, roll_rate: np.ndarray) -> np.ndarray:
        rest = 1.0 - self.vehicle.inertia_ratio
        return np.asarray(rest * CubicSpline(self.time, roll_rate).antiderivative()(self.time))

    def integral(self, moment: np.ndarray) -> PPoly:
        """De-rolled rates, rad/s, that moment coefficients C_m + i C_n (n,) make, over time."""
        return CubicSpline(self.time, self.weight * moment * self.turn).antiderivative()

    def planted(self) -> np.ndarray:
        """De-rolled rates (n,) of what was planted."""
        true = self.made.true
        if true.region is None:
            return np.zeros(self.time.size, dtype=complex)
        grown = self.integral(body_components(true.claim, true.meridian))
        return _grown(grown, np.array(true.region), self.time)[:, 0]

    def whitened(self, rates: np.ndarray) -> np.ndarray:
        """Real rows (2n, ...) in units of the noise; coloured noise is of the sensors, so in axes that roll."""
        colour = self.made.true.noise.colour
        sensed = (rates.T * self.turn.conj()).T if colour else rates
        fresh = sensed.copy()
        fresh[1:] = (sensed[1:] - colour * sensed[:-1]) / np.sqrt(1.0 - colour**2)
        return np.concatenate([fresh.real, fresh.imag]) / self.sigma

    def project(self, columns: np.ndarray) -> np.ndarray:
        """Columns (2n, m) less what baseline and record effects explain: (2n + priors, m)."""
        padded = np.zeros((self.basis.shape[0], columns.shape[1]))
        padded[: self.rows] = columns
        return np.asarray(padded - self.basis @ (self.basis.T @ padded))

    def _columns(self) -> tuple[np.ndarray, np.ndarray]:
        baseline = [*self._baseline()]
        effects = [*self._effects()]
        columns = np.stack([self.whitened(column) for column in baseline + effects], axis=1)
        priors = np.hstack([np.zeros((len(effects), len(baseline))), np.eye(len(effects))])
        return columns, priors

    def _baseline(self) -> Iterator[np.ndarray]:
        """Start, C_m0, C_malpha and its drift, alpha cubed where the static moment bends, C_mq."""
        true = self.made.true
        ones = np.ones(self.time.size, dtype=complex)
        yield from (ones, 1j * ones)
        drift = 2.0 * (self.time - self.time[0]) / (self.time[-1] - self.time[0]) - 1.0
        for column in (ones, *(drift**degree * true.alpha for degree in range(DRIFT + 1))):
            yield self.integral(body_components(column, true.meridian))(self.time)
        if true.craft.static_bend:
            yield self.integral(body_components(true.alpha**3, true.meridian))(self.time)
        transverse = true.rates[:, 1] + 1j * true.rates[:, 2]
        yield self.integral(transverse * self.vehicle.reference_length / (2.0 * true.velocity))(self.time)

    def _effects(self) -> Iterator[np.ndarray]:
        """Change of the de-rolled rates by one tolerance of each error, the motion fixed."""
        tolerances = self.made.flight.instruments.values()
        nothing = no_errors()
        sensed, turning = self._sensed(nothing), self._turning(nothing)
        for key, components in _GYROS.items():
            for place in range(components):
                yield self._sensed(nothing.changed(key, place, tolerances[key][0])) - sensed
        for key, components in _VEHICLE.items():
            for place in range(components):
                change = self._turning(nothing.changed(key, place, tolerances[key][0])) - turning
                yield CubicSpline(self.time, change * self.turn).antiderivative()(self.time)

    def _sensed(self, errors: Errors) -> np.ndarray:
        true = self.made.true
        rates = sensed_rates(CubicSpline(self.time, true.rates), self.time, errors)
        return np.asarray((rates[:, 1] + 1j * rates[:, 2]) * np.exp(1j * self.phase(rates[:, 0])))

    def _turning(self, errors: Errors) -> np.ndarray:
        """Transverse angular acceleration (n,) that Euler's equations give the true motion and moments."""
        true, vehicle = self.made.true, self.vehicle
        tensor = inertia_tensor(vehicle.ixx, vehicle.iyy, errors)
        moment = self.weight * vehicle.iyy * true.moment
        torque = np.stack([np.zeros(self.time.size), moment.real, moment.imag], axis=1)
        centre = np.array([0.0, *errors.cg_offset])
        torque = torque - np.cross(centre, vehicle.mass * self._specific_force())
        change = np.linalg.solve(tensor, (torque - np.cross(true.rates, true.rates @ tensor.T)).T)
        return np.asarray(change[1] + 1j * change[2])

    def _specific_force(self) -> np.ndarray:
        """Of the aerodynamics at the c.g. (n, 3)."""
        true, craft = self.made.true, self.made.true.craft
        cross = craft.normal_slope * true.alpha * craft.bent(craft.normal_bend, true.alpha)
        shape = [
            craft.axial * craft.bent(craft.axial_bend, true.alpha),
            cross * np.sin(true.meridian),
            cross * np.cos(true.meridian),
        ]
        push = true.dynamic_pressure * self.vehicle.reference_area / self.vehicle.mass
        return -push[:, None] * np.stack(shape, axis=1)

    def rival_moments(self, name: str, delay: float | None) -> list[np.ndarray]:
        """Body moments C_m + i C_n (n,) of a mechanism at unit coefficients, acting all the time."""
        true = self.made.true
        if name == "bodyfixed":
            ones = np.ones(self.time.size, dtype=complex)
            return [ones, 1j * ones]
        columns: list[np.ndarray]
        if delay is not None:
            columns = [self._delayed(name, delay)]
        elif name == "inplane":
            columns = [np.ones(self.time.size), true.alpha]
        else:
            columns = [true.alpha_rate * self.vehicle.reference_length / (2.0 * true.velocity)]
        return [body_components(column, true.meridian) for column in columns]

    def _delayed(self, name: str, delay: float) -> np.ndarray:
        true = self.made.true
        before = self.zeta(self.time - delay)
        static = true.static(np.abs(before))
        if name == "lag":
            column = static * np.exp(1j * delay * true.meridian_rate) - true.static(true.alpha)
        else:
            column = 1j * static * np.sin(true.meridian - np.angle(before))
        return np.where(self.time - self.time[0] < delay, 0.0, column)


def judge(made: Made, rivals: Sequence[str] = LISTED) -> Known:
    """F of what was planted, its detection limit, and 2 ln L over each rival; over `none` it is F itself.

    A rival acts in one region and has free coefficients, knots and delay.
    """
    ground = Ground(made)
    true = made.true
    target = ground.project(ground.whitened(ground.planted())[:, None])[:, 0]
    f_ratio = float(target @ target)
    ratio = np.sqrt(DETECTED / f_ratio) if f_ratio > 0.0 else np.inf
    against = {"none": Rival(f_ratio, 0.0, 0.0, None, ())}
    against |= {name: best_rival(ground, target, name) for name in rivals if name != made.truth}
    amplitude, share = (made.amplitude * ratio, true.share * ratio) if f_ratio > 0.0 else (np.inf, np.inf)
    return Known(f_ratio, float(amplitude), float(share), against)


def best_rival(ground: Ground, target: np.ndarray, name: str) -> Rival:
    """Over a coarse grid of knots and delays, then over finer ones about the best."""
    first, last = float(ground.time[0]), float(ground.time[-1])
    knots = np.linspace(first, last, INTERVALS + 1)
    delayed = name in ("lag", "sticking")
    delays = [float(delay) for delay in DELAYS] if delayed else [None]
    best = _least(ground, target, name, knots, delays)
    width, ratio = knots[1] - knots[0], DELAYS[1] / DELAYS[0]
    for _ in range(PASSES):
        near = [edge + width * np.linspace(-1, 1, 2 * FINER + 1) for edge in (best.start, best.stop)]
        knots = np.unique(np.clip(np.concatenate([[first, last], *near]), first, last))
        if best.delay is not None:
            delays = [float(best.delay * ratio**power) for power in np.linspace(-1, 1, FINER_DELAYS)]
        best = min(best, _least(ground, target, name, knots, delays), key=lambda rival: rival.two_ln_l)
        width, ratio = width / FINER, ratio ** (2.0 / (FINER_DELAYS - 1))
    return best


def _least(ground: Ground, target: np.ndarray, name: str, knots: np.ndarray, delays: Sequence[float | None]) -> Rival:
    found = []
    for place, delay in enumerate(delays):
        # A lag has no size but its delay; one down to the next shorter of the grid is the same column, less of it.
        below = delays[place - 1] / delay if place and delay else 0.0
        found.append(_least_at(ground, target, name, knots, delay, (below, 1.0) if name == "lag" else None))
    return min(found, key=lambda rival: rival.two_ln_l)


def _least_at(
    ground: Ground,
    target: np.ndarray,
    name: str,
    knots: np.ndarray,
    delay: float | None,
    sizes: tuple[float, float] | None,
) -> Rival:
    """Every region between two knots, from the normal equations of its elementary intervals; `sizes` bound a value."""
    moments = ground.rival_moments(name, delay)
    pieces = [ground.whitened(_grown(ground.integral(moment), knots, ground.time)) for moment in moments]
    columns = ground.project(np.concatenate(pieces, axis=1))
    count, size = len(moments), knots.size - 1
    normal = (columns.T @ columns).reshape(count, size, count, size).transpose(0, 2, 1, 3)
    sums = np.zeros((count, count, size + 1, size + 1))
    sums[:, :, 1:, 1:] = normal.cumsum(axis=2).cumsum(axis=3)
    right = np.zeros((count, size + 1))
    right[:, 1:] = (columns.T @ target).reshape(count, size).cumsum(axis=1)
    starts, stops = np.triu_indices(size + 1, 1)
    gram = sums[..., stops, stops] - sums[..., starts, stops] - sums[..., stops, starts] + sums[..., starts, starts]
    gram = gram.transpose(2, 0, 1)
    side = (right[:, stops] - right[:, starts]).T
    values = np.einsum("nij,nj->ni", np.linalg.pinv(gram, rcond=_LEAST_PIVOT, hermitian=True), side)
    if sizes is not None:
        values = np.clip(values, *sizes)
    residual = target @ target - 2.0 * np.sum(values * side, axis=1) + np.einsum("ni,nij,nj->n", values, gram, values)
    place = int(np.argmin(residual))
    return Rival(
        max(float(residual[place]), 0.0),
        float(knots[starts[place]]),
        float(knots[stops[place]]),
        delay,
        tuple(values[place].tolist()),
    )


def _grown(integral: PPoly, knots: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Columns (n, len(knots) - 1): the integral over each interval between knots alone."""
    at = integral(knots)
    inside = integral(time)[:, None]
    return np.where(
        time[:, None] <= knots[:-1], 0.0, np.where(time[:, None] >= knots[1:], np.diff(at), inside - at[:-1])
    )
