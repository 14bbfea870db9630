"""Errors of record, vehicle and air within their tolerances, as parameters of every hypothesis.

A record effect is linearised once, about the record that noise-free instruments would have made of the fitted
motion (`noise_free_flights`): half the difference of the records at plus and minus one sigma of a component, by
channel, becomes a history of the errors that the equations of motion and of measurement have (GYROS,
ACCELEROMETERS, CROSSFLOW, ...). A moment that has a tolerance is one more such history. Each parameter counts
sigmas, its prior is the unit Gaussian, and the equations are linear in it. `record_errors` is the entrance; a
component that no equation observes is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline, PPoly

from brv_hypo.arrays import ComplexArray, FloatArray, IntArray
from brv_hypo.flight.record import Flight, Vehicle
from brv_hypo.identification.parameters import of_flight
from brv_hypo.likelihood import TimeVaryingParameter
from brv_hypo.mechanisms import Mechanism
from brv_hypo.mechanisms.checked import checked_terms
from brv_hypo.mechanisms.registry import nuisance_effects, nuisance_mechanisms
from brv_hypo.model.baseline import StaticBend
from brv_hypo.model.term import theta_grid
from brv_hypo.motion.inputs import SmoothInputs
from brv_hypo.motion.interpolation import running_integral
from brv_hypo.motion.kinematics import angle_of_attack, crossflow
from brv_hypo.motion.reconstruction import Reconstruction
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.uncertainty import Regressed


def noise_free_flights(
    frame: RateFrame, predicted: ComplexArray, moments: ComplexArray, inputs: Sequence[SmoothInputs]
) -> tuple[Flight, ...]:
    """The flights as noise-free instruments would have read them, axial force and what lies in gaps as measured.

    `predicted` (rows,) rad/s are the de-rolled rates and `moments` (rows,) the C_m + i C_n of a regression; `inputs`
    are each flight's.
    """
    found = []
    for number, (reconstruction, smooth) in enumerate(zip(frame.reconstructions, inputs, strict=True)):
        flight = reconstruction.flight
        rate, force = flight.q + 1j * flight.r, flight.ay + 1j * flight.az
        spin = np.exp(-1j * (1.0 - flight.vehicle.inertia_ratio) * running_integral(flight.time, flight.p))
        rolling = CubicSpline(flight.time, smooth.roll_rate)(flight.time, 1)
        for part, (a, b) in zip(frame.segments, frame.pieces, strict=True):
            if part.flight == number:
                level = np.mean(part.observed - predicted[a:b])
                rate[part.rows] = (predicted[a:b] + level) * spin[part.rows]
                force[part.rows] = _force(frame, number, smooth, part.rows, rate[part.rows], moments[a:b], rolling)
        flight = replace(flight, p=smooth.roll_rate, velocity=smooth.speed, dynamic_pressure=smooth.pressure)
        found.append(replace(flight, q=rate.real, r=rate.imag, ay=force.real, az=force.imag))
    return tuple(found)


def _force(
    frame: RateFrame,
    number: int,
    smooth: SmoothInputs,
    rows: slice,
    omega: ComplexArray,
    moments: ComplexArray,
    rolling: FloatArray,
) -> ComplexArray:
    """What the accelerometers read across the body at some samples, m/s^2."""
    reconstruction, motion = frame.reconstructions[number], frame.motions[number]
    vehicle = reconstruction.flight.vehicle
    pressure, p = smooth.pressure[rows], smooth.roll_rate[rows]
    xi = crossflow(motion.alpha, motion.windward_meridian)[rows]
    slope = np.nan_to_num(reconstruction.normal_force_ratio[rows])
    force = -pressure * (vehicle.reference_area / vehicle.mass) * slope * alpha_over_sine(xi) * xi
    omega_rate = pressure * vehicle.moment_scale * moments - 1j * (1.0 - vehicle.inertia_ratio) * p * omega
    return np.asarray(force + lever_force(vehicle.accelerometer_position, omega, omega_rate, p, rolling[rows]))


def lever_force(
    arm: tuple[float, float, float], omega: ComplexArray, omega_rate: ComplexArray, p: FloatArray, p_rate: FloatArray
) -> ComplexArray:
    """omega_dot x r + omega x (omega x r) across the body, f_y + i f_z in m/s^2 (Appendix B, errata E10, E11)."""
    x, transverse = arm[0], complex(arm[1], arm[2])
    crossed = (omega * np.conj(transverse)).imag
    return np.asarray(x * (p * omega - 1j * omega_rate) + (1j * p_rate - p**2) * transverse + 1j * omega * crossed)


def alpha_over_sine(xi: ComplexArray) -> FloatArray:
    """alpha / sin(alpha) (n,): a force linear in alpha follows it times the crossflow."""
    size = np.maximum(np.abs(xi), 1e-12)
    return np.asarray(angle_of_attack(xi) / size)


# What the equations know of errors, measured less true: courses by these names.
GYROS = ("error of q", "error of r")
"""rad/s that the transverse gyros read beyond the truth."""
ACCELEROMETERS = ("error of a_y", "error of a_z")
"""m/s^2, at the declared place, that the transverse accelerometers read beyond the truth."""
ROLL_RATE_ERROR = "error of p"
PRESSURE_ERROR = "error of dynamic pressure"
SPEED_ERROR = "error of speed"
RATIO_ERROR = "error of inertia ratio"
MOMENT_SCALE_ERROR = "error of S d / I"
FORCE_SCALE_ERROR = "error of S / m"
"""The last five are shares of the measured value."""
CROSSFLOW = ("change of v", "change of w")
"""m/s^2 in de-rolled axes that the crossflow gains beyond what record and computed attitude say."""
MOMENTS = ("change of q", "change of r")
"""rad/s^2 in body axes, of moments within their tolerance."""
READ = (*GYROS, *ACCELEROMETERS)
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

    def known(self, regressed: Regressed, flight: int) -> tuple[float, float, bool]:
        """What was taken out of a flight's record and what was found in all, in sizes, and whether it is bounded."""
        key = (self.error, self.component)
        applied, found = (each[flight].get(key, 0.0) for each in (regressed.applied, regressed.found))
        return applied / self.size, found / self.size, key not in regressed.free[flight]


Histories = Mapping[str, FloatArray]
"""By course name, (n,) over the samples of a flight; a course that it lacks is not touched."""


@dataclass(frozen=True)
class RecordErrors:
    """The tolerated values of one flight, and what 1 sigma of each does."""

    flight: int
    values: tuple[Tolerated, ...]
    histories: tuple[Histories, ...]

    def time_varying(
        self, time: FloatArray, samples: slice, turn: ComplexArray, local: IntArray
    ) -> tuple[TimeVaryingParameter, ...]:
        """The courses of one segment, at whose `samples` it is `time` (n,) s and exp(i Phi) `turn` (n,).

        What instruments read is averaged as they are: over the blocks `local` (blocks, size), in de-rolled axes.
        """
        middle = local[:, local.shape[1] // 2]
        read: list[_Rows] = []
        for pair in (GYROS, ACCELEROMETERS):
            first, second = self._rows(pair, samples)
            projected = ((first.values + 1j * second.values) * turn)[:, local].mean(axis=2) * np.conj(turn[middle])
            read += [first._replace(values=projected.real), second._replace(values=projected.imag)]
        others = [rows for name in OTHERS for rows in self._rows((name,), samples)]
        return (*_splined(time[middle], read), *_splined(time, others))

    def _rows(self, names: Sequence[str], samples: slice) -> list[_Rows]:
        """The histories of these courses at some samples, of the values that touch any of them."""
        touching = [k for k, rows in enumerate(self.histories) if any(name in rows for name in names)]
        weights = tuple(of_flight(self.values[k].name, self.flight) for k in touching)
        out = []
        for name in names:
            values = np.zeros((len(touching), samples.stop - samples.start))
            for row, k in zip(values, touching, strict=True):
                row[:] = self.histories[k][name][samples] if name in self.histories[k] else 0.0
            out.append(_Rows(of_flight(name, self.flight), weights, values))
        return out


class _Rows(NamedTuple):
    """A course at some instants: `values` (weights, n)."""

    name: str
    weights: tuple[str, ...]
    values: FloatArray


@dataclass(frozen=True)
class _Shapes:
    """The shapes of a course at any times."""

    spline: PPoly

    def __call__(self, time: FloatArray) -> FloatArray:
        return np.asarray(self.spline(time).T, dtype=float)


def _splined(time: FloatArray, rows: Sequence[_Rows]) -> Iterator[TimeVaryingParameter]:
    """The courses at any times, by cubic splines through `time` (n,) s; those without weights left out."""
    together = CubicSpline(time, np.concatenate([each.values for each in rows]).T)
    last = 0
    for each in rows:
        first, last = last, last + len(each.weights)
        if each.weights:
            own = PPoly.construct_fast(together.c[:, :, first:last], together.x)
            yield TimeVaryingParameter(each.name, each.weights, _Shapes(own))


def record_errors(
    frame: RateFrame, noise_free: Sequence[Flight], inputs: Sequence[SmoothInputs], modelled: frozenset[str]
) -> tuple[RecordErrors, ...]:
    """What is known of each flight to a tolerance only, linearised on its noise-free record.

    Moments of the mechanisms `modelled` are the hypothesis's own and take no part; neither does what none of the
    equations observes, such as the bias of an instrument that they do not use.
    """
    found = []
    for number, (flight, smooth) in enumerate(zip(noise_free, inputs, strict=True)):
        values: dict[Tolerated, Histories] = {}
        for value, histories in (
            *_of_effects(flight, frame.reconstructions[number], smooth),
            *_of_moments(frame, number, flight, modelled),
        ):
            observed = {name: np.broadcast_to(h, flight.time.shape) for name, h in histories.items() if np.any(h)}
            if observed:
                values[value] = observed
        found.append(RecordErrors(number, tuple(values), tuple(values.values())))
    return tuple(found)


def _of_effects(
    flight: Flight, reconstruction: Reconstruction, smooth: SmoothInputs
) -> Iterator[tuple[Tolerated, dict[str, FloatArray | float]]]:
    for effect in nuisance_effects():
        for name, units, size in effect.components(flight):
            more, less = (effect.perturb(flight, name, sign * size) for sign in (1.0, -1.0))
            histories = _histories(flight, more, less, reconstruction.gravity_body, smooth)
            yield Tolerated(effect.name, name, units, size), histories


def _histories(
    flight: Flight, more: Flight, less: Flight, gravity: FloatArray, smooth: SmoothInputs
) -> dict[str, FloatArray | float]:
    """What half the difference of two records does in the equations, by name of the history.

    The true motion stays as it is.
    """

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
    """What gravity gains in de-rolled axes (n,), m/s^2, where the gyros' errors have turned the computed attitude.

    Axes computed from rates that are too large by e have turned by the integral of e too far.
    """
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
    own = [mechanism for name, mechanism in frame.mechanisms.items() if name == StaticBend.name]
    for mechanism, sizes in tolerated_mechanisms(frame.reconstructions[number].flight, own):
        if mechanism.name in modelled:
            continue
        terms = checked_terms(mechanism, motion, dict(theta_grid(mechanism)[0]))
        for term, size in zip(terms, sizes, strict=True):
            moment = size * acceleration * motion.to_body(term.in_plane, term.out_of_plane)
            value = Tolerated(mechanism.name, term.name, term.units, size)
            yield value, dict(zip(MOMENTS, (moment.real, moment.imag), strict=True))


def tolerated_mechanisms(
    flight: Flight, own: Sequence[Mechanism] = ()
) -> tuple[tuple[Mechanism, tuple[float, ...]], ...]:
    """The mechanisms whose moments have a tolerance, with 1 sigma of each coefficient: the carried ones and `own`."""
    found = ((item, item.tolerance(flight)) for item in (*nuisance_mechanisms(flight), *own))
    return tuple((item, sizes) for item, sizes in found if sizes is not None)
