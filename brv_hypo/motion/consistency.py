"""Gyros against accelerometers against air data: how well a record obeys what holds for every body.

A data-compatibility check (Morelli and Klein, Aircraft System Identification, 2nd ed., ch. 10), posed so that no
aerodynamics need be known. With xi = (v + i w) / V, omega = q + i r, f = f_y + i f_z, phi the integral of p and
psi that of (1 - Ix/I) p:

    path        d/dt (V xi e^{i phi}) = (i V omega + f + gravity) e^{i phi}
    force       f = -(q_inf S / m) C_N xi + what is fixed in the body          C_N > 0, varies slowly
    moment      d/dt (omega e^{i psi}) = (q_inf S d / I) (-i C_m_alpha xi + C_mq omega d / 2V + trim) e^{i psi}

    relation 1  path into force:    the accelerometers follow from the gyros, but for the slope
    relation 2  force into moment:  the gyros follow from the accelerometers, but for the ratio of slopes
    relation 3  path into moment:   the gyros follow from themselves and the speed

Signs and axes break the phase of these relations, whatever the slopes; units break their size, and those of ax
the deceleration. Every relation is linear in its unknowns, and integrated, so that nothing is differentiated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray
from brv_hypo.constants import (
    TRIAL_ALTITUDE_DEGREE,
    TRIAL_ANY_SPEED,
    TRIAL_AXIAL_REACH,
    TRIAL_AXIAL_SAMPLES,
    TRIAL_AXIAL_SPREAD,
    TRIAL_AXIAL_STEPS,
    TRIAL_DENSITY_SPREAD,
    TRIAL_FEWEST_SAMPLES,
    TRIAL_FURTHER_MISTAKE,
    TRIAL_GRAVITY,
    TRIAL_GRAVITY_DOUBT,
    TRIAL_GRAVITY_UNKNOWN,
    TRIAL_KEPT,
    TRIAL_LIFT_DOUBT,
    TRIAL_MOST_OF_NOISE,
    TRIAL_MOST_PER_CHECK,
    TRIAL_MOST_SAMPLES,
    TRIAL_NOISE_SPREAD,
    TRIAL_NORMAL_SLOPE,
    TRIAL_NORMAL_SPREAD,
    TRIAL_STEADY,
    TRIAL_TOO_NOISY,
    TRIAL_WIND,
    TRIAL_WIND_MEMORY,
    TRIAL_WIND_TOLERANCES,
)
from brv_hypo.flight.derive import standard_density
from brv_hypo.flight.record import Flight, Vehicle
from brv_hypo.motion.corrections import Correction
from brv_hypo.motion.differentiation import differentiate
from brv_hypo.motion.noise import white_noise_level
from brv_hypo.motion.wind import gravity_magnitude


@dataclass(frozen=True)
class Readings:
    """What the trial needs of one segment: all in SI over (n,) or (3, n); `change` is that of the rates."""

    time: FloatArray
    rates: FloatArray
    change: FloatArray
    forces: FloatArray
    velocity: FloatArray
    dynamic_pressure: FloatArray
    altitude: FloatArray | None


@dataclass(frozen=True)
class Record:
    """A flight, made ready to be judged under many corrections; `*_sigma` (3,) white noise of the channels.

    `wind_sigma` is that of the wind along the path, m/s; `gravity` its size, m/s^2.
    """

    flight: Flight
    segments: tuple[Readings, ...]
    rate_sigma: FloatArray
    force_sigma: FloatArray
    velocity_sigma: float
    wind_sigma: float
    gravity: float


@dataclass(frozen=True)
class Consistency:
    """How a record keeps to the relations.

    `left` (3,): share of each relation that is left unexplained, 1 where the slope has the wrong sign; `noise` (3,):
    the share that white noise alone leaves; `informative` (3,): whether the record can tell; `normal_slope` C_N per
    rad as relation 1 has it, or None; `axial` true over sensed deceleration and `axial_sigma`; `pressure` recorded
    over expected dynamic pressure, or None. `cost` is -ln likelihood of all but the relations.
    """

    left: FloatArray
    noise: FloatArray
    informative: BoolArray
    normal_slope: float | None
    axial: float
    axial_sigma: float
    pressure: float | None
    cost: float

    def better_than(self, other: Consistency) -> float:
        """By how much ln likelihood is higher, over the relations that can be judged under both."""
        both = self.informative & other.informative
        logs = [np.log(np.maximum(one.left, np.maximum(TRIAL_KEPT, one.noise))) for one in (other, self)]
        return float(np.sum((logs[0] - logs[1])[both])) + other.cost - self.cost


def made_ready(flight: Flight) -> Record:
    """The segments of a flight that are long enough, with rates differentiated once for all corrections."""
    segments = tuple(piece for piece in flight.segments if piece[1] - piece[0] >= TRIAL_FEWEST_SAMPLES)
    rates = np.stack([flight.p, flight.q, flight.r])
    forces = np.stack([flight.ax, flight.ay, flight.az])
    rate_sigma = np.array([white_noise_level(channel, flight.segments) for channel in rates])
    force_sigma = np.array([white_noise_level(channel, flight.segments) for channel in forces])
    change = np.zeros_like(rates)
    if segments and any(flight.vehicle.accelerometer_position):
        change = np.stack(
            [
                differentiate(channel.astype(complex), flight.step, float(sigma), flight.segments).rate.real
                for channel, sigma in zip(rates, rate_sigma, strict=True)
            ]
        )
    height = flight.altitude
    return Record(
        flight=flight,
        segments=tuple(
            Readings(
                flight.time[a:b] - flight.time[a],
                rates[:, a:b],
                change[:, a:b],
                forces[:, a:b],
                flight.velocity[a:b],
                flight.dynamic_pressure[a:b],
                None if height is None else height[a:b],
            )
            for a, b in segments
        ),
        rate_sigma=rate_sigma,
        force_sigma=force_sigma,
        velocity_sigma=white_noise_level(flight.velocity, flight.segments),
        wind_sigma=max(TRIAL_WIND, TRIAL_WIND_TOLERANCES * max(flight.instruments.wind)),
        gravity=gravity_magnitude(flight) or TRIAL_GRAVITY,
    )


def consistency(record: Record, correction: Correction) -> Consistency:
    """How well the record, corrected, keeps to the relations."""
    pieces = [_corrected(piece, correction) for piece in record.segments]
    gyros, accelerometers = np.array(correction.gyros), np.array(correction.accelerometers)
    rate_sigma = np.sqrt(gyros**2 @ record.rate_sigma**2)
    force_sigma = np.sqrt(accelerometers**2 @ record.force_sigma**2)
    tallies = [_tally(record, piece, rate_sigma, force_sigma) for piece in pieces]
    total = np.sum([tally.squares for tally in tallies], axis=0) if tallies else np.zeros((3, 3))
    size = np.maximum(total[:, 0], 1e-300)
    noise = total[:, 2] / size
    informative = (total[:, 0] > 0.0) & (noise < TRIAL_TOO_NOISY)
    left = np.where(informative, np.clip(total[:, 1] / size, 0.0, 1.0), 1.0)
    slope = _mean_slope(tallies) if informative[0] else None
    if slope is not None and slope <= 0.0:
        left[0], slope = 1.0, None
    axial, axial_sigma = _axial(record, pieces, correction)
    pressure = _pressure_ratio(record.flight, correction)
    cost = (
        _of_normal(slope)
        + _of_axial(axial, axial_sigma)
        + _of_pressure(pressure)
        + _of_steady(max((tally.steady for tally in tallies), default=0.0))
        + _of_noise(rate_sigma)
        + _of_noise(force_sigma)
        + TRIAL_FURTHER_MISTAKE * max(correction.changes - 1, 0)
    )
    return Consistency(left, noise, informative, slope, axial, axial_sigma, pressure, cost)


def _mean_slope(tallies: Sequence[_Tally]) -> float:
    """C_N over all segments, by what each has to explain."""
    weight = np.array([tally.squares[0, 0] for tally in tallies])
    return float(weight @ np.array([tally.normal_slope for tally in tallies]) / np.sum(weight))


def _corrected(piece: Readings, correction: Correction) -> Readings:
    gyros, accelerometers = np.array(correction.gyros), np.array(correction.accelerometers)
    speed, pressure, height = correction.air
    return Readings(
        piece.time,
        gyros @ piece.rates,
        gyros @ piece.change,
        accelerometers @ piece.forces,
        speed * piece.velocity,
        pressure * piece.dynamic_pressure,
        None if piece.altitude is None else height * piece.altitude,
    )


@dataclass(frozen=True)
class _Tally:
    """Of one segment: for each relation (3,) the square to be explained, what is left, what noise leaves."""

    squares: FloatArray
    normal_slope: float
    steady: float


def _tally(record: Record, piece: Readings, rate_sigma: FloatArray, force_sigma: FloatArray) -> _Tally:
    vehicle = record.flight.vehicle
    time = piece.time
    roll = _running(time, piece.rates[0])
    turn, spin = np.exp(1j * roll), np.exp(1j * (1.0 - vehicle.inertia_ratio) * roll)
    omega = piece.rates[1] + 1j * piece.rates[2]
    axial, force = _force(piece, vehicle.accelerometer_position)
    path = _integral(time, (1j * piece.velocity * omega + force) * turn)
    path_of_gyros = _integral(time, 1j * piece.velocity * omega * turn)
    xi = path * np.conj(turn) / piece.velocity
    pressure = piece.dynamic_pressure
    scale = pressure * vehicle.reference_area / vehicle.mass
    tau = 2.0 * time / time[-1] - 1.0
    powers = np.stack([np.ones_like(tau), tau, tau**2])

    # Relation 1, in body axes; the path starts anywhere, and gravity and wind bend it slowly.
    start = [scale / piece.velocity * np.conj(turn) * power for power in powers]
    fixed = [powers[0].astype(complex), axial.astype(complex), scale.astype(complex), tau.astype(complex)]
    first = _fit(force, [-scale * xi * power for power in powers], [*start, *fixed])
    noise = float(np.mean(force_sigma[1:] ** 2))

    # Relation 2, integrated; a moment fixed in the body may come and go.
    body = [_integral(time, pressure * power * spin) for power in (*powers, tau**3, tau**4)]
    damped = _integral(time, pressure / piece.velocity * omega * spin)
    ones = np.ones_like(spin)
    ratio = [_integral(time, 1j * force * spin * power) for power in powers]
    second = _fit(omega * spin, ratio, [ones, *body, damped, _integral(time, axial * spin)])

    # Relation 3, integrated.
    away = spin * np.conj(turn)
    drift = [_integral(time, pressure / piece.velocity * away * power) for power in powers]
    course = path_of_gyros / piece.velocity * away
    static = [_integral(time, -1j * pressure * course * power) for power in powers]
    third = _fit(omega * spin, static, [ones, *body, damped, *drift])
    rate_noise = float(np.mean(rate_sigma[1:] ** 2))
    squares = np.array(
        [
            (first.size, first.left, 2.0 * noise * first.rows),
            (second.size, second.left, 2.0 * rate_noise * second.rows),
            (third.size, third.left, 2.0 * rate_noise * third.rows),
        ]
    )
    steady = abs(complex(np.mean(force))) / (TRIAL_STEADY * float(np.std(force)) + 1.0)
    return _Tally(squares, first.slope, steady)


def _integral(time: FloatArray, values: ComplexArray) -> ComplexArray:
    """Integral of `values` (n,) from the first sample on, by trapezoids."""
    result = np.zeros(time.size, dtype=complex)
    np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(time), out=result[1:])
    return result


def _force(piece: Readings, position: tuple[float, float, float]) -> tuple[FloatArray, ComplexArray]:
    """Axial and transverse specific force at the c.g. (errata E10, E11)."""
    arm = np.array(position)
    moved = piece.forces
    if np.any(arm):
        swing = np.cross(piece.rates.T, np.cross(piece.rates.T, arm)).T
        moved = moved - np.cross(piece.change.T, arm).T - swing
    return moved[0], moved[1] + 1j * moved[2]


@dataclass(frozen=True)
class _Fit:
    """`size`: square of what the nuisances leave; `left`: of what the slopes leave too; `slope` on average."""

    size: float
    left: float
    slope: float
    rows: int


def _fit(observed: ComplexArray, slopes: list[ComplexArray], nuisances: list[ComplexArray]) -> _Fit:
    """`observed` by real slopes, after complex nuisances."""
    every = max(1, observed.size // TRIAL_MOST_SAMPLES)
    table = np.stack([*nuisances, *(1j * column for column in nuisances), *slopes, observed], axis=1)[::every]
    rows = np.concatenate([table.real, table.imag])
    count = 2 * len(nuisances)
    norms = np.linalg.norm(rows, axis=0)
    scaled = rows / np.where(norms > 0.0, norms, 1.0)
    basis, values, _ = np.linalg.svd(scaled[:, :count], full_matrices=False)
    basis = basis[:, values > 1e-8 * max(float(values[0]), 1e-300)]
    rest = scaled[:, count:] - basis @ (basis.T @ scaled[:, count:])
    answer = np.linalg.lstsq(rest[:, :-1], rest[:, -1], rcond=1e-8)[0]
    residual = rest[:, -1] - rest[:, :-1] @ answer
    power = float(norms[-1]) ** 2
    course = rows[:, count:-1] @ (answer / np.where(norms[count:-1] > 0.0, norms[count:-1], 1.0))
    first = rows[:, count]
    slope = float(first @ course / max(float(first @ first), 1e-300)) * float(norms[-1])
    return _Fit(
        power * float(rest[:, -1] @ rest[:, -1]), power * float(residual @ residual), slope, table.shape[0]
    )


def _axial(record: Record, pieces: list[Readings], correction: Correction) -> tuple[float, float]:
    """True over sensed deceleration, from the change of the speed, and the standard deviation of that.

    Least squares weighted by what else changes the airspeed: wind that wanders, gravity along the path, the normal
    force times the angle of attack it takes, noise. A short or gentle record cannot tell them apart, and has a
    large deviation.
    """
    information, right = 0.0, 0.0
    for piece in pieces:
        every = max(1, piece.time.size // TRIAL_AXIAL_SAMPLES)
        time = piece.time[::every]
        change, doubt = piece.velocity - piece.velocity[0], TRIAL_GRAVITY_UNKNOWN
        if piece.altitude is not None:
            fall = np.gradient(_slowly(piece.altitude), piece.time)
            change = change + record.gravity * _running(piece.time, fall / piece.velocity)
            doubt = TRIAL_GRAVITY_DOUBT
        apart = np.abs(time[:, None] - time) / (TRIAL_WIND_MEMORY * time[-1])
        covariance = record.wind_sigma**2 * np.exp(-apart) + TRIAL_ANY_SPEED**2
        covariance += (doubt * record.gravity) ** 2 * np.outer(time, time)
        lift = TRIAL_LIFT_DOUBT * _slowed_by_lift(record.flight.vehicle, piece)[::every]
        covariance += np.outer(lift, lift)
        covariance += (record.velocity_sigma * correction.air[0]) ** 2 * np.eye(time.size)
        sensed = _running(piece.time, piece.forces[0])[::every]
        weighted = np.linalg.solve(covariance, sensed)
        information += float(weighted @ sensed)
        right += float(weighted @ change[::every])
    if not information > 0.0:
        return 1.0, np.inf
    return right / information, float(1.0 / np.sqrt(information))


def _slowed_by_lift(vehicle: Vehicle, piece: Readings) -> FloatArray:
    """Speed (n,) m/s that the normal force takes: f^2 over q_inf S C_N / m, and never more than f."""
    normal = np.hypot(piece.forces[1], piece.forces[2])
    stiffness = TRIAL_NORMAL_SLOPE * piece.dynamic_pressure * vehicle.reference_area / vehicle.mass
    angle = normal / np.maximum(stiffness, np.maximum(normal, 1e-300))
    return _running(piece.time, normal * angle)


def _running(time: FloatArray, values: FloatArray) -> FloatArray:
    """Integral of real `values` (n,) from the first sample on."""
    return np.asarray(_integral(time, values.astype(complex)).real)


def _slowly(values: FloatArray) -> FloatArray:
    """A polynomial through `values` (n,): altitude is noisy, and its rate changes slowly."""
    place = np.linspace(-1.0, 1.0, values.size)
    return np.asarray(np.polyval(np.polyfit(place, values, TRIAL_ALTITUDE_DEGREE), place), dtype=np.float64)


def _pressure_ratio(flight: Flight, correction: Correction) -> float | None:
    """Recorded over expected dynamic pressure: by the density, or by the altitude in Earth's atmosphere."""
    speed, pressure, height = correction.air
    density = flight.density
    if flight.planet == "earth" and flight.altitude is not None:
        every = max(1, flight.samples // 50)
        altitude = height * flight.altitude[::every]
        expected = 0.5 * standard_density(altitude) * (speed * flight.velocity[::every]) ** 2
        ratios = pressure * flight.dynamic_pressure[::every] / expected
    elif density is not None:
        expected = 0.5 * density * (speed * flight.velocity) ** 2
        ratios = pressure * flight.dynamic_pressure / expected
    else:
        return None
    ratios = ratios[np.isfinite(ratios) & (ratios > 0.0)]
    return float(np.median(ratios)) if ratios.size else None


def _of_normal(slope: float | None) -> float:
    if slope is None:
        return 0.0
    return min(0.5 * float(np.log(slope / TRIAL_NORMAL_SLOPE) / TRIAL_NORMAL_SPREAD) ** 2, TRIAL_MOST_PER_CHECK)


def _of_steady(size: float) -> float:
    """What a constant force in the body costs: a wrong roll rate or lever arm makes one out of nothing."""
    return min(0.5 * float(np.log(max(size, 1.0))) ** 2, TRIAL_MOST_PER_CHECK)


def _of_axial(ratio: float, sigma: float) -> float:
    """What a deceleration of `ratio` to that sensed costs: shared by an error of scale and by wind and gravity."""
    logs = np.linspace(-TRIAL_AXIAL_REACH, TRIAL_AXIAL_REACH, TRIAL_AXIAL_STEPS)
    costs = 0.5 * (logs / TRIAL_AXIAL_SPREAD) ** 2 + 0.5 * ((ratio - np.exp(logs)) / sigma) ** 2
    return min(float(np.min(costs)), TRIAL_MOST_PER_CHECK)


def _of_pressure(ratio: float | None) -> float:
    return 0.0 if ratio is None else min(0.5 * float(np.log(ratio) / TRIAL_DENSITY_SPREAD) ** 2, TRIAL_MOST_PER_CHECK)


def _of_noise(sigma: FloatArray) -> float:
    """Three instruments of one make are about equally noisy."""
    if not np.all(sigma > 0.0):
        return 0.0
    logs = np.log(sigma)
    return min(0.5 * float(np.sum((logs - np.median(logs)) ** 2)) / TRIAL_NOISE_SPREAD**2, TRIAL_MOST_OF_NOISE)
