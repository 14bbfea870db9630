"""Measured inputs freed of noise: roll rate, speed and pressure enter the equations of motion, and their
noise accumulates.

What is left of it is slow: a few shapes in time per input, scaled so that the weight of each is known
beforehand to be of unit standard deviation. The weights are parameters with just that prior, so that standard
errors know of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import eigh

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.identification.structure import of_flight
from brv_hypo.likelihood import Course
from brv_hypo.motion.attitude import derolled_attitude, running_integral
from brv_hypo.motion.frames import crossflow
from brv_hypo.motion.reconstruction import Reconstruction

_INTERVALS = 64
_SAMPLES_PER_INTERVAL = 6
_ROUGHNESS = np.logspace(-14.0, 15.0, 117)
_RIDGE = 1e-14
_LEAST_ROUGHNESS = 1e-15
_ORDER = 3
_MOST_SHAPES = 10
"""Shapes of an input's error; finer ones have less effect on the motion than the gyros' noise."""
_PASSES = 3
_LEAST_DENSITY = 1e-3
"""Of the largest: where the pressure is lost in its noise its logarithm means nothing."""

ROLL_RATE = "roll rate noise"
PRESSURE = "pressure noise"


@dataclass(frozen=True)
class Smooth:
    """A smoothed signal: `values` (n,), and the independent shapes of its error as coefficients of a spline.

    `scale` (coefficients, shapes) has shapes of unit standard deviation, the smoothest first.
    """

    values: FloatArray
    scale: FloatArray


@dataclass(frozen=True)
class InputError:
    """What smoothing leaves of an input's noise, as a course of unit weights: rad/s of the roll rate, a
    fraction of the pressure.

    `scale` are the shapes as coefficients of a cubic spline over `span` (s).
    """

    name: str
    span: tuple[float, float]
    scale: FloatArray

    @property
    def course(self) -> Course:
        """The course, by whose name the equations of motion know it."""
        return Course(self.name, self.weights, self.shapes)

    @property
    def weights(self) -> tuple[str, ...]:
        """Names of the weights."""
        return tuple(f"{self.name} {k}" for k in range(self.scale.shape[1]))

    def shapes(self, time: FloatArray) -> FloatArray:
        """The shapes (count, n) at times (n,) s."""
        place = np.clip((time - self.span[0]) / (self.span[1] - self.span[0]), 0.0, 1.0)
        return np.asarray((_splines(place, self.scale.shape[0]) @ self.scale).T, dtype=float)


@dataclass(frozen=True)
class SmoothInputs:
    """One flight's inputs as the equations of motion take them: roll rate rad/s and its integral rad, speed m/s,
    dynamic pressure Pa, each (n,); `errors` what is left of their noise.

    Row j of `gravity_axes` (n, 3, 3) holds the axes of the first sample along de-rolled axis j at each sample.
    """

    roll_rate: FloatArray
    roll: FloatArray
    gravity_axes: FloatArray
    speed: FloatArray
    pressure: FloatArray
    errors: tuple[InputError, ...]


def smooth_inputs(reconstruction: Reconstruction, number: int) -> SmoothInputs:
    """The inputs of flight `number`, at its reconstructed motion."""
    flight, motion = reconstruction.flight, reconstruction.motion
    span = (float(flight.time[0]), float(flight.time[-1]))
    roll_rate = smoothed(flight.p)
    speed = smooth_speed(flight, crossflow(motion.alpha, motion.windward_meridian))
    roll = running_integral(flight.time, roll_rate.values)
    axes = _gravity_axes(reconstruction, roll)
    waves = scale_heights_risen(flight, _lifted(reconstruction, roll, axes))
    density = log_density(flight, speed, waves)
    errors = (
        InputError(of_flight(ROLL_RATE, number), span, roll_rate.scale),
        InputError(of_flight(PRESSURE, number), span, density.scale),
    )
    pressure = np.exp(density.values) * speed**2
    return SmoothInputs(roll_rate.values, roll, axes, speed, pressure, errors)


def smooth_speed(flight: Flight, xi: ComplexArray) -> FloatArray:
    """Speed (n,), m/s: the integral of the force along the velocity, at the crossflow `xi`, plus what varies
    slowly.

    Drag follows the angle of attack, so that the speed itself is not slow; what the accelerometers leave over
    is.
    """
    forward = np.sqrt(np.maximum(1.0 - np.abs(xi) ** 2, 0.0))
    along = flight.ax * forward + ((flight.ay + 1j * flight.az) * np.conj(xi)).real
    impulse = running_integral(flight.time, along)
    return smoothed(flight.velocity - impulse).values + impulse


def _gravity_axes(reconstruction: Reconstruction, roll: FloatArray) -> FloatArray:
    """See `SmoothInputs`."""
    omega = reconstruction.motion.q + 1j * reconstruction.motion.r
    turn = derolled_attitude(reconstruction.flight.time, omega * np.exp(1j * roll))
    return np.asarray(np.transpose(turn, (0, 2, 1)))


def _lifted(reconstruction: Reconstruction, roll: FloatArray, axes: FloatArray) -> FloatArray:
    """Height (n,) m by which the force across the axis has raised the vehicle: a coning body flies a helix.

    Zero where the direction of gravity is not known.
    """
    flight = reconstruction.flight
    pull = float(np.linalg.norm(reconstruction.gravity_body))
    if not pull > 0.0:
        return np.zeros(flight.samples)
    down = axes @ (reconstruction.gravity_body / pull)
    force = (flight.ay + 1j * flight.az) * np.exp(1j * roll)
    upward = -(force.real * down[:, 1] + force.imag * down[:, 2])
    return running_integral(flight.time, running_integral(flight.time, upward))


def scale_heights_risen(flight: Flight, height: FloatArray) -> FloatArray:
    """A height (n,) m in scale heights of the density; zero where the record holds no altitude to tell them."""
    if flight.altitude is None or not np.all(np.isfinite(flight.altitude)):
        return np.zeros_like(height)
    density = np.log(np.maximum(smoothed(flight.dynamic_pressure / flight.velocity**2).values, 1e-300))
    rate = np.gradient(smoothed(flight.altitude).values)
    fall = float(rate @ np.gradient(density) / (rate @ rate)) if np.any(rate) else 0.0
    return np.asarray(-fall * height)


def log_density(flight: Flight, speed: FloatArray, risen: FloatArray) -> Smooth:
    """Logarithm of dynamic pressure over the square of the speed: what varies slowly, less `risen` (n,), the
    height that lift has raised the vehicle by, in scale heights.

    It is far smoother than the pressure; the noise is that of the pressure, so that it is fitted by least
    squares of the pressure (Gauss-Newton).
    """
    measured = flight.dynamic_pressure / speed**2
    density = smoothed(measured).values
    density = np.maximum(density, _LEAST_DENSITY * float(np.max(density)))
    for _ in range(_PASSES):
        slow = smoothed(np.log(density) + measured / density - 1.0 + risen, density * speed**2)
        found = replace(slow, values=slow.values - risen)
        density = np.exp(np.clip(found.values, np.log(density) - 1.0, np.log(density) + 1.0))
    return replace(found, values=np.log(density))


def smoothed(values: FloatArray, weight: FloatArray | None = None) -> Smooth:
    """Cubic smoothing spline through evenly spaced samples whose noise is as one over the weight, each (n,).

    Roughness (third differences of the coefficients) and noise are those of greatest likelihood (Wahba,
    Ann. Statist. 13:1378, 1985): error bands then hold on average, the bias of smoothing included. What varies
    faster than the spline can is taken for noise.
    """
    n = values.size
    weight = np.ones(n) if weight is None else weight / np.sqrt(np.mean(weight**2))
    count = min(_INTERVALS, max(n // _SAMPLES_PER_INTERVAL, 1)) + 3
    basis = _splines(np.linspace(0.0, 1.0, n), count)
    weighted = weight[:, None] * basis
    normal = weighted.T @ weighted
    normal += _RIDGE * float(np.trace(normal)) / count * np.eye(count)
    penalty = np.diff(np.eye(count), _ORDER, axis=0)
    rough, modes = eigh(penalty.T @ penalty, normal)
    relative = np.maximum(rough / rough[-1], _LEAST_ROUGHNESS)
    relative[:_ORDER] = 0.0
    level = float(np.mean(values))
    seen = weight * (values - level)
    size = modes.T @ (weighted.T @ seen)
    rest = max(float(seen @ seen - size @ size), 0.0)
    shrink = 1.0 / (1.0 + _ROUGHNESS[:, None] * relative)
    power = (rest + (1.0 - shrink[:, _ORDER:]) @ size[_ORDER:] ** 2) / (n - _ORDER)
    power = np.maximum(power, 1e-28 * float(np.mean((weight * values) ** 2)) + 1e-300)
    misfit = (n - _ORDER) * np.log(power) + np.sum(np.log1p(1.0 / (_ROUGHNESS[:, None] * relative[_ORDER:])), axis=1)
    best = int(np.argmin(misfit))
    scale = modes * np.sqrt(power[best] * shrink[best])
    return Smooth(np.asarray(level + basis @ (modes @ (shrink[best] * size))), scale[:, :_MOST_SHAPES])


def _splines(place: FloatArray, count: int) -> FloatArray:
    """The cubic splines (n, count) on knots evenly spaced over 0 to 1, and as evenly three more on each
    side.
    """
    knots = np.arange(-3, count + 1) / (count - 3)
    return np.asarray(BSpline.design_matrix(place, knots, 3).toarray(), dtype=float)
