"""A known moment planted into a measured record, through the motion that it would have made.

The moment turns the vehicle other than it was measured to turn. The difference of two motions, with and without it,
obeys the equations of transverse motion about the measured one, in which the vehicle's own static moment, damping and
normal force act on the difference (CONVENTIONS; r = (x, 0, 0) for the accelerometers). The moment and what the static
moment has beyond its secant slope act where the difference leads: the equations are solved again until it settles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.errors import UnanswerableError
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.model.baseline import PitchDamping, StaticMoment
from brv_hypo.model.columns import Column
from brv_hypo.model.slope_schedule import SlopeSchedule
from brv_hypo.motion.frames import body_from_plane
from brv_hypo.motion.motion import Motion
from brv_hypo.residuals.fitted_model import State
from brv_hypo.residuals.problem import increments

# Steps of the integration for each sample.
_STEPS = 4
# Turns after which the difference has settled or will not, and the change (of its largest) at which it has: each turn
# adds what the moment does to the change of the turn before, as the terms of an exponential series.
_TURNS = 60
_SETTLED = 1e-6
# Largest angle of attack, of the largest that was flown: beyond, nothing is known of the vehicle's aerodynamics.
_LARGEST = 1.5
_STATIC = (StaticMoment.name, SlopeSchedule.name)
_LEAST_ANGLE = 1e-9  # rad; the meridian has no rate at none


@dataclass(frozen=True)
class _Response:
    """What the change of the motion answers by: all (n,), 1/s or 1/s^2.

    omega' = -turning omega + static chi + damping omega + push, chi' = omega - rolling chi - lift chi.
    """

    turning: ComplexArray
    rolling: ComplexArray
    static: FloatArray
    damping: FloatArray
    lift: FloatArray


def with_moment(flight: Flight, state: State, mechanism: Mechanism, values: Sequence[float]) -> Flight:
    """The record with a mechanism's terms times `values` planted, about the motion that `state` has of it.

    Raises UnanswerableError where the vehicle would turn half as far again as it was measured to turn at most: there
    nothing is known of its moments.
    """
    motion = state.seen.reconstructions[0].motion
    scale = flight.dynamic_pressure * flight.vehicle.moment_scale
    secant, response = _response(flight, state, motion, scale)
    chi, change = np.zeros(flight.samples, dtype=complex), np.zeros(flight.samples, dtype=complex)
    for _ in range(_TURNS):
        changed = _changed(motion, chi, change)
        curved = _static(state, changed) - _static(state, motion) - secant * chi
        rates, found, change = _moved(flight, response, scale * (_moment(mechanism, changed, values) + curved))
        moved, chi = float(np.max(np.abs(found - chi))), found
        largest = float(np.max(np.abs(_flow(motion) + chi)))
        if not largest <= _LARGEST * float(np.max(motion.alpha)):
            raise UnanswerableError(
                f"this moment would turn the vehicle to {largest:.2g} rad, and no more than "
                f"{float(np.max(motion.alpha)):.2g} rad were flown: nothing is known of its moments there. Plant "
                "less, or take a window in which the vehicle is stiffer (--start)."
            )
        if moved <= _SETTLED * max(float(np.max(np.abs(chi))), 1e-300):
            break
    # C_y + i C_z = -C_Nalpha alpha (sin phi_w + i cos phi_w).
    force = -1j * _normal_force(flight, state) * chi
    arm = 0.0 if flight.vehicle.accelerometer_position is None else flight.vehicle.accelerometer_position[0]
    turning = np.gradient(rates, flight.time)
    # f_y gains (p q + r') x, f_z gains (p r - q') x.
    return replace(
        flight,
        q=flight.q + rates.real,
        r=flight.r + rates.imag,
        ay=flight.ay + force.real + arm * (flight.p * rates.real + turning.imag),
        az=flight.az + force.imag + arm * (flight.p * rates.imag - turning.real),
    )


def _flow(motion: Motion) -> ComplexArray:
    """chi = alpha exp(-i phi_w) (n,)."""
    return np.asarray(motion.alpha * np.exp(-1j * motion.windward_meridian), dtype=complex)


def _changed(motion: Motion, chi: ComplexArray, change: ComplexArray) -> Motion:
    """The motion whose flow differs by chi (n,), which changes at `change` (n,) 1/s."""
    turn = np.exp(-1j * motion.windward_meridian)
    flow = motion.alpha * turn + chi
    rate = (motion.alpha_rate - 1j * motion.alpha * motion.windward_meridian_rate) * turn + change
    alpha = np.abs(flow)
    square = np.maximum(alpha, _LEAST_ANGLE) ** 2
    product = rate * np.conj(flow)
    return replace(
        motion,
        alpha=alpha,
        windward_meridian=np.unwrap(-np.angle(flow)),
        alpha_rate=product.real / np.sqrt(square),
        windward_meridian_rate=-product.imag / square,
        history=None,
    )


def _moment(mechanism: Mechanism, motion: Motion, values: Sequence[float]) -> ComplexArray:
    """C_m + i C_n (n,) of a mechanism's terms."""
    terms = mechanism.terms(motion, {})
    inside = sum((value * term.in_plane for value, term in zip(values, terms, strict=True)), np.zeros(motion.time.size))
    outside = sum(
        (value * term.out_of_plane for value, term in zip(values, terms, strict=True)), np.zeros(motion.time.size)
    )
    return body_from_plane(inside, outside, motion.windward_meridian)


def _static(state: State, motion: Motion) -> ComplexArray:
    """C_m + i C_n (n,) of the model's static moment."""
    inside = sum((value * term for _, value, term in _static_terms(state, motion)), np.zeros(motion.time.size))
    return body_from_plane(inside, np.zeros(motion.time.size), motion.windward_meridian)


def _secant(state: State, motion: Motion) -> FloatArray:
    """The part of it that goes with alpha, over alpha (n,), 1/rad."""
    parts = (value * term for name, value, term in _static_terms(state, motion) if name.startswith("C_Nalpha"))
    return np.asarray(sum(parts, np.zeros(motion.time.size)) / np.maximum(motion.alpha, _LEAST_ANGLE), dtype=float)


def _static_terms(state: State, motion: Motion) -> list[tuple[str, float, FloatArray]]:
    """Name, coefficient and in-plane column (n,) of each term of the static moment."""
    found = []
    for column, value in _coefficients(state).items():
        if column.mechanism in _STATIC:
            terms = state.model.mechanisms[column.mechanism].terms(motion, {})
            found.append((column.term, value, next(term.in_plane for term in terms if term.name == column.term)))
    return found


def _coefficients(state: State) -> dict[Column, float]:
    """Of the model's columns, and of what the baseline is more within its priors."""
    _, others = state.problem.solution(state.seen.frame, state.model.columns)
    return dict(zip(state.model.columns, state.values, strict=True)) | increments(state.problem, others)


def _response(flight: Flight, state: State, motion: Motion, scale: FloatArray) -> tuple[FloatArray, _Response]:
    """The static moment's secant slope (n,), 1/rad, and what the difference answers by with it."""
    secant, damping = _secant(state, motion), np.zeros(flight.samples)
    for column, value in _coefficients(state).items():
        if column.mechanism == PitchDamping.name:
            damping += value * motion.rate_factor
    return secant, _Response(
        turning=np.asarray(1j * (1.0 - flight.vehicle.inertia_ratio) * flight.p, dtype=complex),
        rolling=np.asarray(1j * flight.p, dtype=complex),
        static=scale * secant,
        damping=scale * damping,
        lift=_normal_force(flight, state) / flight.velocity,
    )


def _normal_force(flight: Flight, state: State) -> FloatArray:
    """The transverse specific force (n,) per unit of chi, m/s^2."""
    slope = state.seen.reconstructions[0].normal_force_slope
    known = np.where(np.isfinite(slope), slope, 0.0)
    return np.asarray(state.seen.records[0].force_scale * known, dtype=float)


def _moved(
    flight: Flight, response: _Response, push: ComplexArray
) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Changes of the transverse rates q + i r (n,), of chi = alpha exp(-i phi_w) (n,) and of its rate, from none at the
    start.
    """
    time = flight.time
    parts = (response.turning, response.rolling, response.static, response.damping, response.lift, push)
    course = CubicSpline(time, np.stack([np.asarray(part, dtype=complex) for part in parts], axis=1))
    out = np.zeros((time.size, 2), dtype=complex)
    for k in range(time.size - 1):
        step = (time[k + 1] - time[k]) / _STEPS
        at = course(time[k] + 0.5 * step * np.arange(2 * _STEPS + 1))
        state = out[k]
        for turn in range(_STEPS):
            first, middle, last = at[2 * turn], at[2 * turn + 1], at[2 * turn + 2]
            a = _slope(first, state)
            b = _slope(middle, state + 0.5 * step * a)
            c = _slope(middle, state + 0.5 * step * b)
            d = _slope(last, state + step * c)
            state = state + step / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        out[k + 1] = state
    return out[:, 0], out[:, 1], out[:, 0] - (response.rolling + response.lift) * out[:, 1]


def _slope(parts: ComplexArray, state: ComplexArray) -> ComplexArray:
    turning, rolling, static, damping, lift, push = parts
    rate, chi = state
    return np.array([(damping - turning) * rate + static * chi + push, rate - (rolling + lift) * chi])
