"""The past of a recorded motion: every quantity, tau seconds earlier, by cubic interpolation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from brv_hypo.arrays import FloatArray
from brv_hypo.motion.frames import angle_of_attack, crossflow, windward_meridian
from brv_hypo.motion.motion import SMOOTH, Motion


def recorded(motion: Motion) -> Motion:
    """The same motion, able to tell its past.

    The angles are interpolated as crossflow, because alpha has a cusp and the meridian jumps by pi where
    alpha passes through zero.
    """
    time = motion.time
    names = [name for name in (*SMOOTH, "in_plane_moment") if np.all(np.isfinite(getattr(motion, name)))]
    xi = crossflow(motion.alpha, motion.windward_meridian)
    stacked = np.column_stack([xi.real, xi.imag, *(getattr(motion, name) for name in names)])
    return replace(motion, history=_Past(replace(motion, history=None), tuple(names), CubicSpline(time, stacked)))


@dataclass(frozen=True)
class _Past:
    """The past of `motion`, counted from `ago` seconds before it; a class, so that motions can be pickled.

    `spline` holds the crossflow and the quantities `names`.
    """

    motion: Motion
    names: tuple[str, ...]
    spline: CubicSpline
    ago: float = 0.0

    def __call__(self, tau: float) -> Motion:
        motion, ago = self.motion, self.ago + tau
        earlier = motion.time - ago
        values = self.spline(np.maximum(earlier, motion.time[0]))
        xi = values[:, 0] + 1j * values[:, 1]
        before = np.minimum(earlier - motion.time[0], 0.0) * motion.windward_meridian_rate[0]
        meridian = _nearest_turn(windward_meridian(xi) + before, motion.windward_meridian)
        return replace(
            motion,
            time=earlier,
            alpha=angle_of_attack(xi),
            windward_meridian=meridian,
            history=replace(self, ago=ago),
            roll_acceleration=None,
            **dict(zip(self.names, values.T[2:], strict=True)),
        )


def _nearest_turn(angle: FloatArray, reference: FloatArray) -> FloatArray:
    """`angle` unwrapped over time and moved by whole turns next to `reference`."""
    unwrapped = np.unwrap(angle)
    turns = np.round((reference[-1] - unwrapped[-1]) / (2.0 * np.pi))
    return np.asarray(unwrapped + 2.0 * np.pi * turns, dtype=float)
