"""A known moment planted into a measured record, through the motion that it would have made.

The moment turns the vehicle other than it was measured to turn. The difference of two motions, with and without it,
obeys the equations of transverse motion about the measured one. In them the moment acts on the changed motion, and so
do the vehicle's own static moment, damping and normal force (CONVENTIONS; r = (x, 0, 0) for the accelerometers); roll
rate, speed and air stay as they were measured.
"""

from __future__ import annotations

import cmath
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.errors import UnanswerableError
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect
from brv_hypo.mechanisms.registry import find_installed
from brv_hypo.model.baseline import PitchDamping, SlopeSchedule, StaticBend, StaticMoment
from brv_hypo.model.term import Regressor
from brv_hypo.motion.inertial import arm_acceleration
from brv_hypo.motion.motion import Motion
from brv_hypo.tracing.fit import Fit

# Steps of the integration for each sample.
_STEPS = 2
# Largest angle of attack, of the largest that was flown: beyond, nothing is known of the vehicle's aerodynamics.
_LARGEST = 1.5
_STATIC = (StaticMoment.name, StaticBend.name, SlopeSchedule.name)
_LEAST_ANGLE = 1e-9  # rad; the meridian has no rate at none


def with_moment(
    flight: Flight, state: Fit, mechanism: Mechanism, values: Sequence[float], onset: float | None = None
) -> Flight:
    """The record with a mechanism's terms times `values` planted, about the motion that `state` has of it.

    They act from `onset` (s) on, or throughout. Raises UnanswerableError where the vehicle would turn half as far again
    as it was measured to turn at most: there nothing is known of its moments.
    """
    lift = _normal_force(flight, state)
    rates, chi = _moved(flight, _measured_motion(flight, state, lift), mechanism, values, onset)
    # C_y + i C_z = -C_malpha alpha (sin phi_w + i cos phi_w).
    force = -1j * lift * chi
    true = state.data.frame.reconstructions[0].corrected
    turned = replace(true, q=true.q + rates.real, r=true.r + rates.imag)
    lever = _lever(turned) - _lever(true)
    turned = replace(
        turned, ax=true.ax + lever[:, 0], ay=true.ay + force.real + lever[:, 1], az=true.az + force.imag + lever[:, 2]
    )
    before, after = (_as_read(record, state) for record in (true, turned))
    return replace(
        flight, **{name: getattr(flight, name) + (getattr(after, name) - getattr(before, name)) for name in _SENSED}
    )


_SENSED = ("q", "r", "ax", "ay", "az")


def _as_read(true: Flight, state: Fit) -> Flight:
    """What the record's instruments read of this motion, with the errors that the reconstruction found in them.

    A change of the motion that were read without them would contradict the record's own, and be fitted as other errors.
    """
    for error in state.data.frame.reconstructions[0].effects:
        effect = find_installed(error.effect)
        if isinstance(effect, RecordEffect) and effect.kind == "instrument":
            true = effect.perturb(true, error.component, error.value)
    return true


def _lever(flight: Flight) -> FloatArray:
    """Specific force (n, 3) at the accelerometers beyond that at the centre of mass, m/s^2."""
    rate = flight.q + 1j * flight.r
    p_change, change = (CubicSpline(flight.time, each)(flight.time, 1) for each in (flight.p, rate))
    return arm_acceleration(flight.p, p_change, rate, change, np.array(flight.vehicle.accelerometer_position))


def _normal_force(flight: Flight, state: Fit) -> FloatArray:
    """The transverse specific force (n,) per unit of chi, m/s^2."""
    slope = state.data.frame.reconstructions[0].normal_force_ratio
    known = np.where(np.isfinite(slope), slope, 0.0)
    return np.asarray(state.data.records[0].force_scale * known, dtype=float)


@dataclass(frozen=True)
class _MeasuredMotion:
    """A measured motion at the times of the integration (m,), SI; `flow` is chi = alpha exp(-i phi_w).

    The model's own moments: `static` (m, 3) in plane at no angle, and times alpha and alpha cubed, `damping` (m,) per
    rad/s. `scale` q_inf S d / I, `lift` the rate at which the normal force turns the path.
    """

    time: FloatArray
    flow: ComplexArray
    flow_rate: ComplexArray
    rates: ComplexArray
    known: dict[str, FloatArray]
    static: FloatArray
    damping: FloatArray
    scale: FloatArray
    lift: FloatArray
    reference_length: float

    def own(self, place: int, flow: complex) -> complex:
        """C_m + i C_n of the static moment."""
        alpha = max(abs(flow), _LEAST_ANGLE)
        zero, linear, cubic = self.static[place]
        return complex((zero / alpha + linear + cubic * alpha**2) * flow)

    def motion(self, place: int, flow: complex, change: complex, rates: complex) -> Motion:
        """The motion of one instant, as arrays of one, with a flow that changes at `change` 1/s."""
        alpha = max(abs(flow), _LEAST_ANGLE)
        product = change * flow.conjugate()
        here = slice(place, place + 1)
        return Motion(
            time=self.time[here],
            alpha=np.array([alpha]),
            alpha_rate=np.array([product.real / alpha]),
            windward_meridian=np.array([-cmath.phase(flow)]),
            windward_meridian_rate=np.array([-product.imag / alpha**2]),
            q=np.array([rates.real]),
            r=np.array([rates.imag]),
            in_plane_moment=np.zeros(1),
            p=self.known["p"][here],
            velocity=self.known["velocity"][here],
            dynamic_pressure=self.known["dynamic_pressure"][here],
            mach=self.known["mach"][here],
            reynolds=self.known["reynolds"][here],
            reference_length=self.reference_length,
        )


def _measured_motion(flight: Flight, state: Fit, lift: FloatArray) -> _MeasuredMotion:
    motion = state.data.frame.motions[0]
    count = (flight.samples - 1) * 2 * _STEPS + 1
    time = np.interp(np.arange(count) / (2 * _STEPS), np.arange(flight.samples), flight.time)

    def at(values: FloatArray) -> FloatArray:
        known = bool(np.all(np.isfinite(values)))
        return np.asarray(CubicSpline(flight.time, values)(time)) if known else np.full(count, np.nan)

    flow = CubicSpline(flight.time, motion.alpha * np.exp(-1j * motion.windward_meridian))
    static, damping = _own_moments(state, motion)
    return _MeasuredMotion(
        time=time,
        flow=flow(time),
        flow_rate=flow(time, 1),
        rates=at(motion.q) + 1j * at(motion.r),
        known={name: at(getattr(motion, name)) for name in _HISTORIES},
        static=np.stack([at(part) for part in static], axis=1),
        damping=at(damping),
        scale=at(flight.dynamic_pressure * flight.vehicle.moment_scale),
        lift=at(lift / flight.velocity),
        reference_length=motion.reference_length,
    )


_HISTORIES = ("p", "velocity", "dynamic_pressure", "mach", "reynolds")


def _own_moments(state: Fit, motion: Motion) -> tuple[list[FloatArray], FloatArray]:
    """Of the model: the static moment's parts without alpha, with alpha and with its cube, and damping (n,) each."""
    own_columns, values, _ = state.coefficients
    columns: dict[Regressor, float] = dict(zip(own_columns, values.tolist(), strict=True))
    static, damping = [np.zeros(motion.time.size) for _ in range(3)], np.zeros(motion.time.size)
    alpha = np.maximum(motion.alpha, _LEAST_ANGLE)
    for column, value in columns.items():
        if column.mechanism == PitchDamping.name:
            damping += value * motion.rate_factor
        elif column.mechanism in _STATIC:
            terms = state.model.mechanisms[column.mechanism].terms(motion, {})
            power = 3 if column.term.startswith("C_malpha3") else 1 if column.term.startswith("C_malpha") else 0
            own = next(term.in_plane for term in terms if term.name == column.term)
            static[(0, 1, 3).index(power)] += value * own / alpha**power
    return static, damping


def _moved(
    flight: Flight, measured: _MeasuredMotion, mechanism: Mechanism, values: Sequence[float], onset: float | None
) -> tuple[ComplexArray, ComplexArray]:
    """Changes of the transverse rates q + i r (n,) and of chi (n,), from none at the start (Runge and Kutta)."""
    gyration, largest = 1.0 - flight.vehicle.inertia_ratio, _LARGEST * float(np.max(np.abs(measured.flow)))
    begin = float(flight.time[0]) if onset is None else onset

    def slope(place: int, state: ComplexArray) -> ComplexArray:
        rate, chi = complex(state[0]), complex(state[1])
        spin = 1j * float(measured.known["p"][place])
        change = rate - (spin + float(measured.lift[place])) * chi
        before = complex(measured.flow[place])
        moment = measured.own(place, before + chi) - measured.own(place, before) + float(measured.damping[place]) * rate
        if measured.time[place] >= begin:
            total = complex(measured.rates[place]) + rate
            after = measured.motion(place, before + chi, complex(measured.flow_rate[place]) + change, total)
            moment += _moment(mechanism, after, values)
        return np.array([float(measured.scale[place]) * moment - gyration * spin * rate, change])

    out = np.zeros((flight.samples, 2), dtype=complex)
    for k in range(flight.samples - 1):
        step, state = (flight.time[k + 1] - flight.time[k]) / _STEPS, out[k]
        for first in range(2 * _STEPS * k, 2 * _STEPS * (k + 1), 2):
            a = slope(first, state)
            b = slope(first + 1, state + 0.5 * step * a)
            c = slope(first + 1, state + 0.5 * step * b)
            d = slope(first + 2, state + step * c)
            state = state + step / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        out[k + 1] = state
        turned = abs(complex(measured.flow[2 * _STEPS * (k + 1)]) + complex(state[1]))
        if not turned <= largest:
            raise UnanswerableError(
                f"this moment would turn the vehicle to {turned:.2g} rad at {flight.time[k + 1]:.1f} s, and no more "
                f"than {largest / _LARGEST:.2g} rad were flown: nothing is known of its moments there. Plant less or "
                "later (--onset), or take a window in which the vehicle is stiffer (--start)."
            )
    return out[:, 0], out[:, 1]


def _moment(mechanism: Mechanism, motion: Motion, values: Sequence[float]) -> complex:
    """C_m + i C_n of a mechanism's terms at one instant."""
    terms = mechanism.terms(motion, {})
    total = sum(v * complex(t.in_plane[0], t.out_of_plane[0]) for v, t in zip(values, terms, strict=True))
    return complex(total * cmath.exp(-1j * float(motion.windward_meridian[0])))
