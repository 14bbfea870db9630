"""The motion to linearise about, by where it starts and how its attitude wanders: a fit moves both.

The attitude wanders by the gyros' white noise, a random walk that a few sines stand for (Karhunen-Loeve).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import cumulative_trapezoid

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.motion.inertial import (
    InertialRecord,
    WindStart,
    body_crossflow,
    gravity_size,
    inertial_record,
    transverse_axes,
    wind_direction,
    wind_to_body,
)
from brv_hypo.motion.inputs import with_smooth_inputs
from brv_hypo.motion.interpolation import SplineGrid
from brv_hypo.motion.methods import ReconstructionConfig
from brv_hypo.motion.motion import Motion, crossflow, crossflow_rate, recorded, windward_meridian, with_crossflow
from brv_hypo.motion.pipeline import axial_share
from brv_hypo.motion.reconstruction import Reconstruction

WALK_FEWEST_MODES = 10  # sines of the attitude's random walk
WALK_MOST_MODES = 80  # bounds the time
# Sines for each cycle of the motion. A walk at frequency f turns the vehicle by the static moment, which is (f_n / f)^2
# of the noise that the walk is made of: half as fast again as the motion, with two sines a cycle, it is lost in it.
WALK_MODES_PER_CYCLE = 3.0
WALK_LEFT_OUT = 0.8  # standard deviations of alpha, of what the sines may leave of the walk


def walk_modes(record: InertialRecord, reconstruction: Reconstruction) -> int:
    """How many sines stand for the random walk.

    What they leave of it is less than alpha's own uncertainty, and faster than what the motion answers to. The variance
    beyond the first k of them is 2 / (pi^2 k) of the walk's at its end.
    """
    size = record.gyro_sigma * np.sqrt(record.time[-1] * record.flight.step)
    wanted = 2.0 / np.pi**2 * (size / (WALK_LEFT_OUT * float(np.median(reconstruction.alpha_sigma_on_clock)))) ** 2
    wanted = max(wanted, WALK_MODES_PER_CYCLE * cycles(reconstruction.motion))
    return int(np.clip(np.ceil(wanted), WALK_FEWEST_MODES, WALK_MOST_MODES))


def cycles(motion: Motion) -> float:
    """Cycles of the crossflow over the record, in axes that do not roll."""
    roll = np.asarray(cumulative_trapezoid(motion.p, motion.time, initial=0), dtype=float)
    turned = crossflow(motion.alpha, motion.windward_meridian) * np.exp(1j * roll)
    rate = np.gradient(turned, motion.time)
    frequency = np.linalg.norm(rate) / max(float(np.linalg.norm(turned - turned.mean())), 1e-300)
    return float(frequency * (motion.time[-1] - motion.time[0]) / (2.0 * np.pi))


def walk_sines(record: InertialRecord, count: int) -> tuple[FloatArray, FloatArray]:
    """Sines (n, count) rad of a random walk, each of unit prior variance, and the gyros' noise (n, count) rad/s that
    they are the integrals of.
    """
    order, duration, step = np.pi * (np.arange(count) + 0.5), record.time[-1], record.flight.step
    angle = np.outer(record.time / duration, order)
    sigma = record.gyro_walk.sigma_at(order * step / duration)  # of white noise as loud at each frequency
    sines = sigma * np.sqrt(2.0 * duration * step) / order * np.sin(angle)
    return sines, sigma * np.sqrt(2.0 * step / duration) * np.cos(angle)


# Names of a motion's unknowns: what a fit says that it has too much of.
MOTION = "motion"
START = ("start y", "start z")
GRAVITY = ("gravity x", "gravity y", "gravity z")


def walk_name(axis: str, number: int) -> str:
    """Name of a sine of the walk about an axis, y or z."""
    return f"walk {axis} {number}"


@dataclass(frozen=True)
class PropagatedMotion:
    """A motion by its `start` and the `walk` (n,) rad of the attitude across the velocity, in axes carried along it."""

    start: WindStart
    walk: ComplexArray

    @classmethod
    def of(cls, record: InertialRecord, reconstruction: Reconstruction) -> PropagatedMotion:
        """That of a reconstruction."""
        direction = wind_direction(record, reconstruction.start)
        offset = reconstruction.crossflow - body_crossflow(record, direction)
        return cls(reconstruction.start, np.asarray(offset * np.conj(wind_to_body(record, direction))))

    def weights(self, sines: FloatArray) -> ComplexArray:
        """Weights (modes,) of sines (n, modes) of the walk."""
        return np.asarray(np.linalg.lstsq(sines, self.walk, rcond=None)[0])

    def less(self, record: InertialRecord, found: Mapping[tuple[str, str], float]) -> PropagatedMotion:
        """The motion without what a fit about it found too much, by (MOTION, name)."""
        first, second = (found.get((MOTION, name), 0.0) for name in START)
        across, beside = transverse_axes(self.start.direction[np.newaxis])
        direction = self.start.direction - first * across[0] - second * beside[0]
        pull = gravity_size(record.flight) * np.array([found.get((MOTION, name), 0.0) for name in GRAVITY])
        count = sum((MOTION, walk_name("y", number)) in found for number in range(len(found)))
        weights = [complex(*(found[MOTION, walk_name(axis, number)] for axis in "yz")) for number in range(count)]
        return PropagatedMotion(
            WindStart(direction / np.linalg.norm(direction), self.start.gravity - pull),
            self.walk - walk_sines(record, count)[0] @ np.array(weights, dtype=complex),
        )

    def crossflow(self, record: InertialRecord) -> ComplexArray:
        """The crossflow (n,) of a record that moves so."""
        direction = wind_direction(record, self.start)
        return body_crossflow(record, direction) + wind_to_body(record, direction) * self.walk


def linearisation_point(
    reconstruction: Reconstruction, config: ReconstructionConfig, motion: PropagatedMotion | None = None
) -> tuple[InertialRecord, Reconstruction]:
    """The flight with what was found of its errors taken out, and the motion to linearise about.

    `motion` is that of a fit whose errors are out of the flight already: nothing more is taken out then. A new one from
    the forces alone would lie as far off as they leave it, and the next fit as far from linear as the last.
    """
    if motion is not None:  # the flight is taken as it reads, under this gravity
        none_found = tuple(replace(each, value=0.0) for each in reconstruction.effects)
        as_read = replace(reconstruction, corrected=reconstruction.flight, effects=none_found)
        reconstruction = replace(as_read, gravity_body=motion.start.gravity)
    flight, errors = with_smooth_inputs(reconstruction)
    record = inertial_record(flight, config)
    read = replace(
        reconstruction.motion,
        p=flight.p,
        q=record.transverse_rate.real,
        r=record.transverse_rate.imag,
        velocity=flight.velocity,
        dynamic_pressure=flight.dynamic_pressure,
    )
    smooth = replace(reconstruction, flight=flight, motion=read, input_errors=errors)
    if motion is None:
        own, sines = PropagatedMotion.of(record, smooth), walk_sines(record, walk_modes(record, smooth))[0]
        # The faster part follows errors as they turn with the body, and those are unknowns of their own.
        motion = replace(own, walk=np.asarray(sines @ own.weights(sines)))
    return record, _moved(record, smooth, motion)


def _moved(record: InertialRecord, reconstruction: Reconstruction, propagated: PropagatedMotion) -> Reconstruction:
    """The reconstruction with a motion that is propagated, and what the record reads about it."""
    motion, before, after = reconstruction.motion, reconstruction.crossflow, propagated.crossflow(record)
    rate = crossflow_rate(motion, before) + np.gradient(after - before, motion.time)
    moved = with_crossflow(replace(motion, history=None), after, rate)
    read = replace(
        moved,
        windward_meridian=np.unwrap(windward_meridian(after)),  # not next to that before: near alpha = 0 it is another
        roll_acceleration=SplineGrid.on(record.time).slopes(record.flight.p[:, np.newaxis])[:, 0],
        axial_share=axial_share(record, moved.alpha),
    )
    return replace(reconstruction, motion=recorded(read))
