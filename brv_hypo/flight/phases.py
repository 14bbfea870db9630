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
from brv_hypo.constants import (
    PARACHUTE_BEFORE,
    PARACHUTE_LEAST,
    PARACHUTE_TIMES,
    PHASE_AT_REST,
    PHASE_BURNT_OUT,
    PHASE_RESTING,
    PHASE_SHORTEST,
    PHASE_SMOOTHED,
    PHASE_THRUST,
)
from brv_hypo.flight.resample import joined, runs

PhaseName = Literal["pad", "burn", "coast", "parachute"]

GRAVITY = 9.80665  # m/s^2
AT_REST = PHASE_AT_REST * GRAVITY  # m/s^2 about gravity along the axis
THRUST = PHASE_THRUST * GRAVITY  # m/s^2 sensed


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
    width = max(1, 2 * round(0.5 * PHASE_SMOOTHED / step) + 1)
    axial = median_filter(joined(ax), width, mode="nearest")
    force = median_filter(np.sqrt(sum(joined(each) ** 2 for each in (ax, ay, az))), width, mode="nearest")
    least = max(2, round(PHASE_SHORTEST / step))
    ignition, burnout = _burn(axial, least)
    jerk = _jerk(force, burnout, max(2, round(PARACHUTE_BEFORE / step)))
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
    dragged = [run for run in runs(axial < PHASE_BURNT_OUT) if run[0] > ignition and run[1] - run[0] >= least]
    return ignition, dragged[0][0] if dragged else axial.size


def _rests(axial: FloatArray) -> bool:
    near: BoolArray = np.abs(axial - GRAVITY) < AT_REST
    return bool(near.size and np.mean(near) > PHASE_RESTING)


def _jerk(force: FloatArray, begin: int, before: int) -> int:
    """The first sample at which the force leaves what it was, as at a parachute's opening; the end without one."""
    for at in np.flatnonzero(force > PARACHUTE_LEAST * GRAVITY):
        if at < begin + before:
            continue
        usual = float(np.median(force[at - before : at - before // 4]))
        if force[at] > PARACHUTE_TIMES * usual:
            return int(at)
    return force.size
