"""The past of a recorded motion: every quantity, tau seconds earlier, by cubic interpolation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.motion.frames import angle_of_attack, crossflow, windward_meridian
from brv_hypo.motion.motion import SMOOTH, Motion

_CROSSFLOW = "crossflow"
_MOMENT = "in_plane_moment"


def recorded(motion: Motion) -> Motion:
    """The same motion, able to tell its past.

    The angles are interpolated as crossflow, because alpha has a cusp and the meridian jumps by pi where
    alpha passes through zero.
    """
    values = {name: getattr(motion, name) for name in (*SMOOTH, _MOMENT)}
    xi = crossflow(motion.alpha, motion.windward_meridian)
    splines = {name: _Spline(motion.time, each) for name, each in values.items() if np.all(np.isfinite(each))}
    splines[_CROSSFLOW] = _Spline(motion.time, np.stack([xi.real, xi.imag], axis=1))
    return _with_past(motion, splines)


def with_in_plane_moment(motion: Motion, moment: FloatArray) -> Motion:
    """The same motion with another wind-fixed in-plane moment (n,), in its past too."""
    if not isinstance(motion.history, _Past):
        return recorded(replace(motion, in_plane_moment=moment))
    splines = {**motion.history.splines, _MOMENT: _Spline(motion.time, moment)}
    return _with_past(replace(motion, in_plane_moment=moment), splines)


def _with_past(motion: Motion, splines: Mapping[str, _Spline]) -> Motion:
    return replace(motion, history=_Past(replace(motion, history=None), splines))


class _Spline:
    """Cubic spline through `values` (n, ...), made when it is first asked for."""

    def __init__(self, time: FloatArray, values: FloatArray) -> None:
        self._samples: tuple[FloatArray, FloatArray] | None = (time, values)
        self._spline: CubicSpline | None = None

    def __call__(self, time: FloatArray) -> FloatArray:
        if self._samples is not None:
            self._spline, self._samples = CubicSpline(*self._samples), None
        assert self._spline is not None
        return np.asarray(self._spline(time), dtype=float)


@dataclass(frozen=True)
class _Past:
    """The past of `motion`, counted from `ago` seconds before it; a class, so that motions can be pickled.

    `splines` hold the crossflow and other quantities by name; what has none is taken for constant.
    """

    motion: Motion
    splines: Mapping[str, _Spline]
    ago: float = 0.0

    def __call__(self, tau: float) -> Motion:
        past = replace(self, ago=self.ago + tau)
        earlier = object.__new__(EarlierMotion)
        vars(earlier).update(past=past, history=past, time=_fixed(self.motion.time - past.ago))
        return earlier


class EarlierMotion(Motion):
    """A recorded motion some time ago: each quantity is interpolated when it is asked for, and cannot be written to."""

    def __getattr__(self, name: str) -> Any:
        past = vars(self).get("past")
        if past is None or name.startswith("_") or not hasattr(past.motion, name):
            raise AttributeError(f"a motion has no quantity '{name}'")
        found = vars(self)[name] = _fixed(_at(past, self.time, name))
        return found


def _at(past: _Past, time: FloatArray, name: str) -> Any:
    """One quantity of the motion at these times (n,)."""
    motion, held = past.motion, np.maximum(time, past.motion.time[0])
    if name == "alpha":
        return angle_of_attack(_crossflow_at(past, held))
    if name == "windward_meridian":
        before = np.minimum(time - motion.time[0], 0.0) * motion.windward_meridian_rate[0]
        return _nearest_turn(windward_meridian(_crossflow_at(past, held)) + before, motion.windward_meridian)
    return past.splines[name](held) if name in past.splines else getattr(motion, name)


def _crossflow_at(past: _Past, time: FloatArray) -> ComplexArray:
    found = past.splines[_CROSSFLOW](time)
    return np.asarray(found[:, 0] + 1j * found[:, 1], dtype=complex)


def _fixed(values: Any) -> Any:
    """The same array, not to be written to; anything else as it is."""
    if not isinstance(values, np.ndarray):
        return values
    found = values.view()
    found.flags.writeable = False
    return found


def _nearest_turn(angle: FloatArray, reference: FloatArray) -> FloatArray:
    """`angle` unwrapped over time and moved by whole turns next to `reference`."""
    unwrapped = np.unwrap(angle)
    turns = np.round((reference[-1] - unwrapped[-1]) / (2.0 * np.pi))
    return np.asarray(unwrapped + 2.0 * np.pi * turns, dtype=float)
