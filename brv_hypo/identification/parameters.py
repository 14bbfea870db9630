"""What the likelihood estimates of a regression model: a coefficient for each regressor, and what moves regressors.

Nonlinear parameters are the delays and other thetas of mechanisms and the knots (s) at which coefficients
change. `structure_of` names all of them; `Structure.at` has the regressors at given values.

A knot between two nodes is integrated as if it were on one. Hermite-Simpson weighs the ends of an interval by
1/6 and its middle by 4/6, and assumes that all is smooth. Where a moment g(t) jumps in within the interval, the
middle is given the value that makes the rule exact for a quadratic g: with a and b of `kink`, the rate of the
angular rate there is (`on_grid`) g - a g' + b g'', and the angular rate itself gains a g - 2 b g'. The states at
the nodes are then those of the sharp jump, and smooth in the time of the knot.

Errors of record, vehicle and air within their tolerances, as parameters of every hypothesis.

A record effect is linearised once, about the record that noise-free instruments would have made of the fitted
motion (`noise_free_flights`): half the difference of the records at plus and minus one sigma of a component, by
channel, becomes a history of the errors that the equations of motion and of measurement have (GYROS,
ACCELEROMETERS, CROSSFLOW, ...). A moment that has a tolerance is one more such history. Each parameter counts
sigmas, its prior is the unit Gaussian, and the equations are linear in it (`record_errors`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import chain
from typing import Any, Literal

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline, PPoly

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from brv_hypo.flight.record import Flight, Vehicle
from brv_hypo.inference.fit import Regressed
from brv_hypo.likelihood import TimeVaryingParameter
from brv_hypo.likelihood.segment import SampledParameter
from brv_hypo.linearisation.frame import RateFrame
from brv_hypo.mechanisms.checked import checked
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.mechanisms.registry import nuisance_effects, nuisance_mechanisms
from brv_hypo.model.baseline import StaticBend
from brv_hypo.model.common_time import OwnTime
from brv_hypo.model.term import Regressor, TimeBasis, theta_grid
from brv_hypo.motion.inertial import arm_acceleration
from brv_hypo.motion.inputs import SmoothInputs
from brv_hypo.motion.interpolation import running_integral
from brv_hypo.motion.motion import crossflow, effective
from brv_hypo.motion.signals import InputError

Kind = Literal["theta", "start", "stop"]
_ROUNDING = 1e-9


@dataclass(frozen=True)
class NonlinearParameter:
    """A nonlinear parameter and the columns that it moves: a theta of a mechanism, or a knot (s)."""

    name: str
    kind: Kind
    theta: str  # its name in theta; empty for a knot
    mechanism: str
    value: float  # `scale` times that in `units`, as are the bounds: delays are estimated in s
    bounds: tuple[float, float]
    units: str
    is_delay: bool
    columns: tuple[int, ...]
    scale: float = 1.0
    origin: float = 0.0  # the first time of the record for knots: differences step by a parameter's size

    @property
    def label(self) -> str:
        """Its name without its start value."""
        return f"{self.mechanism} {self.theta or self.kind}"


@dataclass(frozen=True)
class Structure:
    """The columns of a regression model with names for all that is to be estimated."""

    columns: tuple[Regressor, ...]
    names: tuple[str, ...]  # of the coefficients, in the order of `columns`
    nonlinear_parameters: tuple[NonlinearParameter, ...]
    fixed_delays: Mapping[str, float]  # s, those of mechanisms without a parameter

    @cached_property
    def delays(self) -> tuple[str, ...]:
        """Names of all delays."""
        free = (parameter.name for parameter in self.nonlinear_parameters if parameter.is_delay)
        return (*free, *self.fixed_delays)

    @cached_property
    def knots(self) -> tuple[str, ...]:
        """Names of the parameters that are knots."""
        return tuple(parameter.name for parameter in self.nonlinear_parameters if parameter.kind != "theta")

    def at(self, theta: Mapping[str, float]) -> tuple[Regressor, ...]:
        """The columns with delays and knots at the values in `theta`; those it lacks stay where they were."""
        columns = list(self.columns)
        for parameter in self.nonlinear_parameters:
            value = theta.get(parameter.name, parameter.value)
            for j in parameter.columns:
                columns[j] = _moved(columns[j], parameter, value)
        return tuple(columns)

    def values(self, theta: Mapping[str, float]) -> FloatArray:
        """Coefficients (columns,) in `theta`."""
        return np.array([theta[name] for name in self.names])


def structure_of(
    columns: Sequence[Regressor],
    mechanisms: Mapping[str, Mechanism],
    span: tuple[float, float],
    delays: Sequence[float],
) -> Structure:
    """Name the parameters; knots are free between the ends of `span` (s), where they lie inside. Columns that share a
    theta or a knot of one mechanism move together. `delays`: all those of mechanisms, s.
    """
    names, nonlinear = unique([*map(_name, columns)]), _nonlinear_parameters(columns, mechanisms, *span)
    free = [parameter.value for parameter in nonlinear if parameter.is_delay]
    fixed = {f"delay {delay:.6g} s": delay for delay in delays if not np.any(np.isclose(delay, free, rtol=1e-9))}
    return Structure(tuple(columns), names, nonlinear, fixed)


def _name(column: Regressor) -> str:
    """Mechanism and term, its beginning and its delay."""
    name = f"{column.mechanism} {column.term}"
    if column.time_basis.kind != "constant":
        name += f" {column.time_basis.kind} at {column.time_basis.start:.6g} s"
    if column.delay is not None:
        name += f", delay {column.delay:.6g} s"
    return name


def unique(names: Sequence[str]) -> tuple[str, ...]:
    """The names, a number after each that stood before."""
    counts = [names[:k].count(name) + 1 for k, name in enumerate(names)]
    return tuple(name if count == 1 else f"{name} ({count})" for name, count in zip(names, counts, strict=True))


def of_flight(name: str, flight: int) -> str:
    """The parameter's name for one flight: each flight has its own instruments."""
    return f"{name} [flight {flight}]"


def input_error(error: InputError, flight: int) -> TimeVaryingParameter:
    """What smoothing left of an input's noise, under the name by which the equations of motion have it."""
    name = of_flight(error.name, flight)
    return TimeVaryingParameter(name, tuple(f"{name} {k}" for k in range(error.count)), error.shapes)


def _nonlinear_parameters(
    columns: Sequence[Regressor], mechanisms: Mapping[str, Mechanism], start: float, stop: float
) -> tuple[NonlinearParameter, ...]:
    groups: dict[tuple[Kind, str, str, float], list[int]] = {}
    for j, column in enumerate(columns):
        for name, value in column.theta:
            groups.setdefault(("theta", column.mechanism, name, value), []).append(j)
        knots: tuple[tuple[Kind, float], ...] = (("start", column.time_basis.start), ("stop", column.time_basis.stop))
        for kind, knot in knots:
            if start < knot < stop:
                groups.setdefault((kind, column.mechanism, "", knot), []).append(j)
    found = []
    for (kind, mechanism, theta, value), members in groups.items():
        units, scale, origin, bounds, is_delay = "s", 1.0, start, (0.0, stop - start), False
        if kind == "theta":
            own = next(p for p in mechanisms[mechanism].parameters() if p.name == theta)
            units, is_delay = own.units, own.is_delay
            scale, origin = own.seconds if is_delay else 1.0, 0.0
            bounds = (scale * min(own.bounds[0], value), scale * max(own.bounds[1], value))
        found.append(
            NonlinearParameter(
                name=f"{mechanism} {theta} {value:.6g}" if theta else f"{mechanism} {kind} {value:.6g} s",
                kind=kind,
                theta=theta,
                mechanism=mechanism,
                value=scale * value - origin,
                bounds=bounds,
                units=units,
                is_delay=is_delay,
                columns=tuple(members),
                scale=scale,
                origin=origin,
            )
        )
    names = unique([parameter.name for parameter in found])
    return tuple(replace(parameter, name=name) for parameter, name in zip(found, names, strict=True))


def _moved(column: Regressor, parameter: NonlinearParameter, value: float) -> Regressor:
    if parameter.kind == "theta":
        theta = tuple((key, value / parameter.scale if key == parameter.theta else old) for key, old in column.theta)
        return replace(column, theta=theta)
    knot: dict[str, Any] = {parameter.kind: parameter.origin + value}
    return replace(column, time_basis=replace(column.time_basis, **knot))


def placed(
    time_basis: TimeBasis, time: FloatArray, half: FloatArray, own: OwnTime | None
) -> tuple[TimeBasis, FloatArray, FloatArray]:
    """A time basis, times and intervals that go together, where time bases are in a time that flights share. What jumps
    does so at the flight's own time; what ramps does so with the common one, of constant pace.
    """
    if own is None:
        return time_basis, time, half
    if time_basis.kind == "ramp":
        return time_basis, own.common_at(time), half * own.pace_at(time)
    return replace(time_basis, start=own.own_at(time_basis.start), stop=own.own_at(time_basis.stop)), time, half


def on_grid(time_basis: TimeBasis, time: FloatArray, half: FloatArray) -> FloatArray:
    """The time basis at `time` (n,) s; `half` (n,) s is half the interval at its midpoints, 0 at nodes."""
    edge = _ramp if time_basis.kind == "ramp" else _step
    return edge(time - time_basis.start, half) - edge(time - time_basis.stop, half)


def averaged(time_basis: TimeBasis, time: FloatArray, width: FloatArray | float) -> FloatArray:
    """Mean of the time basis over `width` s about `time` (n,) s: that of a block of samples."""
    if time_basis.kind == "ramp":
        return time_basis(time)
    begun, ended = (np.clip((time - knot) / width + 0.5, 0.0, 1.0) for knot in (time_basis.start, time_basis.stop))
    return np.asarray(begun - ended)


def kink(time_basis: TimeBasis, time: FloatArray, half: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The weights a (n,) s and b (n,) s^2 in the middle of the interval of a jump; 0 elsewhere."""
    first, second = np.zeros_like(time), np.zeros_like(time)
    knots = () if time_basis.kind == "ramp" else ((time_basis.start, 1.0), (time_basis.stop, -1.0))
    for knot, sign in knots:
        inside = _holds_knot(time - knot, half)
        step = 2.0 * half[inside]
        off = (time[inside] - knot) / step
        first[inside] += sign * step / 4.0 * (3.0 * off**2 - 0.25)
        second[inside] += sign * step**2 / 4.0 * off**3
    return first, second


def _step(since: FloatArray, half: FloatArray) -> FloatArray:
    sharp = (since >= -_ROUNDING).astype(float)
    inside = _holds_knot(since, half)
    share = (since[inside] + half[inside]) / (2.0 * half[inside])
    sharp[inside] = (6.0 * share - 1.0) / 4.0
    return sharp


def _ramp(since: FloatArray, half: FloatArray) -> FloatArray:
    sharp = np.maximum(since, 0.0)
    inside = _holds_knot(since, half)
    end = since[inside] + half[inside]
    sharp[inside] = (3.0 * end**2 / (2.0 * half[inside]) - end) / 4.0
    return sharp


def _holds_knot(since: FloatArray, half: FloatArray) -> BoolArray:
    """Midpoints whose interval holds the knot; a knot on a node belongs to the interval that it ends."""
    return np.asarray((half > 0.0) & (since >= -half - _ROUNDING) & (since < half - _ROUNDING))


# ---- Errors of record, vehicle and air within their tolerances ----


def noise_free_flights(
    frame: RateFrame, predicted: ComplexArray, moments: ComplexArray, inputs: Sequence[SmoothInputs]
) -> tuple[Flight, ...]:
    """The flights as noise-free instruments would have read them, axial force and gaps as measured. `predicted` (rows,)
    rad/s are de-rolled rates and `moments` (rows,) the C_m + i C_n of a regression; `inputs`: theirs.
    """
    found = []
    flights = zip(frame.reconstructions, frame.motions, inputs, strict=True)
    for number, (reconstruction, motion, smooth) in enumerate(flights):
        flight, vehicle = reconstruction.flight, reconstruction.flight.vehicle
        rate, force = flight.q + 1j * flight.r, flight.ay + 1j * flight.az
        spin = np.exp(-1j * (1.0 - vehicle.inertia_ratio) * running_integral(flight.time, flight.p))
        rolling = CubicSpline(flight.time, smooth.roll_rate)(flight.time, 1)
        xi, slope = crossflow(motion.alpha, motion.windward_meridian), np.nan_to_num(reconstruction.normal_force_ratio)
        aerodynamic = -smooth.pressure * (vehicle.reference_area / vehicle.mass) * slope * effective(xi)
        for part, (a, b) in zip(frame.segments, frame.pieces, strict=True):
            if part.flight == number:
                rows, level = part.rows, np.mean(part.observed - predicted[a:b])
                rate[rows] = (predicted[a:b] + level) * spin[rows]
                p, omega = smooth.roll_rate[rows], rate[rows]
                change = smooth.pressure[rows] * vehicle.moment_scale * moments[a:b]
                change = change - 1j * (1.0 - vehicle.inertia_ratio) * p * omega
                lever = lever_force(vehicle.accelerometer_position, omega, change, p, rolling[rows])
                force[rows] = aerodynamic[rows] + lever
        flight = replace(flight, p=smooth.roll_rate, velocity=smooth.speed, dynamic_pressure=smooth.pressure)
        found.append(replace(flight, q=rate.real, r=rate.imag, ay=force.real, az=force.imag))
    return tuple(found)


def lever_force(
    arm: tuple[float, float, float], omega: ComplexArray, omega_rate: ComplexArray, p: FloatArray, p_rate: FloatArray
) -> ComplexArray:
    """omega_dot x r + omega x (omega x r) across the body, f_y + i f_z in m/s^2 (Appendix B, errata E10, E11)."""
    _, y, z = arm_acceleration(p, p_rate, omega, omega_rate, arm).T
    return np.asarray(y + 1j * z)


# What the equations know of errors, measured less true: histories by these names.
GYROS = ("error of q", "error of r")  # rad/s that the transverse gyros read beyond the truth
ACCELEROMETERS = ("error of a_y", "error of a_z")
"""m/s^2, at the declared place, that the transverse accelerometers read beyond the truth."""
ROLL_RATE_ERROR = "error of p"
PRESSURE_ERROR = "error of dynamic pressure"
SPEED_ERROR = "error of speed"
RATIO_ERROR = "error of inertia ratio"
MOMENT_SCALE_ERROR = "error of S d / I"
FORCE_SCALE_ERROR = "error of S / m"  # the last five are shares of the measured value
CROSSFLOW = ("change of v", "change of w")  # m/s^2, de-rolled, that it gains beyond what record and attitude say
MOMENTS = ("change of q", "change of r")  # rad/s^2 in body axes, of moments within their tolerance
OTHERS = (
    *(*CROSSFLOW, *MOMENTS, ROLL_RATE_ERROR, PRESSURE_ERROR, SPEED_ERROR),
    *(RATIO_ERROR, MOMENT_SCALE_ERROR, FORCE_SCALE_ERROR),
)
"""All but what instruments read."""


@dataclass(frozen=True)
class Tolerated:
    """One component of an error that is known to a tolerance: `size` is 1 sigma in `units`."""

    error: str
    component: str
    units: str
    size: float

    @property
    def name(self) -> str:
        """Error and component."""
        return f"{self.error} {self.component}"

    def known(self, regressed: Regressed, flight: int) -> tuple[float, float]:
        """What was taken out of a flight's record and what was found in all, in sizes."""
        key = (self.error, self.component)
        applied, found = (each[flight].get(key, 0.0) for each in (regressed.applied, regressed.found))
        return applied / self.size, found / self.size


Histories = Mapping[str, FloatArray]  # by name, (n,) over a flight's samples; one that it lacks is not touched

RecordErrors = Mapping[Tolerated, Histories]  # what 1 sigma of each tolerated value of a flight does


def error_histories(
    errors: RecordErrors, flight: int, time: FloatArray, samples: slice, turn: ComplexArray, local: IntArray
) -> tuple[TimeVaryingParameter, ...]:
    """The histories of one segment of a flight, at whose `samples` it is `time` (n,) s and exp(i Phi) `turn` (n,). What
    instruments read is averaged as they are: over the blocks `local` (blocks, size), in de-rolled axes.
    """

    def rows(names: Sequence[str]) -> list[SampledParameter]:
        """These histories, of the values that touch any of them."""
        touching = {value: each for value, each in errors.items() if any(name in each for name in names)}
        weights, none = tuple(of_flight(value.name, flight) for value in touching), np.zeros(samples.stop)
        out = []
        for name in names:
            shapes = [histories.get(name, none)[samples] for histories in touching.values()]
            out.append(SampledParameter(of_flight(name, flight), weights, np.reshape(shapes, (-1, time.size))))
        return out

    middle = local[:, local.shape[1] // 2]
    read: list[SampledParameter] = []
    for pair in (GYROS, ACCELEROMETERS):
        first, second = rows(pair)
        projected = ((first.shapes + 1j * second.shapes) * turn)[:, local].mean(axis=2) * np.conj(turn[middle])
        read += [replace(first, shapes=projected.real), replace(second, shapes=projected.imag)]
    others = [each for name in OTHERS for each in rows((name,))]
    return (*_splined(time[middle], read), *_splined(time, others))


def _shapes(spline: PPoly, time: FloatArray) -> FloatArray:
    """The shapes of a history (weights, n) at any times (n,) s."""
    return np.asarray(spline(time).T, dtype=float)


def _splined(time: FloatArray, rows: Sequence[SampledParameter]) -> Iterator[TimeVaryingParameter]:
    """The histories at any times, by cubic splines through `time` (n,) s; those without weights left out."""
    together, last = CubicSpline(time, np.concatenate([each.shapes for each in rows]).T), 0
    for each in rows:
        first, last = last, last + len(each.weights)
        if each.weights:
            own = PPoly.construct_fast(together.c[:, :, first:last], together.x)
            yield TimeVaryingParameter(each.name, each.weights, partial(_shapes, own))


def record_errors(
    frame: RateFrame, noise_free: Sequence[Flight], inputs: Sequence[SmoothInputs], modelled: frozenset[str]
) -> tuple[RecordErrors, ...]:
    """What is known of each flight to a tolerance only, linearised on its noise-free record. Moments of the mechanisms
    `modelled` are the hypothesis's own and take no part; neither does what none of the equations observes, such as the
    bias of an instrument that they do not use.
    """
    found = []
    for number, (flight, smooth) in enumerate(zip(noise_free, inputs, strict=True)):
        gravity, errors = frame.reconstructions[number].gravity_body, dict[Tolerated, Histories]()
        every = chain(_of_effects(flight, gravity, smooth), _of_moments(frame, number, flight, modelled))
        for value, histories in every:
            observed = {name: np.broadcast_to(h, flight.time.shape) for name, h in histories.items() if np.any(h)}
            if observed:
                errors[value] = observed
        found.append(errors)
    return tuple(found)


def _of_effects(
    flight: Flight, gravity: FloatArray, smooth: SmoothInputs
) -> Iterator[tuple[Tolerated, dict[str, FloatArray | float]]]:
    for effect in nuisance_effects():
        for name, units, size in effect.components(flight):
            more, less = (effect.perturb(flight, name, sign * size) for sign in (1.0, -1.0))
            yield Tolerated(effect.name, name, units, size), _histories(flight, more, less, gravity, smooth)


def _histories(
    flight: Flight, more: Flight, less: Flight, gravity: FloatArray, smooth: SmoothInputs
) -> dict[str, FloatArray | float]:
    """What half the difference of two records does in the equations, by name; the true motion stays as it is."""

    def change(quantity: Callable[[Flight], Any]) -> FloatArray:
        return np.asarray(0.5 * (quantity(more) - quantity(less)))

    def share(quantity: Callable[[Vehicle], float]) -> float:
        high, low = quantity(more.vehicle), quantity(less.vehicle)
        return (high - low) / (high + low)

    roll_rate, rate = change(lambda f: f.p), change(lambda f: f.q) + 1j * change(lambda f: f.r)
    force = change(lambda f: f.ay) + 1j * change(lambda f: f.az)
    x, y, z = change(lambda f: np.array(f.vehicle.accelerometer_position)).tolist()
    if any((x, y, z)):
        omega = flight.q + 1j * flight.r
        omega_rate, p_rate = _slope(flight, omega), _slope(flight, flight.p).real
        force = force - lever_force((x, y, z), omega, omega_rate, flight.p, p_rate)
    crossflow = _attitude_error(flight, roll_rate, rate, gravity, smooth)
    wind = change(lambda f: np.zeros((f.samples, 3)) if f.wind is None else f.wind)
    if np.any(wind):
        gained = np.einsum("nji,ni->nj", smooth.gravity_axes, _slope(flight, wind).real)
        crossflow = crossflow + gained[:, 1] + 1j * gained[:, 2]
    pairs = zip((GYROS, ACCELEROMETERS, CROSSFLOW), (rate, force, crossflow), strict=True)
    return {
        **{name: part for names, pair in pairs for name, part in zip(names, (pair.real, pair.imag), strict=True)},
        ROLL_RATE_ERROR: roll_rate,
        PRESSURE_ERROR: change(lambda f: f.dynamic_pressure) / flight.dynamic_pressure,
        SPEED_ERROR: change(lambda f: f.velocity) / flight.velocity,
        RATIO_ERROR: share(lambda vehicle: vehicle.inertia_ratio),
        MOMENT_SCALE_ERROR: share(lambda vehicle: vehicle.moment_scale),
        FORCE_SCALE_ERROR: share(lambda vehicle: vehicle.reference_area / vehicle.mass),
    }


def _attitude_error(
    flight: Flight, roll_rate: FloatArray, rate: ComplexArray, gravity: FloatArray, smooth: SmoothInputs
) -> ComplexArray:
    """What gravity gains in de-rolled axes (n,), m/s^2, as errors of the gyros turn the computed attitude."""
    if not (np.any(roll_rate) or np.any(rate)):
        return np.zeros(flight.samples, dtype=complex)
    derolled = rate * np.exp(1j * smooth.roll)
    first = np.einsum("nji,nj->ni", smooth.gravity_axes, np.stack([roll_rate, derolled.real, derolled.imag], axis=1))
    gained = np.cross(cumulative_trapezoid(first, flight.time, axis=0, initial=0), gravity)
    projected = np.einsum("nji,ni->nj", smooth.gravity_axes, gained)
    return np.asarray(projected[:, 1] + 1j * projected[:, 2])


def _slope(flight: Flight, values: FloatArray | ComplexArray) -> ComplexArray:
    """Derivative of a history (n, ...) by time, each segment by itself; zero in gaps."""
    out = np.zeros(values.shape, dtype=complex)
    for a, b in flight.segments:
        if b - a > 2:
            out[a:b] = np.gradient(values[a:b], flight.step, axis=0, edge_order=2)
    return out


def _of_moments(
    frame: RateFrame, number: int, flight: Flight, modelled: frozenset[str]
) -> Iterator[tuple[Tolerated, dict[str, FloatArray | float]]]:
    """Moments that have a tolerance, as they turn the vehicle on the fitted motion."""
    motion = frame.motions[number]
    acceleration = flight.dynamic_pressure * flight.vehicle.moment_scale
    declared = frame.reconstructions[number].flight
    own = [mechanism for name, mechanism in frame.mechanisms.items() if name == StaticBend.name]
    for mechanism in (*nuisance_mechanisms(declared), *own):
        sizes = mechanism.tolerance(declared)
        if sizes is None or mechanism.name in modelled:
            continue
        terms = checked(mechanism).terms(motion, dict(theta_grid(mechanism)[0]))
        for term, size in zip(terms, sizes, strict=True):
            moment = size * acceleration * motion.to_body(term.in_plane, term.out_of_plane)
            value = Tolerated(mechanism.name, term.name, term.units, size)
            yield value, dict(zip(MOMENTS, (moment.real, moment.imag), strict=True))
