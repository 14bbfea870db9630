"""From a flight record to its wind-relative motion and moments: the entrance of this package."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from brv_hypo.arrays import ComplexArray
from brv_hypo.flight.record import Flight
from brv_hypo.motion.answerable import require_answerable
from brv_hypo.motion.axial_force import axial_share
from brv_hypo.motion.config import ReconstructionConfig
from brv_hypo.motion.effect_responses import EffectFit, corrected
from brv_hypo.motion.frames import angle_of_attack, angle_rates, plane_from_body, windward_meridian
from brv_hypo.motion.history import recorded
from brv_hypo.motion.inertial import InertialRecord, inertial_record
from brv_hypo.motion.limits import limits_of
from brv_hypo.motion.methods import METHODS, WindHistory, joint
from brv_hypo.motion.methods.wind_history import UNKNOWN_ANGLE
from brv_hypo.motion.moments import moment_estimate, static_in_plane
from brv_hypo.motion.motion import Motion
from brv_hypo.motion.perturbation import Perturbation
from brv_hypo.motion.reconstruction import EffectEstimate, MomentEstimate, Reconstruction


def reconstruct(
    flight: Flight,
    config: ReconstructionConfig | None = None,
    perturbations: Sequence[Perturbation] = (),
) -> Reconstruction:
    """Wind-relative motion and moments of `flight`, with standard deviations.

    The record may err by each of `perturbations`, as likely as their sizes say, and the gyros' clock, which the motion
    is on, may be late; without any it is taken as free of all but white noise. Raises UnanswerableError
    where the record is too short, or the vehicle is not in the air.
    """
    config = config or ReconstructionConfig()
    require_answerable(flight)
    record = inertial_record(flight, config)
    if config.method == "joint":
        wind = joint(record, config, perturbations)
    else:
        wind = METHODS[config.method](record, config, perturbations)
    moments = moment_estimate(wind.record, wind.effects)
    warnings = (*wind.warnings, *limits_of(record, wind, moments))
    motion = recorded(_motion(record, wind, moments))
    clock = float(flight.instruments.time_skew[0]) if perturbations else 0.0
    meridian_sigma = np.hypot(wind.phi_w_sigma, motion.windward_meridian_rate * clock)
    return Reconstruction(
        flight=flight,
        method=config.method,
        motion=motion,
        moments=moments,
        alpha_sigma=np.hypot(wind.alpha_sigma, motion.alpha_rate * clock),
        alpha_sigma_on_clock=wind.alpha_sigma,
        phi_w_sigma=np.minimum(meridian_sigma, UNKNOWN_ANGLE),
        gravity_body=wind.gravity,
        normal_force_slope=wind.normal_force_slope,
        normal_force_terms=wind.normal_force_terms,
        normal_force_bend=wind.normal_force_bend,
        gyro_sigma=record.gyro_sigma,
        accel_sigma=wind.accel_sigma,
        effects=_estimates(wind.effects),
        corrected=corrected(flight, wind.effects),
        status="degraded" if warnings else "ok",
        warnings=warnings,
        clock_sigma=clock,
    )


def _motion(record: InertialRecord, wind: WindHistory, moments: MomentEstimate) -> Motion:
    flight = record.flight
    xi = wind.crossflow
    alpha, meridian = angle_of_attack(xi), np.unwrap(windward_meridian(xi))
    alpha_rate, meridian_rate = angle_rates(xi, _crossflow_rate(wind))
    in_plane = plane_from_body(moments.body, meridian).real
    weight = np.where(moments.usable, 1.0 / moments.noise_sigma**2, 0.0)
    unknown = np.full(flight.samples, np.nan)
    return Motion(
        time=flight.time,
        alpha=alpha,
        alpha_rate=alpha_rate,
        windward_meridian=meridian,
        windward_meridian_rate=meridian_rate,
        p=flight.p,
        q=record.transverse_rate.real,
        r=record.transverse_rate.imag,
        velocity=flight.velocity,
        dynamic_pressure=flight.dynamic_pressure,
        mach=unknown if flight.mach is None else flight.mach,
        reynolds=unknown if flight.reynolds is None else flight.reynolds,
        in_plane_moment=static_in_plane(in_plane, alpha, weight),
        reference_length=flight.vehicle.reference_length,
        roll_acceleration=np.gradient(flight.p, flight.time),
        axial_share=axial_share(record, alpha),
    )


def _estimates(fit: EffectFit) -> tuple[EffectEstimate, ...]:
    """What is known of each error, in its units."""
    sigma = np.sqrt(np.diag(fit.covariance))
    return tuple(
        EffectEstimate(e.effect, e.component, e.units, e.size, e.size * float(value), e.size * float(error))
        for e, value, error in zip(fit.responses.effects, fit.value, sigma, strict=True)
    )


def _crossflow_rate(wind: WindHistory) -> ComplexArray:
    """Rate of the crossflow (n,), 1/s, from the kinematics: Eq. 3.1 with gravity, per unit of speed."""
    record, flight, xi = wind.record, wind.record.flight, wind.crossflow
    forward = np.sqrt(np.maximum(1.0 - np.abs(xi) ** 2, 0.0))
    acceleration = record.force + record.to_body(np.broadcast_to(wind.gravity, (flight.samples, 3)))
    transverse = acceleration[:, 1] + 1j * acceleration[:, 2]
    along = acceleration[:, 0] * forward + (transverse * np.conj(xi)).real
    turning = -1j * flight.p * xi + 1j * record.transverse_rate * forward
    return np.asarray(turning + (transverse - xi * along) / flight.velocity)
