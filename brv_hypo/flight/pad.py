"""Biases from the pad: what gyros and accelerometers read of a rocket at rest, nose up.

A gyro at rest reads its bias (the turning of the Earth, 0.004 deg/s, is below most). An accelerometer at rest reads
gravity: along the nose, up to the rail's unknown lean, that tells the bias; across it, lean and bias cannot be told
apart, and what is read there becomes the tolerance of the bias instead.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import PAD_FEWEST_SAMPLES, PAD_LEANING, PAD_MOVING
from brv_hypo.errors import UsageError
from brv_hypo.flight.phases import AT_REST, GRAVITY
from brv_hypo.flight.record import GYROS

ACROSS = ("ay", "az")


@dataclass(frozen=True)
class PadReadings:
    """The channels with their biases taken out; 1-sigma tolerances that follow (SI); notes in words."""

    channels: dict[str, FloatArray]
    tolerances: dict[str, tuple[float, float, float]]
    notes: tuple[str, ...]


def take_out_biases(
    time: FloatArray, channels: Mapping[str, FloatArray], rest: tuple[float, float]
) -> PadReadings:
    """Biases of `channels` (n,), SI, from the samples of `time` (n,) s within `rest`.

    Raises UsageError where the vehicle is not at rest, nose up, between those times.
    """
    inside = (time >= rest[0]) & (time <= rest[1])
    held = {name: values[inside] for name, values in channels.items()}
    count = int(np.count_nonzero(inside))
    if count < PAD_FEWEST_SAMPLES:
        raise UsageError(
            f"the map's pad, {rest[0]:g} to {rest[1]:g} s, holds {count} samples, expected at least "
            f"{PAD_FEWEST_SAMPLES}: the record runs from {time[0]:.3f} to {time[-1]:.3f} s."
        )
    axial = float(np.nanmean(held["ax"]))
    swings = max(float(np.nanstd(held[name])) for name in GYROS)
    if abs(axial - GRAVITY) > AT_REST or swings > PAD_MOVING:
        raise UsageError(
            f"the map's pad, {rest[0]:g} to {rest[1]:g} s: ax reads {axial:.3g} m/s^2 and the gyros swing by "
            f"{np.degrees(swings):.2g} deg/s, expected gravity along the nose and rest. Likely cause: times after "
            "ignition, another sign of ax, or wrong units. Remedy: correct the times or the map."
        )
    changed = dict(channels)
    notes = []
    biases = {name: float(np.nanmean(held[name])) for name in GYROS}
    biases["ax"] = axial - GRAVITY * float(np.exp(-0.5 * PAD_LEANING**2))
    for name, bias in biases.items():
        changed[name] = channels[name] - bias
    told = ", ".join(f"{name} {np.degrees(biases[name]):.3g} deg/s" for name in GYROS)
    notes.append(f"biases from the pad taken out: {told}, ax {biases['ax']:.3g} m/s^2")
    across = [abs(float(np.nanmean(held[name]))) for name in ACROSS]
    lean = 0.5 * GRAVITY * PAD_LEANING**2
    notes.append(
        f"ay and az read {across[0]:.2g} and {across[1]:.2g} m/s^2 on the pad, bias or lean of the rail: kept, and "
        "within the tolerance of their bias"
    )
    return PadReadings(changed, {"accel_bias": (lean, across[0], across[1])}, tuple(notes))
