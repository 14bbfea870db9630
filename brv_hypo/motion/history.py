"""The past of a recorded motion: every quantity, tau seconds earlier, by cubic interpolation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from brv_hypo.arrays import FloatArray
from brv_hypo.motion.frames import angle_of_attack, crossflow, windward_meridian
from brv_hypo.motion.motion import Motion

_SMOOTH = ("alpha_rate", "windward_meridian_rate", "p", "q", "r", "velocity", "dynamic_pressure", "mach",
           "reynolds", "in_plane_moment")


def recorded(motion: Motion) -> Motion:
    """The same motion, able to tell its past.

    The angles are interpolated as crossflow, because alpha has a cusp and the meridian jumps by pi where
    alpha passes through zero.
    """
    time = motion.time
    xi = CubicSpline(time, crossflow(motion.alpha, motion.windward_meridian))
    smooth = {name: CubicSpline(time, getattr(motion, name)) for name in _SMOOTH
              if np.all(np.isfinite(getattr(motion, name)))}

    def past(tau: float) -> Motion:
        earlier = time - tau
        inside = np.maximum(earlier, time[0])
        values = {name: spline(inside) for name, spline in smooth.items()}
        before = np.minimum(earlier - time[0], 0.0) * motion.windward_meridian_rate[0]
        meridian = _nearest_turn(windward_meridian(xi(inside)) + before, motion.windward_meridian)
        return replace(
            motion, time=earlier, alpha=angle_of_attack(xi(inside)), windward_meridian=meridian,
            history=lambda more: past(tau + more), **values,
        )

    return replace(motion, history=past)


def _nearest_turn(angle: FloatArray, reference: FloatArray) -> FloatArray:
    """`angle` unwrapped over time and moved by whole turns next to `reference`."""
    unwrapped = np.unwrap(angle)
    turns = np.round((reference[-1] - unwrapped[-1]) / (2.0 * np.pi))
    return np.asarray(unwrapped + 2.0 * np.pi * turns, dtype=float)
