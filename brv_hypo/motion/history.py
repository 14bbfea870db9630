"""The past of a recorded motion: every quantity, tau seconds earlier, by cubic interpolation."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.motion.frames import angle_of_attack, crossflow, windward_meridian
from brv_hypo.motion.motion import SMOOTH, Motion
from brv_hypo.motion.splines import Places, Spline

_CROSSFLOW = "crossflow"
_MOMENT = "in_plane_moment"
# Values of past quantities that are kept, 8 bytes each: the same delays are asked for again and again.
_KEPT_VALUES = 500_000


def recorded(motion: Motion) -> Motion:
    """The same motion, able to tell its past.

    The angles are interpolated as crossflow, because alpha has a cusp and the meridian jumps by pi where
    alpha passes through zero.
    """
    values = {name: getattr(motion, name) for name in (*SMOOTH, _MOMENT)}
    xi = crossflow(motion.alpha, motion.windward_meridian)
    splines = {name: Spline(motion.time, each) for name, each in values.items() if np.all(np.isfinite(each))}
    splines[_CROSSFLOW] = Spline(motion.time, np.stack([xi.real, xi.imag], axis=1))
    return _with_past(motion, splines, _Kept())


def with_in_plane_moment(motion: Motion, moment: FloatArray) -> Motion:
    """The same motion with another wind-fixed in-plane moment (n,), in its past too."""
    moved, past = replace(motion, in_plane_moment=moment), motion.history
    if not isinstance(past, _Past):
        return recorded(moved)
    return _with_past(moved, {**past.splines, _MOMENT: Spline(motion.time, moment)}, past.kept)


def _with_past(motion: Motion, splines: Mapping[str, Spline], kept: _Kept) -> Motion:
    return replace(motion, history=_Past(replace(motion, history=None), splines, kept))


class _Kept:
    """Quantities that were asked for lately, by delay and name; all but the in-plane moment, which may be another."""

    def __init__(self) -> None:
        self._found: OrderedDict[tuple[float, str], Any] = OrderedDict()

    def get(self, key: tuple[float, str]) -> Any:
        """What was kept; None where nothing was."""
        return self._found.get(key)

    def put(self, key: tuple[float, str], values: Any) -> None:
        """Keep it; what was put first goes where there are too many."""
        self._found[key] = values
        while len(self._found) * np.size(values) > _KEPT_VALUES:
            self._found.popitem(last=False)

    def __getstate__(self) -> dict[str, Any]:
        """A pickled motion need not hold what can be found again."""
        return {"_found": OrderedDict()}


@dataclass(frozen=True)
class _Past:
    """The past of `motion`, counted from `ago` seconds before it; a class, so that motions can be pickled.

    `splines` hold the crossflow and other quantities by name; what has none is taken for constant.
    """

    motion: Motion
    splines: Mapping[str, Spline]
    kept: _Kept
    ago: float = 0.0

    def __call__(self, tau: float) -> Motion:
        past = _Past(self.motion, self.splines, self.kept, self.ago + tau)
        earlier = object.__new__(EarlierMotion)
        vars(earlier).update(past=past, history=past, time=_fixed(self.motion.time - past.ago))
        return earlier


class EarlierMotion(Motion):
    """A recorded motion some time ago: each quantity is interpolated when it is asked for, and cannot be written to."""

    @cached_property
    def places(self) -> Places:
        """Where its times lie among the samples of the recorded motion."""
        time = vars(self)["past"].motion.time
        return Places.among(time, np.maximum(self.time, time[0]))

    def __getattr__(self, name: str) -> Any:
        past = vars(self).get("past")
        if past is None or name.startswith("_") or not hasattr(past.motion, name):
            raise AttributeError(f"a motion has no quantity '{name}'")
        found = None if name == _MOMENT else past.kept.get((past.ago, name))
        if found is None:
            found = _fixed(_at(past, self.time, self.places, name))
            if name != _MOMENT:
                past.kept.put((past.ago, name), found)
        vars(self)[name] = found
        return found


def _at(past: _Past, time: FloatArray, places: Places, name: str) -> Any:
    """One quantity of the motion at these times (n,), which lie at these places."""
    motion = past.motion
    if name == "alpha":
        return angle_of_attack(_crossflow_at(past, places))
    if name == "windward_meridian":
        before = np.minimum(time - motion.time[0], 0.0) * motion.windward_meridian_rate[0]
        return _nearest_turn(windward_meridian(_crossflow_at(past, places)) + before, motion.windward_meridian)
    return past.splines[name](places) if name in past.splines else getattr(motion, name)


def _crossflow_at(past: _Past, places: Places) -> ComplexArray:
    found = past.splines[_CROSSFLOW](places)
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
    turns = np.zeros(angle.size)
    np.cumsum(np.round(np.diff(angle) / (-2.0 * np.pi)), out=turns[1:])
    turns += np.round((reference[-1] - angle[-1]) / (2.0 * np.pi) - turns[-1])
    return np.asarray(angle + 2.0 * np.pi * turns, dtype=float)
