"""Data compatibility check: gyros against accelerometers against air data, before anything is fitted.

After Morelli and Klein (Aircraft System Identification, 2nd ed., ch. 10), posed so that no aerodynamics need be
known. With xi = (v + i w) / V, omega = q + i r, f = f_y + i f_z, phi the integral of p and psi that of (1 - Ix/I) p:

    path        d/dt (V xi e^{i phi}) = (i V omega + f + gravity) e^{i phi}
    force       f = -(q_inf S / m) C_N xi + what is fixed in the body          C_N > 0, varies slowly
    moment      d/dt (omega e^{i psi}) = (q_inf S d / I) (-i C_m_alpha xi + C_mq omega d / 2V + trim) e^{i psi}

    relation 1  path into force:    the accelerometers follow from the gyros, but for the slope
    relation 2  force into moment:  the gyros follow from the accelerometers, but for the ratio of slopes
    relation 3  path into moment:   the gyros follow from themselves and the speed

Wrong signs and axes break the phase of these relations, whatever the slopes; wrong units break their size, and those
of ax the deceleration. Every relation is linear in its unknowns and integrated, so that nothing is differentiated.
`try_record` is the entrance: the record contradicts itself where it breaks a relation by more than its own noise and
the tolerances of any instrument explain, and undoing one mistake of sign, axis or unit (corrections.py) restores it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray
from brv_hypo.errors import FlightRecordError
from brv_hypo.flight.derived import atmosphere, averaged
from brv_hypo.flight.format import masked_flight
from brv_hypo.flight.record import Flight, RecordFault, RecordTrial, Vehicle
from brv_hypo.motion.corrections import AS_IT_IS, Correction, corrections
from brv_hypo.motion.inertial import gravity_magnitude
from brv_hypo.motion.signals import differentiate, white_noise_level
from brv_hypo.thresholds import (
    COMPATIBILITY_AXIAL_SIGMAS,
    COMPATIBILITY_AXIAL_SPREAD,
    COMPATIBILITY_AXIAL_WITHIN,
    COMPATIBILITY_BROKEN,
    COMPATIBILITY_BROKEN_ALONE,
    COMPATIBILITY_CORRECTED,
    COMPATIBILITY_DECISIVE,
    COMPATIBILITY_DECISIVE_IF_STRAINED,
    COMPATIBILITY_DENSITY_SPREAD,
    COMPATIBILITY_FURTHER_MISTAKE,
    COMPATIBILITY_KEPT,
    COMPATIBILITY_NEARLY_EQUAL,
    COMPATIBILITY_NOISE_SPREAD,
    COMPATIBILITY_NORMAL_SLOPE,
    COMPATIBILITY_NORMAL_SPREAD,
    COMPATIBILITY_NORMAL_WITHIN,
    COMPATIBILITY_PRESSURE_WITHIN,
    COMPATIBILITY_QUIET,
    COMPATIBILITY_STEADY,
    COMPATIBILITY_STRAINED,
    COMPATIBILITY_TIMES_NOISE,
    COMPATIBILITY_TOO_NOISY,
    COMPATIBILITY_UNRELATED,
    COMPATIBILITY_WIND,
    COMPATIBILITY_WIND_TOLERANCES,
    MINIMUM_SAMPLES,
)

COMPATIBILITY_FEWEST_SAMPLES = 64  # of a segment that is judged
COMPATIBILITY_MOST_SAMPLES = 300  # that it is thinned to; bounds the time
COMPATIBILITY_ALTITUDE_DEGREE = 3  # of the polynomial through the altitude: it is noisy, and its rate changes slowly
COMPATIBILITY_WIND_MEMORY = 0.5
COMPATIBILITY_GRAVITY = 10.0  # m/s^2, of a planet that is not known
COMPATIBILITY_GRAVITY_DOUBT = 0.2  # 1-sigma share of gravity along the path that the altitude leaves open
COMPATIBILITY_GRAVITY_UNKNOWN = 1.0  # the same without altitude: all of it
COMPATIBILITY_LIFT_DOUBT = (
    1.0  # 1-sigma of the deceleration by lift, in what it is where the force has the slope of any body
)
COMPATIBILITY_ANY_SPEED = 1e3  # m/s, 1-sigma of the speed that a segment starts with: open
COMPATIBILITY_AXIAL_SAMPLES = 60  # that tell the deceleration; the time goes with their cube
COMPATIBILITY_AXIAL_REACH = 4.0 * COMPATIBILITY_AXIAL_SPREAD  # logarithms of it that are tried
COMPATIBILITY_AXIAL_STEPS = 41  # values tried, a fifth of a spread apart
COMPATIBILITY_MOST_PER_CHECK = 6.0  # -ln likelihood that no single check counts beyond
COMPATIBILITY_MOST_OF_NOISE = 3.0  # the same for each triad's noise


# ---- Gyros against accelerometers against air data: how well a record obeys what holds for every body ----


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
class PreparedRecord:
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
class Compatibility:
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

    def better_than(self, other: Compatibility) -> float:
        """By how much ln likelihood is higher, over the relations that can be judged under both."""
        both = self.informative & other.informative
        logs = [np.log(np.maximum(one.left, np.maximum(COMPATIBILITY_KEPT, one.noise))) for one in (other, self)]
        return float(np.sum((logs[0] - logs[1])[both])) + other.cost - self.cost


def prepared(flight: Flight) -> PreparedRecord:
    """The segments of a flight that are long enough, with rates differentiated once for all corrections."""
    segments = tuple(piece for piece in flight.segments if piece[1] - piece[0] >= COMPATIBILITY_FEWEST_SAMPLES)
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
    return PreparedRecord(
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
        wind_sigma=max(COMPATIBILITY_WIND, COMPATIBILITY_WIND_TOLERANCES * max(flight.instruments.wind)),
        gravity=gravity_magnitude(flight) or COMPATIBILITY_GRAVITY,
    )


def compatibility_of(record: PreparedRecord, correction: Correction) -> Compatibility:
    """How well the record, corrected, keeps to the relations."""
    pieces = [_corrected(piece, correction) for piece in record.segments]
    gyros, accelerometers = np.array(correction.gyros), np.array(correction.accelerometers)
    rate_sigma = np.sqrt(gyros**2 @ record.rate_sigma**2)
    force_sigma = np.sqrt(accelerometers**2 @ record.force_sigma**2)
    tallies = [_tally(record, piece, rate_sigma, force_sigma) for piece in pieces]
    total = np.sum([tally.squares for tally in tallies], axis=0) if tallies else np.zeros((3, 3))
    size = np.maximum(total[:, 0], 1e-300)
    noise = total[:, 2] / size
    informative = (total[:, 0] > 0.0) & (noise < COMPATIBILITY_TOO_NOISY)
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
        + COMPATIBILITY_FURTHER_MISTAKE * max(correction.changes - 1, 0)
    )
    return Compatibility(left, noise, informative, slope, axial, axial_sigma, pressure, cost)


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


def _tally(record: PreparedRecord, piece: Readings, rate_sigma: FloatArray, force_sigma: FloatArray) -> _Tally:
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
    gyro_crossflow = path_of_gyros / piece.velocity * away
    static = [_integral(time, -1j * pressure * gyro_crossflow * power) for power in powers]
    third = _fit(omega * spin, static, [ones, *body, damped, *drift])
    rate_noise = float(np.mean(rate_sigma[1:] ** 2))
    squares = np.array(
        [
            (first.size, first.left, 2.0 * noise * first.rows),
            (second.size, second.left, 2.0 * rate_noise * second.rows),
            (third.size, third.left, 2.0 * rate_noise * third.rows),
        ]
    )
    steady = abs(complex(np.mean(force))) / (COMPATIBILITY_STEADY * float(np.std(force)) + 1.0)
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
    every = max(1, observed.size // COMPATIBILITY_MOST_SAMPLES)
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
    fitted = rows[:, count:-1] @ (answer / np.where(norms[count:-1] > 0.0, norms[count:-1], 1.0))
    first = rows[:, count]
    slope = float(first @ fitted / max(float(first @ first), 1e-300)) * float(norms[-1])
    return _Fit(
        power * float(rest[:, -1] @ rest[:, -1]), power * float(residual @ residual), slope, table.shape[0]
    )


def _axial(record: PreparedRecord, pieces: list[Readings], correction: Correction) -> tuple[float, float]:
    """True over sensed deceleration, from the change of the speed, and the standard deviation of that.

    Least squares weighted by what else changes the airspeed: wind that wanders, gravity along the path, the normal
    force times the angle of attack it takes, noise. A short or gentle record cannot tell them apart, and has a
    large deviation.
    """
    information, right = 0.0, 0.0
    for piece in pieces:
        every = max(1, piece.time.size // COMPATIBILITY_AXIAL_SAMPLES)
        time = piece.time[::every]
        change, doubt = piece.velocity - piece.velocity[0], COMPATIBILITY_GRAVITY_UNKNOWN
        if piece.altitude is not None:
            fall = np.gradient(_slowly(piece.altitude), piece.time)
            change = change + record.gravity * _running(piece.time, fall / piece.velocity)
            doubt = COMPATIBILITY_GRAVITY_DOUBT
        apart = np.abs(time[:, None] - time) / (COMPATIBILITY_WIND_MEMORY * time[-1])
        covariance = record.wind_sigma**2 * np.exp(-apart) + COMPATIBILITY_ANY_SPEED**2
        covariance += (doubt * record.gravity) ** 2 * np.outer(time, time)
        lift = COMPATIBILITY_LIFT_DOUBT * _slowed_by_lift(record.flight.vehicle, piece)[::every]
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
    stiffness = COMPATIBILITY_NORMAL_SLOPE * piece.dynamic_pressure * vehicle.reference_area / vehicle.mass
    angle = normal / np.maximum(stiffness, np.maximum(normal, 1e-300))
    return _running(piece.time, normal * angle)


def _running(time: FloatArray, values: FloatArray) -> FloatArray:
    """Integral of real `values` (n,) from the first sample on."""
    return np.asarray(_integral(time, values.astype(complex)).real)


def _slowly(values: FloatArray) -> FloatArray:
    """A polynomial through `values` (n,): altitude is noisy, and its rate changes slowly."""
    place = np.linspace(-1.0, 1.0, values.size)
    return np.asarray(np.polyval(np.polyfit(place, values, COMPATIBILITY_ALTITUDE_DEGREE), place), dtype=np.float64)


def _pressure_ratio(flight: Flight, correction: Correction) -> float | None:
    """Recorded over expected dynamic pressure: by the density, or by the altitude in Earth's atmosphere."""
    speed, pressure, height = correction.air
    density = flight.density
    if flight.planet == "earth" and flight.altitude is not None:
        every = max(1, flight.samples // 50)
        altitude = height * flight.altitude[::every]
        expected = 0.5 * atmosphere(altitude, "density") * (speed * flight.velocity[::every]) ** 2
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
    return min(
        0.5 * float(np.log(slope / COMPATIBILITY_NORMAL_SLOPE) / COMPATIBILITY_NORMAL_SPREAD) ** 2,
        COMPATIBILITY_MOST_PER_CHECK,
    )


def _of_steady(size: float) -> float:
    """What a constant force in the body costs: a wrong roll rate or lever arm makes one out of nothing."""
    return min(0.5 * float(np.log(max(size, 1.0))) ** 2, COMPATIBILITY_MOST_PER_CHECK)


def _of_axial(ratio: float, sigma: float) -> float:
    """What a deceleration of `ratio` to that sensed costs: shared by an error of scale and by wind and gravity."""
    logs = np.linspace(-COMPATIBILITY_AXIAL_REACH, COMPATIBILITY_AXIAL_REACH, COMPATIBILITY_AXIAL_STEPS)
    costs = 0.5 * (logs / COMPATIBILITY_AXIAL_SPREAD) ** 2 + 0.5 * ((ratio - np.exp(logs)) / sigma) ** 2
    return min(float(np.min(costs)), COMPATIBILITY_MOST_PER_CHECK)


def _of_pressure(ratio: float | None) -> float:
    return (
        0.0
        if ratio is None
        else min(0.5 * float(np.log(ratio) / COMPATIBILITY_DENSITY_SPREAD) ** 2, COMPATIBILITY_MOST_PER_CHECK)
    )


def _of_noise(sigma: FloatArray) -> float:
    """Three instruments of one make are about equally noisy."""
    if not np.all(sigma > 0.0):
        return 0.0
    logs = np.log(sigma)
    return min(
        0.5 * float(np.sum((logs - np.median(logs)) ** 2)) / COMPATIBILITY_NOISE_SPREAD**2,
        COMPATIBILITY_MOST_OF_NOISE,
    )


# ---- The trial of a record, before anything is fitted to it: `try_record` ----


MOST_OTHERS = 2  # corrections named beside the best
UNRELATED_WORDS = (
    "{share:.0f} % of what the accelerometers sense across the axis does not follow from the gyros and the speed, "
    "where noise leaves {noise:.1g} %, and no mistake of sign, axis or unit that was tried clearly explains it: "
    "axes and signs of the gyros are in doubt, or gusts and controls move the vehicle more than "
    "its own motion does. Check the map, or take another window (--start, --stop)"
)


def try_record(flight: Flight) -> tuple[Flight, RecordTrial]:
    """The flight with faulty stretches masked (the same object where there are none), and what the trial found.

    Never raises: a fault that leaves too little of a channel is reported as decisive, and the channel left as it is;
    so is a flight that is no valid record, or of which masking leaves nothing. A window of a sound record that is too
    short for any record is not tried.
    """
    if flight.time.size < MINIMUM_SAMPLES:
        return flight, RecordTrial(sound=True, faults=())
    try:
        masked, faults = masked_flight(flight)
    except FlightRecordError as error:
        unusable = _fault(flight, "record", "unusable", str(error))
        return flight, RecordTrial(sound=False, faults=(*flight.faults, unusable))
    with threadpool_limits(limits=1, user_api="blas"):  # the matrices are small: threads only cost
        found = (*faults, *_contradictions(averaged(masked)))
    trial = RecordTrial(sound=not any(fault.decisive for fault in found), faults=found)
    return (masked if masked.faults == faults else replace(masked, faults=faults)), trial


def _contradictions(flight: Flight) -> tuple[RecordFault, ...]:
    """The mistake whose correction restores the record best; and whether the gyros contradict it even so."""
    record = prepared(flight)
    if not record.segments:
        return ()
    as_read = compatibility_of(record, AS_IT_IS)
    broken = _broken(as_read)
    if not broken:
        return ()
    found = []
    least = COMPATIBILITY_DECISIVE if set(broken) - {"path, strained"} else COMPATIBILITY_DECISIVE_IF_STRAINED
    ranked = _ranked(record, as_read)
    corrected = ranked[0][2]
    likely = [
        correction
        for correction, gain, after in ranked
        if gain >= max(least, ranked[0][1] - COMPATIBILITY_NEARLY_EQUAL) and _corrects(after, as_read, broken)
    ]
    if likely and likely[0] is ranked[0][0]:
        found.append(_named(flight, likely))
    if "path" in broken and _unrelated(as_read) and (not found or _unrelated(corrected)):
        words = UNRELATED_WORDS.format(share=100.0 * as_read.left[0], noise=100.0 * as_read.noise[0])
        found.append(_fault(flight, "p, q, r, ay, az", "axes", words))
    return tuple(found)


def _ranked(record: PreparedRecord, as_read: Compatibility) -> list[tuple[Correction, float, Compatibility]]:
    """Every correction with what it gains and leaves, the best first."""
    tried = [(one, compatibility_of(record, one)) for one in corrections()]
    ranked = [(one, after.better_than(as_read), after) for one, after in tried]
    return sorted(ranked, key=lambda entry: -entry[1])


def _named(flight: Flight, likely: Sequence[Correction]) -> RecordFault:
    """The fault of the likeliest correction; others that restore the record nearly as well are named."""
    best, others = likely[0], likely[1 : 1 + MOST_OTHERS]
    nearly = f" (nearly as likely: {'; or '.join(one.words for one in others)})" if others else ""
    action = f"{best.words}{nearly}: correct the map"
    return _fault(flight, best.channel, best.fault, action)


def _broken(found: Compatibility) -> Sequence[str]:
    """The checks that the record fails by more than any tolerance."""
    failed = []
    beyond_noise = found.left[0] - COMPATIBILITY_TIMES_NOISE * found.noise[0]
    if found.informative[0] and beyond_noise > COMPATIBILITY_STRAINED:
        failed.append("path" if beyond_noise > COMPATIBILITY_BROKEN else "path, strained")
    if not found.informative[0] and found.informative[2] and found.left[2] > COMPATIBILITY_BROKEN_ALONE:
        failed.append("gyros")
    doubt = COMPATIBILITY_AXIAL_SIGMAS * found.axial_sigma
    if found.axial + doubt < COMPATIBILITY_AXIAL_WITHIN[0] or found.axial - doubt > COMPATIBILITY_AXIAL_WITHIN[1]:
        failed.append("axial")
    if (
        found.pressure is not None
        and not COMPATIBILITY_PRESSURE_WITHIN[0] < found.pressure < COMPATIBILITY_PRESSURE_WITHIN[1]
    ):
        failed.append("pressure")
    if (
        found.normal_slope is not None
        and not COMPATIBILITY_NORMAL_WITHIN[0] < found.normal_slope < COMPATIBILITY_NORMAL_WITHIN[1]
    ):
        failed.append("slope")
    return failed


def _corrects(corrected: Compatibility, as_read: Compatibility, broken: Sequence[str]) -> bool:
    """Whether a correction restores any of the broken checks, and breaks no other."""
    still = set(_broken(corrected))
    if corrected.left[0] < COMPATIBILITY_CORRECTED * as_read.left[0]:
        still -= {"path", "path, strained"}
    if corrected.left[2] < COMPATIBILITY_CORRECTED * as_read.left[2]:
        still.discard("gyros")
    return still < set(broken)


def _unrelated(found: Compatibility) -> bool:
    """Whether much of each instrument does not follow from the others, though noise would let it."""
    conclusive = found.informative & (found.noise < COMPATIBILITY_QUIET)
    return bool(conclusive[0] and (found.left[conclusive] > COMPATIBILITY_UNRELATED).all())


def _fault(flight: Flight, channel: str, fault: str, action: str) -> RecordFault:
    return RecordFault(channel, fault, float(flight.time[0]), float(flight.time[-1]), action, decisive=True)
