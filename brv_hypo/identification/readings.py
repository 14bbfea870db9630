"""What instruments without noise or error would read of a fitted motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.motion.frames import angle_of_attack, crossflow
from brv_hypo.motion.inputs import SmoothInputs
from brv_hypo.motion.splines import running_integral
from brv_hypo.regression.frame import RateFrame


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
        found.append(
            replace(
                flight,
                p=smooth.roll_rate,
                q=rate.real,
                r=rate.imag,
                ay=force.real,
                az=force.imag,
                velocity=smooth.speed,
                dynamic_pressure=smooth.pressure,
            )
        )
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
    arm: tuple[float, float, float],
    omega: ComplexArray,
    omega_rate: ComplexArray,
    p: FloatArray,
    p_rate: FloatArray,
) -> ComplexArray:
    """omega_dot x r + omega x (omega x r) across the body, f_y + i f_z in m/s^2 (Appendix B, errata E10,
    E11).
    """
    x, transverse = arm[0], complex(arm[1], arm[2])
    crossed = (omega * np.conj(transverse)).imag
    return np.asarray(
        x * (p * omega - 1j * omega_rate) + (1j * p_rate - p**2) * transverse + 1j * omega * crossed
    )


def alpha_over_sine(xi: ComplexArray) -> FloatArray:
    """alpha / sin(alpha) (n,): a force linear in alpha follows it times the crossflow."""
    size = np.maximum(np.abs(xi), 1e-12)
    return np.asarray(angle_of_attack(xi) / size)
