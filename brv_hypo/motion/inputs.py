"""Measured inputs freed of noise: roll rate, speed and pressure enter the equations of motion, and noise accumulates.

`smooth_inputs` is the entrance. What is left of the noise is slow, and known as shapes in time (signals.py).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.motion import signals
from brv_hypo.motion.inertial import arm_acceleration, derolled_attitude, sensed_force
from brv_hypo.motion.interpolation import running_integral
from brv_hypo.motion.reconstruction import Reconstruction
from brv_hypo.motion.signals import InputError, Smooth, smoothed, unsmoothed

DENSITY_PASSES = 3  # Gauss-Newton steps, from the density smoothed as recorded
DENSITY_LEAST = 1e-3  # of the largest: where the pressure is lost in its noise its logarithm means nothing
INPUT_FEWEST_SHAPES = 10  # of the error that is left in a smoothed input
INPUT_MOST_SHAPES = 40  # and at most
INPUT_SIGNIFICANT = 0.5  # sigmas of the rates' noise from which a shape is significant
INPUT_FOLLOWED = 1.2  # what a spline that follows its input may leave, in white noise of the channel

ROLL_RATE = "roll rate noise"
PRESSURE = "pressure noise"


@dataclass(frozen=True)
class SmoothInputs:
    """The inputs of one flight of n samples, as the equations of motion take them."""

    roll_rate: FloatArray  # (n,) rad/s
    roll: FloatArray  # its integral (n,), rad
    gravity_axes: FloatArray  # row j holds the axes of the first sample along de-rolled axis j at each sample (n, 3, 3)
    speed: FloatArray  # (n,) m/s
    pressure: FloatArray  # dynamic pressure (n,), Pa
    errors: tuple[InputError, ...]  # what is left of their noise


def smooth_inputs(reconstruction: Reconstruction) -> SmoothInputs:
    """The inputs of a flight, at its reconstructed motion; those of a flight that holds them smoothed as they are."""
    flight, errors = reconstruction.flight, reconstruction.input_errors
    if not errors:
        flight, errors = smoothed_inputs(reconstruction, flight)
    roll, axes = _derolled(reconstruction, flight.p)
    return SmoothInputs(flight.p, roll, axes, flight.velocity, flight.dynamic_pressure, errors)


def smoothed_inputs(reconstruction: Reconstruction, flight: Flight) -> tuple[Flight, tuple[InputError, ...]]:
    """The flight with roll rate, speed and dynamic pressure freed of noise, and what is left of that."""
    motion = reconstruction.motion
    roll_rate = smoothed(flight.p)
    if not follows(flight.p, roll_rate.values, flight):  # the local filter leaves slow noise as it is
        noise = signals.white_noise_level(flight.p, flight.segments)
        roll_rate = Smooth(signals.smooth_channel(flight, flight.p), unsmoothed(flight.samples, noise))
    # About an arm the sensed force turns with the body, as large as the drag where that spins.
    arm, force = flight.vehicle.accelerometer_position, sensed_force(flight)
    if any(arm):
        omega = motion.q + 1j * motion.r
        roll_change, change = (np.gradient(values, flight.time) for values in (roll_rate.values, omega))
        force = force - arm_acceleration(roll_rate.values, roll_change, omega, change, arm)
    speed = smooth_speed(flight, force, reconstruction.crossflow)
    axes = _derolled(reconstruction, roll_rate.values)
    density = log_density(flight, speed, _scale_heights_risen(flight, force, reconstruction.gravity_body, *axes))
    pressure = replace(density, values=np.exp(density.values) * speed**2)
    if not follows(flight.velocity, speed, flight) or not follows(flight.dynamic_pressure, pressure.values, flight):
        filtered = signals.with_smooth_air(flight)
        noise = signals.white_noise_level(flight.dynamic_pressure / filtered.dynamic_pressure, flight.segments)
        speed, pressure = filtered.velocity, Smooth(filtered.dynamic_pressure, unsmoothed(flight.samples, noise))
    # An error of the roll rate turns the body's axes by its integral, one of the pressure changes moments at once.
    span = (float(flight.time[0]), float(flight.time[-1]))
    order = np.asarray(np.pi * (np.arange(INPUT_MOST_SHAPES) + 1.0) / (span[1] - span[0]), dtype=float)
    errors = (
        InputError(ROLL_RATE, span, significant_shapes(roll_rate.scale, 1.0 / order, reconstruction)),
        InputError(PRESSURE, span, significant_shapes(pressure.scale, np.ones(INPUT_MOST_SHAPES), reconstruction)),
    )
    return replace(flight, p=roll_rate.values, velocity=speed, dynamic_pressure=pressure.values), errors


def _derolled(reconstruction: Reconstruction, roll_rate: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Roll (n,) rad, and row j the axes of the first sample along de-rolled axis j (n, 3, 3)."""
    motion = reconstruction.motion
    roll: FloatArray = running_integral(motion.time, roll_rate)
    turn = derolled_attitude(motion.time, (motion.q + 1j * motion.r) * np.exp(1j * roll))
    return roll, np.asarray(np.transpose(turn, (0, 2, 1)))


def significant_shapes(scale: FloatArray, share: FloatArray, reconstruction: Reconstruction) -> FloatArray:
    """The shapes (coefficients, shapes) to the last that is significant in the rates, which one changes by `share`."""
    motion = reconstruction.motion
    rates = float(np.sqrt(np.mean(motion.q**2 + motion.r**2)))
    noise = reconstruction.gyro_sigma / np.sqrt(motion.time.size)
    size = np.sqrt(np.mean(scale[:, :INPUT_MOST_SHAPES] ** 2, axis=0))
    significant = np.flatnonzero(size * share[: size.size] * rates > INPUT_SIGNIFICANT * noise)
    return scale[:, : max(int(significant[-1]) + 1 if significant.size else 0, INPUT_FEWEST_SHAPES)]


def follows(measured: FloatArray, smooth: FloatArray, flight: Flight) -> bool:
    """Whether the residual of a spline is white noise, which may grow with the channel, by its differences."""
    left = [(measured - smooth)[a:b] for a, b in flight.segments]
    white = float(np.std(np.concatenate([np.diff(each) for each in left]))) / np.sqrt(2.0)
    return bool(np.std(np.concatenate(left)) <= INPUT_FOLLOWED * white)


def smooth_speed(flight: Flight, force: FloatArray, xi: ComplexArray) -> FloatArray:
    """Speed (n,) m/s: the integral of the `force` (n, 3) m/s^2 along the velocity, plus what varies slowly. Drag
    follows the angle of attack, so that the speed itself is not slow; the rest is. `xi` (n,) is the crossflow.
    """
    forward = np.sqrt(np.maximum(1.0 - np.abs(xi) ** 2, 0.0))
    along = force[:, 0] * forward + ((force[:, 1] + 1j * force[:, 2]) * np.conj(xi)).real
    impulse: FloatArray = running_integral(flight.time, along)
    return smoothed(flight.velocity - impulse).values + impulse


def _scale_heights_risen(
    flight: Flight, force: FloatArray, gravity: FloatArray, roll: FloatArray, axes: FloatArray
) -> FloatArray:
    """Scale heights (n,) that `force` (n, 3) across the axis has raised the vehicle by; 0 if gravity is unknown."""
    pull = float(np.linalg.norm(gravity))
    if not pull > 0.0 or flight.altitude is None or not np.all(np.isfinite(flight.altitude)):
        return np.zeros(flight.samples)
    down = axes @ (gravity / pull)
    across = (force[:, 1] + 1j * force[:, 2]) * np.exp(1j * roll)
    upward = -(across.real * down[:, 1] + across.imag * down[:, 2])
    height: FloatArray = running_integral(flight.time, running_integral(flight.time, upward))
    density = np.log(np.maximum(smoothed(flight.dynamic_pressure / flight.velocity**2).values, 1e-300))
    rate = np.gradient(smoothed(flight.altitude).values)
    fall = float(rate @ np.gradient(density) / (rate @ rate)) if np.any(rate) else 0.0
    return np.asarray(-fall * height)


def log_density(flight: Flight, speed: FloatArray, risen: FloatArray) -> Smooth:
    """Logarithm of dynamic pressure over the square of the speed: what varies slowly, less `risen` (n,) scale heights.
    It is far smoother than the pressure; it is fitted by least squares of that (Gauss-Newton).
    """
    measured = flight.dynamic_pressure / speed**2
    density = smoothed(measured).values
    density = np.maximum(density, DENSITY_LEAST * float(np.max(density)))
    for _ in range(DENSITY_PASSES):
        slow = smoothed(np.log(density) + measured / density - 1.0 + risen, density * speed**2)
        found = replace(slow, values=slow.values - risen)
        density = np.exp(np.clip(found.values, np.log(density) - 1.0, np.log(density) + 1.0))
    return replace(found, values=np.log(density))
