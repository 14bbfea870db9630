"""What the gyros' white noise lets the attitude wander from a motion."""

from __future__ import annotations

import numpy as np
from scipy.integrate import cumulative_trapezoid

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import WALK_FEWEST_MODES, WALK_LEFT_OUT, WALK_MODES_PER_CYCLE, WALK_MOST_MODES
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.kinematics import crossflow
from brv_hypo.motion.motion import Motion
from brv_hypo.motion.reconstruction import Reconstruction


def walk_modes(record: InertialRecord, reconstruction: Reconstruction) -> int:
    """How many sines stand for the random walk.

    What they leave of it is less than alpha's own uncertainty, and faster than what the motion answers to. The variance
    beyond the first k of them is 2 / (pi^2 k) of the walk's at its end.
    """
    size = record.gyro_sigma * np.sqrt(record.time[-1] * record.flight.step)
    wanted = 2.0 / np.pi**2 * (size / (WALK_LEFT_OUT * float(np.median(reconstruction.alpha_sigma_on_clock)))) ** 2
    wanted = max(wanted, WALK_MODES_PER_CYCLE * _cycles(reconstruction.motion))
    return int(np.clip(np.ceil(wanted), WALK_FEWEST_MODES, WALK_MOST_MODES))


def _cycles(motion: Motion) -> float:
    """Cycles of the crossflow over the record, in axes that do not roll."""
    roll = np.asarray(cumulative_trapezoid(motion.p, motion.time, initial=0), dtype=float)
    turned = crossflow(motion.alpha, motion.windward_meridian) * np.exp(1j * roll)
    rate = np.gradient(turned, motion.time)
    frequency = np.linalg.norm(rate) / max(float(np.linalg.norm(turned - turned.mean())), 1e-300)
    return float(frequency * (motion.time[-1] - motion.time[0]) / (2.0 * np.pi))


def walk_sines(record: InertialRecord, count: int) -> FloatArray:
    """Sines (n, count) rad of a random walk of the gyros' noise, each of unit prior variance (Karhunen-
    Loeve).
    """
    order, duration = _orders(count), record.time[-1]
    size = _noise_at(record, order) * np.sqrt(2.0 * duration * record.flight.step)
    return np.asarray(size / order * np.sin(np.outer(record.time / duration, order)), dtype=float)


def walk_noise(record: InertialRecord, count: int) -> FloatArray:
    """The gyros' noise (n, count) rad/s of which the sines of `walk_sines` are the integrals."""
    order, duration = _orders(count), record.time[-1]
    size = _noise_at(record, order) * np.sqrt(2.0 * record.flight.step / duration)
    return np.asarray(size * np.cos(np.outer(record.time / duration, order)), dtype=float)


def _orders(count: int) -> FloatArray:
    """Frequencies of the sines of a random walk (count,), rad over the record."""
    return np.asarray(np.pi * (np.arange(count) + 0.5), dtype=float)


def _noise_at(record: InertialRecord, order: FloatArray) -> FloatArray:
    """Sigma of white noise, rad/s, as loud as the gyros' is at each of these frequencies, rad over the record."""
    return record.gyro_walk.sigma_at(order * record.flight.step / record.time[-1])
