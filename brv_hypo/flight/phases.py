"""Phases of a rocket's flight, found from what its accelerometers sense along the axis: windows to analyse.

On the pad the axial accelerometer reads gravity; while the motor burns it reads much more; coasting, drag makes it
read less than nothing; a parachute jerks. Thrust and a changing mass are in no model of the moments: of a rocket's
flight only the coast can be compared. A record of an entry holds none of these but, at its end, the parachute.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.flight.resample import joined, runs

PhaseName = Literal["pad", "burn", "coast", "parachute"]

GRAVITY = 9.80665  # m/s^2
SMOOTHED = 0.1  # s: a median over this takes vibration and spikes out
AT_REST = 0.15 * GRAVITY  # m/s^2 about gravity along the axis
THRUST = 1.5 * GRAVITY  # m/s^2 sensed, beyond what any instrument's bias makes of gravity
SHORTEST = 0.3  # s of a phase
BURNT_OUT = 0.0  # m/s^2: drag alone is left
# A parachute pulls with so many times what was sensed in the seconds before it, and with so many gravities.
JERK_TIMES, JERK_BEFORE, JERK_LEAST = 5.0, 2.0, 2.0 * GRAVITY


@dataclass(frozen=True)
class Phase:
    """One phase, from `start_s` to `stop_s` of the record's time."""

    name: PhaseName
    start_s: float
    stop_s: float


def find_phases(time: FloatArray, ax: FloatArray, ay: FloatArray, az: FloatArray) -> tuple[Phase, ...]:
    """The phases, in order of time, of uniform `time` (n,) s and specific forces (n,) m/s^2, NaN where missing.

    Empty where the record holds neither thrust nor a parachute: it is one phase, and needs no window.
    """
    from scipy.ndimage import median_filter

    step = float(time[-1] - time[0]) / max(time.size - 1, 1)
    width = max(1, 2 * round(0.5 * SMOOTHED / step) + 1)
    axial = median_filter(joined(ax), width, mode="nearest")
    force = median_filter(np.sqrt(sum(joined(each) ** 2 for each in (ax, ay, az))), width, mode="nearest")
    least = max(2, round(SHORTEST / step))
    ignition, burnout = _burn(axial, least)
    jerk = _jerk(force, burnout, max(2, round(JERK_BEFORE / step)))
    edges: dict[PhaseName, tuple[int, int]] = {
        "pad": (0, ignition if _rests(axial[:ignition]) else 0),
        "burn": (ignition, burnout),
        "coast": (burnout, jerk),
        "parachute": (jerk, time.size),
    }
    if burnout == 0 and jerk == time.size:
        return ()
    return tuple(
        Phase(name, float(time[a]), float(time[b - 1])) for name, (a, b) in edges.items() if b - a >= least
    )


def _burn(axial: FloatArray, least: int) -> tuple[int, int]:
    """Where the first thrust that lasts begins and ends; (0, 0) where there is none."""
    thrust = next((run for run in runs(axial > THRUST) if run[1] - run[0] >= least), None)
    if thrust is None:
        return 0, 0
    before = np.flatnonzero(np.abs(axial[: thrust[0]] - GRAVITY) < AT_REST)
    ignition = int(before[-1]) + 1 if before.size else thrust[0]
    dragged = [run for run in runs(axial < BURNT_OUT) if run[0] > ignition and run[1] - run[0] >= least]
    return ignition, dragged[0][0] if dragged else axial.size


def _rests(axial: FloatArray) -> bool:
    near: BoolArray = np.abs(axial - GRAVITY) < AT_REST
    return bool(near.size and np.mean(near) > 0.9)


def _jerk(force: FloatArray, begin: int, before: int) -> int:
    """The first sample at which the force leaves what it was, as at a parachute's opening; the end without one."""
    for at in np.flatnonzero(force > JERK_LEAST):
        if at < begin + before:
            continue
        usual = float(np.median(force[at - before : at - before // 4]))
        if force[at] > JERK_TIMES * usual:
            return int(at)
    return force.size
