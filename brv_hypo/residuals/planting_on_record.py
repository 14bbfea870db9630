"""A known moment planted into a measured record, through the motion that it would have made.

The moment turns the vehicle a little further than it was measured to turn: the change of rates and crossflow answers to
it by the linear equations about the measured motion, in which the vehicle's own static moment, damping and normal force
act on the change (CONVENTIONS; r = (x, 0, 0) for the accelerometers).
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
from brv_hypo.model.slope_schedule import SlopeSchedule
from brv_hypo.motion.frames import body_from_plane
from brv_hypo.motion.motion import Motion
from brv_hypo.residuals.fitted_model import State
from brv_hypo.residuals.problem import increments

# Steps of the integration for each sample.
_STEPS = 4
_STATIC = (StaticMoment.name, SlopeSchedule.name)


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

    Raises UnanswerableError where the motion would change by more than the largest angle of attack: the equations are
    linear, and a vehicle with such a moment would have flown another flight.
    """
    motion = state.seen.reconstructions[0].motion
    terms = mechanism.terms(motion, {})
    inside = sum(value * term.in_plane for value, term in zip(values, terms, strict=True))
    outside = sum(value * term.out_of_plane for value, term in zip(values, terms, strict=True))
    body = body_from_plane(np.asarray(inside), np.asarray(outside), motion.windward_meridian)
    scale = flight.dynamic_pressure * flight.vehicle.moment_scale
    rates, chi = _moved(flight, _response(flight, state, motion, scale), scale * body)
    moved, alpha = float(np.max(np.abs(chi))), float(np.max(motion.alpha))
    if moved > alpha:
        raise UnanswerableError(
            f"this moment would turn the vehicle by {moved:.2g} rad, more than the {alpha:.2g} rad of its own angle of "
            "attack: the record cannot hold it. Plant less, or take a window in which the vehicle is stiffer (--start)."
        )
    # C_y + i C_z = -C_Nalpha alpha (sin phi_w + i cos phi_w).
    force = -1j * _normal_force(flight, state) * chi
    arm = 0.0 if flight.vehicle.accelerometer_position is None else flight.vehicle.accelerometer_position[0]
    change = np.gradient(rates, flight.time)
    # f_y gains (p q + r') x, f_z gains (p r - q') x.
    return replace(
        flight,
        q=flight.q + rates.real,
        r=flight.r + rates.imag,
        ay=flight.ay + force.real + arm * (flight.p * rates.real + change.imag),
        az=flight.az + force.imag + arm * (flight.p * rates.imag - change.real),
    )


def _response(flight: Flight, state: State, motion: Motion, scale: FloatArray) -> _Response:
    slope, damping = np.zeros(flight.samples), np.zeros(flight.samples)
    alpha = np.maximum(motion.alpha, 1e-9)
    _, others = state.problem.solution(state.seen.frame, state.model.columns)
    columns = dict(zip(state.model.columns, state.values, strict=True)) | increments(state.problem, others)
    for column, value in columns.items():
        if column.mechanism in _STATIC and column.term.startswith("C_Nalpha"):
            terms = state.model.mechanisms[column.mechanism].terms(motion, {})
            slope += value * next(term.in_plane for term in terms if term.name == column.term) / alpha
        if column.mechanism == PitchDamping.name:
            damping += value * motion.rate_factor
    return _Response(
        turning=np.asarray(1j * (1.0 - flight.vehicle.inertia_ratio) * flight.p, dtype=complex),
        rolling=np.asarray(1j * flight.p, dtype=complex),
        static=scale * slope,
        damping=scale * damping,
        lift=_normal_force(flight, state) / flight.velocity,
    )


def _normal_force(flight: Flight, state: State) -> FloatArray:
    """The transverse specific force (n,) per unit of chi, m/s^2."""
    slope = state.seen.reconstructions[0].normal_force_slope
    known = np.where(np.isfinite(slope), slope, 0.0)
    return np.asarray(state.seen.records[0].force_scale * known, dtype=float)


def _moved(flight: Flight, response: _Response, push: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Changes of the transverse rates q + i r (n,) and of chi = alpha exp(-i phi_w) (n,), from none at the start."""
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
    return out[:, 0], out[:, 1]


def _slope(parts: ComplexArray, state: ComplexArray) -> ComplexArray:
    turning, rolling, static, damping, lift, push = parts
    rate, chi = state
    return np.array([(damping - turning) * rate + static * chi + push, rate - (rolling + lift) * chi])
