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
the tolerances of any instrument explain, and undoing one mistake of sign, axis or unit restores it; or where it breaks
the physics of any vehicle (brv_hypo/flight/plausibility.py).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from brv_hypo import thresholds as limits
from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.errors import FlightRecordError
from brv_hypo.flight import plausibility
from brv_hypo.flight.derived import ALTITUDE_FOLLOWS, DENSITY_FOLLOWS, PRESSURE_FOLLOWS, atmosphere, averaged
from brv_hypo.flight.format import masked_flight
from brv_hypo.flight.record import ACCELEROMETERS, GYROS, Flight, RecordFault, RecordTrial, Vehicle
from brv_hypo.motion.inertial import arm_acceleration, body_attitude, gravity_magnitude
from brv_hypo.motion.signals import differentiated, white_noise_level

COMPATIBILITY_FEWEST_SAMPLES = 64  # of a segment that is judged
COMPATIBILITY_ALTITUDE_DEGREE = 3  # of the polynomial through the altitude: it is noisy, and its rate changes slowly
COMPATIBILITY_WIND_MEMORY = 0.5  # of a segment, over which wind is correlated
COMPATIBILITY_GRAVITY = 10.0  # m/s^2, of a planet that is not known
COMPATIBILITY_GRAVITY_DOUBT = 0.2  # 1-sigma share of gravity along the path that the altitude leaves open
COMPATIBILITY_GRAVITY_UNKNOWN = 1.0  # the same without altitude: all of it
# 1-sigma of the deceleration by lift, in what it is where the force has the slope of any body.
COMPATIBILITY_LIFT_DOUBT = 1.0
COMPATIBILITY_ANY_SPEED = 1e3  # m/s, 1-sigma of the speed that a segment starts with: open
PRESSURE_COMPARED = 50  # samples about, at which pressure and altitude are compared
COMPATIBILITY_AXIAL_SAMPLES = 60  # that give the deceleration; the time goes with their cube
COMPATIBILITY_AXIAL_REACH = 4.0 * limits.COMPATIBILITY_AXIAL_SPREAD  # logarithms of it that are tried
COMPATIBILITY_AXIAL_STEPS = 41  # values tried, a fifth of a spread apart
COMPATIBILITY_MOST_PER_CHECK = 6.0  # -ln likelihood that no single check counts beyond
COMPATIBILITY_MOST_OF_NOISE = 3.0  # the same for each triad's noise
TUMBLING_PARTS = 8  # of a segment, over each of which the nose points somewhere on average: the path turns as well

# ---- What may be wrong with a record's signs, axes and units, each as the correction that undoes it ----


DEGREES = 180.0 / np.pi  # deg in a rad
RPM = 6.0  # deg/s in a revolution per minute
KNOT = 1852.0 / 3600.0  # m/s in a knot (international, 1929)
PSI_IN_KPA = 144.0 * plausibility.PSF / 1e3  # kPa in a lbf/in^2

_INSTRUMENTS: dict[str, tuple[str, ...]] = {
    "gyros": GYROS,
    "accelerometers": ACCELEROMETERS,
    "air data": ("velocity", "dynamic_pressure", "altitude"),
}
_TRIADS = ("gyros", "accelerometers")
_OF_RATES = (("p",), ("q",), ("r",), GYROS)
_OF_FORCES = (("ax",), ("ay",), ("az",), ACCELEROMETERS)
# Which channels of an instrument may be in another unit, the factor, and the mistake either way.
_UNITS: tuple[tuple[str, tuple[tuple[str, ...], ...], float, str, str], ...] = (
    ("gyros", _OF_RATES, DEGREES, "rad/s tagged deg/s", "deg/s tagged rad/s"),
    ("gyros", _OF_RATES, RPM, "rpm tagged deg/s", "deg/s tagged rpm"),
    ("gyros", _OF_RATES, DEGREES / RPM, "rad/s tagged rpm", "rpm tagged rad/s"),
    ("accelerometers", _OF_FORCES, plausibility.GRAVITY, "g tagged m/s^2", "m/s^2 tagged g"),
    ("accelerometers", _OF_FORCES, 1.0 / plausibility.FEET, "m/s^2 tagged ft/s^2", "ft/s^2 tagged m/s^2"),
    ("air data", (("velocity",),), 1.0 / plausibility.FEET, "m/s tagged ft/s", "ft/s tagged m/s"),
    ("air data", (("velocity",),), 1.0 / KNOT, "m/s tagged knots", "knots tagged m/s"),
    ("air data", (("dynamic_pressure",),), plausibility.PSF, "lbf/ft^2 tagged Pa", "Pa tagged lbf/ft^2"),
    ("air data", (("dynamic_pressure",),), PSI_IN_KPA, "lbf/in^2 tagged kPa", "kPa tagged lbf/in^2"),
    ("air data", (("altitude",),), 1.0 / plausibility.FEET, "m tagged ft", "ft tagged m"),
    ("air data", (("velocity", "altitude"),), 1.0 / plausibility.FEET, "metres tagged feet", "feet tagged metres"),
)
MOST_OTHERS = 2  # corrections named beside the best
UNRELATED_WORDS = (
    "{share:.0f} % of the transverse acceleration does not follow from gyros and speed (noise: {noise:.1g} %), and no "
    "mistake of sign, axis or unit clearly explains it: axes and signs of the gyros are in doubt. Check the map; gusts "
    "or controls may do it too (--start, --stop)"
)


@dataclass(frozen=True)
class Correction:
    """What undoes a mistake: the factors from what a record reads to what it should read."""

    channels: tuple[str, ...]  # those at fault
    fault: str  # its kind: sign, axes or units
    words: str  # how the channels read, in a sentence
    # by instrument (3, 3), times its channels; an instrument that is left out reads as it should
    factors: Mapping[str, FloatArray]
    changes: int = 1  # how many separate mistakes would have been made


AS_IT_IS = Correction((), "", "", {}, changes=0)


def corrections() -> Iterator[Correction]:
    """Every mistake that is tried, the simplest first."""
    for triad in _TRIADS:
        for name in _INSTRUMENTS[triad]:
            words = f"{name} reads as if its sign were flipped"
            yield Correction((name,), "sign", words, _scaled(triad, (name,), -1.0))
    for triad in _TRIADS:
        for i, j in ((1, 2), (0, 1), (0, 2)):
            one, other = (_INSTRUMENTS[triad][k] for k in (i, j))
            matrix = np.eye(3)
            matrix[[i, j]] = matrix[[j, i]]
            yield Correction((one, other), "axes", f"{one} and {other} read as if they were exchanged", {triad: matrix})
    for instrument, groups, factor, *mislabels in _UNITS:
        for value, mislabel in zip((factor, 1.0 / factor), mislabels, strict=True):
            for chosen in groups:
                verb = "reads as if it were" if len(chosen) == 1 else "read as if they were"
                words = f"{(' and ' if len(chosen) == 2 else ', ').join(chosen)} {verb} {mislabel}"
                yield Correction(chosen, "units", words, _scaled(instrument, chosen, value))
    # The other ways in which transverse gyros can be mounted to transverse accelerometers, those of two mistakes or
    # more. Turning both triads together changes nothing that can be observed.
    for matrix in plausibility.relative_turns():
        swapped = matrix[1, 1] == 0.0
        flipped = [name for name, sign in zip(GYROS, matrix.sum(axis=1), strict=True) if sign < 0.0]
        changes = len(flipped) + swapped
        if changes > 1:
            mistakes = ["q and r were exchanged"] if swapped else []
            if flipped:
                mistakes.append(f"the sign of {' and '.join(flipped)} flipped")
            at_fault = tuple(name for name in GYROS if name in flipped or (swapped and name != "p"))
            words = f"axes and signs of the gyros are in doubt: they read as if {', and '.join(mistakes)}"
            yield Correction(at_fault, "axes", words, {"gyros": matrix}, changes)


def _scaled(instrument: str, chosen: Sequence[str], factor: float) -> dict[str, FloatArray]:
    """Factors that scale some channels of an instrument."""
    return {instrument: np.diag([factor if name in chosen else 1.0 for name in _INSTRUMENTS[instrument]])}


# ---- The relations ----


@dataclass(frozen=True)
class Readings:
    """What the instruments of a record of n samples read, SI, each three channels as `_INSTRUMENTS` names them."""

    time: FloatArray  # (n,) s
    channels: Mapping[str, FloatArray]  # by instrument (3, n); an altitude that the record has not is nought
    change: FloatArray  # derivatives of the rates (3, n); zero where the accelerometers are at the c.g. and need none
    sigma: Mapping[str, FloatArray]  # white noise of the channels (3,)
    has_altitude: bool  # recorded, or derived from a density
    derived: frozenset[str]  # which of density, dynamic pressure and altitude follow from the speed

    @classmethod
    def of(cls, flight: Flight) -> Readings:
        """Those of a flight, its rates differentiated once for all corrections."""
        known = {name: getattr(flight, name) for names in _INSTRUMENTS.values() for name in names}
        has_altitude = known["altitude"] is not None
        known["altitude"] = known["altitude"] if has_altitude else np.zeros(flight.samples)
        channels = {each: np.stack([known[name] for name in names]) for each, names in _INSTRUMENTS.items()}
        sigma = {
            each: np.array([white_noise_level(channel, flight.segments) for channel in triad])
            for each, triad in channels.items()
        }
        change = np.zeros_like(channels["gyros"])
        if any(flight.vehicle.accelerometer_position):
            change = np.stack([differentiated(flight, channel).rate.real for channel in channels["gyros"]])
        follow = {"density": DENSITY_FOLLOWS, "dynamic_pressure": PRESSURE_FOLLOWS, "altitude": ALTITUDE_FOLLOWS}
        derived = frozenset(name for name, note in follow.items() if any(n.startswith(note) for n in flight.notes))
        return cls(flight.time, channels, change, sigma, has_altitude, derived)

    def corrected(self, correction: Correction) -> Readings:
        """Those of the record without the mistake."""
        channels, sigma, change = dict(self.channels), dict(self.sigma), self.change
        for each, factor in correction.factors.items():
            channels[each], sigma[each] = factor @ channels[each], np.sqrt(factor**2 @ sigma[each] ** 2)
            change = factor @ change if each == "gyros" else change
            if each == "air data" and "dynamic_pressure" in self.derived:  # it was made of the speed squared
                channels[each][1] *= factor[0, 0] ** 2
        return replace(self, channels=channels, sigma=sigma, change=change)

    def segment(self, first: int, stop: int) -> Readings:
        """Those of some samples, whose time is counted from the first."""
        channels = {each: triad[:, first:stop] for each, triad in self.channels.items()}
        time = self.time[first:stop] - self.time[first]
        return replace(self, time=time, channels=channels, change=self.change[:, first:stop])


@dataclass(frozen=True)
class Compatibility:
    """How a record keeps to the three relations."""

    left: FloatArray  # share (3,) of each relation that is not explained; 1 where the slope has the wrong sign
    noise: FloatArray  # share (3,) that white noise alone makes of it
    informative: BoolArray  # whether the record determines it (3,)
    normal_slope: float | None  # C_N per rad by relation 1
    axial: float  # true over sensed deceleration
    axial_sigma: float  # its standard deviation; inf where the record does not give it
    pressure: float | None  # recorded over expected dynamic pressure
    cost: float  # -ln likelihood of all but the relations

    def better_than(self, other: Compatibility) -> float:
        """By how much ln likelihood is higher, over the relations that can be judged under both."""
        both = self.informative & other.informative
        before, after = (
            np.log(np.maximum(one.left, np.maximum(limits.COMPATIBILITY_KEPT, one.noise))) for one in (other, self)
        )
        return float(np.sum((before - after)[both])) + other.cost - self.cost


def compatibility_of(flight: Flight, readings: Readings, correction: Correction) -> Compatibility:
    """How well what a flight reads, corrected, keeps to the relations."""
    readings = readings.corrected(correction)
    pieces = [readings.segment(*segment) for segment in _long_segments(flight)]
    relations = [_relations(flight.vehicle, piece) for piece in pieces]
    total = np.sum([squares for squares, _, _ in relations], axis=0)
    size = np.maximum(total[:, 0], 1e-300)
    noise = total[:, 2] / size
    informative = (total[:, 0] > 0.0) & (noise < limits.COMPATIBILITY_TOO_NOISY)
    left = np.where(informative, np.clip(total[:, 1] / size, 0.0, 1.0), 1.0)
    slope = None
    if informative[0]:
        weight = np.array([squares[0, 0] for squares, _, _ in relations])
        slope = float(weight @ np.array([each for _, each, _ in relations]) / np.sum(weight))
        lowest, least, _ = limits.COMPATIBILITY_NORMAL_WITHIN
        # Where that of a blunt body is next to nothing, errors of the record may make it negative.
        slope = None if slope < lowest else max(slope, least)
        left[0] = left[0] if slope else 1.0
    (axial, axial_sigma), pressure = _axial(flight, pieces), _pressure_ratio(flight, readings)
    # The axial force may differ by an error of scale, and by wind and gravity.
    logs = np.linspace(-COMPATIBILITY_AXIAL_REACH, COMPATIBILITY_AXIAL_REACH, COMPATIBILITY_AXIAL_STEPS)
    of_axial = 0.5 * (logs / limits.COMPATIBILITY_AXIAL_SPREAD) ** 2 + 0.5 * ((axial - np.exp(logs)) / axial_sigma) ** 2
    # Three instruments of one make are about equally noisy.
    noisy = [np.log(readings.sigma[triad]) for triad in _TRIADS if np.all(readings.sigma[triad] > 0.0)]
    squares = (float(np.sum((each - np.median(each)) ** 2)) for each in noisy)
    of_noise = sum(min(0.5 * s / limits.COMPATIBILITY_NOISE_SPREAD**2, COMPATIBILITY_MOST_OF_NOISE) for s in squares)
    cost = (
        _of_ratio(slope and slope / limits.COMPATIBILITY_NORMAL_SLOPE, limits.COMPATIBILITY_NORMAL_SPREAD)
        + min(float(np.min(of_axial)), COMPATIBILITY_MOST_PER_CHECK)
        + _of_ratio(pressure, limits.COMPATIBILITY_DENSITY_SPREAD)
        # A wrong roll rate or lever arm makes a constant force in the body out of nothing.
        + _of_ratio(max([1.0, *(steady for _, _, steady in relations)]), 1.0)
        + of_noise
        + limits.COMPATIBILITY_FURTHER_MISTAKE * max(correction.changes - 1, 0)
    )
    return Compatibility(left, noise, informative, slope, axial, axial_sigma, pressure, cost)


def tumbles(flight: Flight, readings: Readings) -> bool:
    """Whether the nose turns so far, by the gyros, that relations linear in the angle are not those of the flight."""
    for piece in (readings.segment(*segment) for segment in _long_segments(flight)):
        p, q, r = piece.channels["gyros"]
        _, attitude = body_attitude(piece.time, p, q + 1j * r)
        for nose in np.array_split(attitude[..., 0], TUMBLING_PARTS):
            mean = np.mean(nose, axis=0)
            if np.min(nose @ mean) < np.cos(np.radians(limits.COMPATIBILITY_TUMBLING)) * np.linalg.norm(mean):
                return True
    return False


def _long_segments(flight: Flight) -> list[tuple[int, int]]:
    return [(a, b) for a, b in flight.segments if b - a >= COMPATIBILITY_FEWEST_SAMPLES]


def _relations(vehicle: Vehicle, piece: Readings) -> tuple[FloatArray, float, float]:
    """Of one segment, squares (3, 3) of each relation to be explained, not explained, and of noise; C_N per rad; and a
    constant force in the body over what varies of it.
    """
    time, rates, (velocity, pressure, _) = piece.time, piece.channels["gyros"], piece.channels["air data"]
    roll = plausibility.integral(time, rates[0])
    turn, spin = np.exp(1j * roll), np.exp(1j * (1.0 - vehicle.inertia_ratio) * roll)
    omega, omega_change = rates[1] + 1j * rates[2], piece.change[1] + 1j * piece.change[2]
    swing = arm_acceleration(rates[0], piece.change[0], omega, omega_change, vehicle.accelerometer_position)
    forces = piece.channels["accelerometers"] - swing.T
    axial, force = forces[0], forces[1] + 1j * forces[2]
    path_of_gyros = plausibility.integral(time, 1j * velocity * omega * turn)
    scale = pressure * vehicle.reference_area / vehicle.mass
    tau = 2.0 * time / time[-1] - 1.0
    powers = np.stack([np.ones_like(tau), tau, tau**2])
    rate_noise, noise = (2.0 * float(np.mean(piece.sigma[triad][1:] ** 2)) for triad in _TRIADS)

    first, slope = plausibility.path_into_force(time, rates, forces, velocity, scale, noise)
    # Relation 2, integrated; a moment fixed in the body may come and go.
    body = [plausibility.integral(time, pressure * power * spin) for power in (*powers, tau**3, tau**4)]
    damped = plausibility.integral(time, pressure / velocity * omega * spin)
    ones = np.ones_like(spin)
    ratio = [plausibility.integral(time, 1j * force * spin * power) for power in powers]
    second, _ = plausibility.fitted_slopes(
        rate_noise, omega * spin, ratio, [ones, *body, damped, plausibility.integral(time, axial * spin)]
    )

    # Relation 3, integrated.
    away = spin * np.conj(turn)
    drift = [plausibility.integral(time, pressure / velocity * away * power) for power in powers]
    gyro_crossflow = path_of_gyros / velocity * away
    static = [plausibility.integral(time, -1j * pressure * gyro_crossflow * power) for power in powers]
    third, _ = plausibility.fitted_slopes(rate_noise, omega * spin, static, [ones, *body, damped, *drift])
    steady = abs(complex(np.mean(force))) / (limits.COMPATIBILITY_STEADY * float(np.std(force)) + 1.0)
    return np.array([first, second, third]), slope, steady


def _axial(flight: Flight, pieces: list[Readings]) -> tuple[float, float]:
    """True over sensed deceleration, from the change of the speed, and the standard deviation of that. Least squares
    weighted by what else changes the airspeed: slow wind, gravity along the path, the normal force times the
    angle of attack it takes, noise. A short or gentle record cannot separate them, and has a large deviation.
    """
    information, right = 0.0, 0.0
    gravity = gravity_magnitude(flight) or COMPATIBILITY_GRAVITY
    wind = max(limits.COMPATIBILITY_WIND, limits.COMPATIBILITY_WIND_TOLERANCES * max(flight.instruments.wind))
    for piece in pieces:
        every = max(1, piece.time.size // COMPATIBILITY_AXIAL_SAMPLES)
        time, (velocity, pressure, altitude) = piece.time[::every], piece.channels["air data"]
        axial, y, z = piece.channels["accelerometers"]
        change, doubt = velocity - velocity[0], COMPATIBILITY_GRAVITY_UNKNOWN
        if piece.has_altitude:
            # Altitude is noisy, and its rate changes slowly.
            place = np.linspace(-1.0, 1.0, piece.time.size)
            smooth = np.polyval(np.polyfit(place, altitude, COMPATIBILITY_ALTITUDE_DEGREE), place)
            fall = np.gradient(smooth, piece.time)
            change = change + gravity * plausibility.integral(piece.time, fall / velocity)
            doubt = COMPATIBILITY_GRAVITY_DOUBT
        apart = np.abs(time[:, None] - time) / (COMPATIBILITY_WIND_MEMORY * time[-1])
        covariance = wind**2 * np.exp(-apart) + COMPATIBILITY_ANY_SPEED**2
        covariance += (doubt * gravity) ** 2 * np.outer(time, time)
        # What the normal force f takes of the speed: f^2 over q_inf S C_N / m, and never more than f.
        normal = np.hypot(y, z)
        stiffness = limits.COMPATIBILITY_NORMAL_SLOPE * pressure * flight.vehicle.reference_area / flight.vehicle.mass
        angle = normal / np.maximum(stiffness, np.maximum(normal, 1e-300))
        lift = COMPATIBILITY_LIFT_DOUBT * plausibility.integral(piece.time, normal * angle)[::every]
        covariance += np.outer(lift, lift)
        covariance += piece.sigma["air data"][0] ** 2 * np.eye(time.size)
        sensed = plausibility.integral(piece.time, axial)[::every]
        weighted = np.linalg.solve(covariance, sensed)
        information += float(weighted @ sensed)
        right += float(weighted @ change[::every])
    if not information > 0.0:
        return 1.0, np.inf
    return right / information, float(1.0 / np.sqrt(information))


def _pressure_ratio(flight: Flight, readings: Readings) -> float | None:
    """Recorded over expected dynamic pressure, by density or Earth's altitude; None if neither is known otherwise."""
    velocity, pressure, altitude = readings.channels["air data"]
    if "density" in readings.derived and (readings.derived & {"altitude"} or not readings.has_altitude):
        return None
    if flight.planet == "earth" and readings.has_altitude:
        some = slice(None, None, max(1, flight.samples // PRESSURE_COMPARED))
        density = atmosphere(altitude[some], "density")
    elif flight.density is not None:
        some, density = slice(None), flight.density
    else:
        return None
    ratios = pressure[some] / (0.5 * density * velocity[some] ** 2)
    ratios = ratios[np.isfinite(ratios) & (ratios > 0.0)]
    return float(np.median(ratios)) if ratios.size else None


def _of_ratio(ratio: float | None, spread: float) -> float:
    """What a ratio costs that should be 1, its logarithm of that standard deviation; nothing where it is not known."""
    return 0.0 if ratio is None else min(0.5 * float(np.log(ratio) / spread) ** 2, COMPATIBILITY_MOST_PER_CHECK)


# ---- The trial of a record, before anything is fitted to it: `try_record` ----


def try_record(flight: Flight) -> tuple[Flight, RecordTrial]:
    """The flight with faulty stretches masked (the same object where there are none), and what the trial found. Never
    raises: a fault that leaves too little of a channel is reported as decisive, and the channel left as it is; so is a
    flight that is no valid record, or of which masking leaves nothing; not a window too short for any.
    """
    if flight.time.size < limits.MINIMUM_SAMPLES:
        return flight, RecordTrial(sound=True, faults=())
    try:
        masked, faults = masked_flight(flight)
    except FlightRecordError as error:
        unusable = RecordFault.over(flight.time, "record", "unusable", str(error), decisive=True)
        return flight, RecordTrial(sound=False, faults=(*flight.faults, unusable))
    with threadpool_limits(limits=1, user_api="blas"):  # the matrices are small: threads only cost
        inside, columns = masked.measured(), masked.columns()
        known = {name: np.where(inside, values, np.nan) for name, values in columns.items() if name != "time"}
        physics = plausibility.contradictions(masked.time, known, masked.vehicle, masked.planet == "earth")
        tolerance = max(*masked.instruments.gyro_misalignment, *masked.instruments.accel_misalignment)
        read = {each: np.stack([known[name] for name in _INSTRUMENTS[each]]) for each in _TRIADS}
        place = np.array(masked.vehicle.accelerometer_position), max(masked.instruments.accel_position)
        air = (known["velocity"], known["dynamic_pressure"], *place)
        mistake, contradictions = _contradictions(averaged(masked))
        turned = []  # whether the axes of the unit are not the vehicle's, as it reads and without the mistake
        for one in [AS_IT_IS, *([] if mistake is AS_IT_IS else [mistake])]:
            rates, forces = (one.factors.get(each, np.eye(3)) @ values for each, values in read.items())
            nose = plausibility.nose_axis(masked.time, rates, forces, air)
            turned.append(plausibility.mounting_fault(masked.time, nose, tolerance))
        # Units that alone make the mounting right are the simpler mistake; their effects come after it.
        restores = mistake.fault == "units" and not turned[-1]
        others = (*contradictions, *physics) if restores else (*physics, *(turned[0] or contradictions))
        found = (*faults, *others)
    trial = RecordTrial(sound=not any(fault.decisive for fault in found), faults=found)
    return (masked if masked.faults == faults else replace(masked, faults=faults)), trial


def _contradictions(flight: Flight) -> tuple[Correction, tuple[RecordFault, ...]]:
    """The mistake whose correction restores the record best, and what contradicts it even so."""
    if not _long_segments(flight):
        return AS_IT_IS, ()
    readings = Readings.of(flight)
    as_read = compatibility_of(flight, readings, AS_IT_IS)
    broken = _broken(as_read)
    if not broken:
        return AS_IT_IS, ()
    found, tumbling, best = [], tumbles(flight, readings), AS_IT_IS
    strained = broken == ["path, strained"]
    least = limits.COMPATIBILITY_DECISIVE_IF_STRAINED if strained else limits.COMPATIBILITY_DECISIVE
    unread = "altitude" in readings.derived or not readings.has_altitude
    possible = (one for one in corrections() if not (unread and "altitude" in one.channels))
    tried = [(one, compatibility_of(flight, readings, one)) for one in possible]
    ranked = sorted(((one, after.better_than(as_read), after) for one, after in tried), key=lambda entry: -entry[1])
    corrected = ranked[0][2]
    likely = [
        correction
        for correction, gain, after in ranked
        if gain >= max(least, ranked[0][1] - limits.COMPATIBILITY_NEARLY_EQUAL)
        and _corrects(after, as_read, broken)
        and not (tumbling and tumbles(flight, readings.corrected(correction)))
    ]
    if likely and likely[0] is ranked[0][0]:
        best, others = likely[0], "; or ".join(one.words for one in likely[1 : 1 + MOST_OTHERS])
        nearly = f" (nearly as likely: {others})" if others else ""
        words = f"{best.words}{nearly}: correct the map"
        found.append(RecordFault.over(flight.time, ", ".join(best.channels), best.fault, words, decisive=True))
    if "path" in broken and not tumbling and _unrelated(as_read) and (not found or _unrelated(corrected)):
        words = UNRELATED_WORDS.format(share=100.0 * as_read.left[0], noise=100.0 * as_read.noise[0])
        found.append(RecordFault.over(flight.time, "p, q, r, ay, az", "axes", words, decisive=True))
    return best, tuple(found)


def _broken(found: Compatibility) -> Sequence[str]:
    """The checks that the record fails by more than any tolerance."""
    failed = []
    beyond_noise = found.left[0] - limits.COMPATIBILITY_TIMES_NOISE * found.noise[0]
    if found.informative[0] and beyond_noise > limits.COMPATIBILITY_STRAINED:
        failed.append("path" if beyond_noise > limits.COMPATIBILITY_BROKEN else "path, strained")
    if not found.informative[0] and found.informative[2] and found.left[2] > limits.COMPATIBILITY_BROKEN_ALONE:
        failed.append("gyros")
    for name, value, sigma, (low, high) in (
        ("axial", found.axial, found.axial_sigma, limits.COMPATIBILITY_AXIAL_WITHIN),
        ("pressure", found.pressure, 0.0, limits.COMPATIBILITY_PRESSURE_WITHIN),
        ("slope", found.normal_slope, 0.0, (0.0, limits.COMPATIBILITY_NORMAL_WITHIN[-1])),
    ):
        doubt = limits.COMPATIBILITY_AXIAL_SIGMAS * sigma
        if value is not None and not low - doubt < value < high + doubt:
            failed.append(name)
    return failed


def _corrects(corrected: Compatibility, as_read: Compatibility, broken: Sequence[str]) -> bool:
    """Whether a correction restores any of the broken checks, and breaks no other."""
    still = set(_broken(corrected))
    if corrected.left[0] < limits.COMPATIBILITY_CORRECTED * as_read.left[0]:
        still -= {"path", "path, strained"}
    if corrected.left[2] < limits.COMPATIBILITY_CORRECTED * as_read.left[2]:
        still.discard("gyros")
    return still < set(broken)


def _unrelated(found: Compatibility) -> bool:
    """Whether much of each instrument does not follow from the others, though noise would let it."""
    conclusive = found.informative & (found.noise < limits.COMPATIBILITY_QUIET)
    return bool(conclusive[0] and (found.left[conclusive] > limits.COMPATIBILITY_UNRELATED).all())
