"""One stretch of measured record, and its time grid for collocation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.likelihood.course import Course, SampledCourse, sampled
from brv_hypo.likelihood.interpolation import WIDTH, Interpolator, Stencil

Hold = Literal["zero", "linear", "cubic"]
"""An input between samples: as at the last one, on a straight line, on a cubic."""


@dataclass(frozen=True)
class History:
    """What is known before a segment starts, for delayed quantities.

    t (n,), s; x (n_states, n); u (n_inputs, n).
    """

    t: FloatArray
    x: FloatArray
    u: FloatArray


@dataclass(frozen=True)
class Segment:
    """A continuous stretch of record, with its own initial state.

    Attributes:
        t: sample times, (n,), s, increasing; at least six.
        u: known inputs, (n_inputs, n); (0, n) where there are none.
        y: measured outputs, (n_outputs, n); NaN where one was not measured.
        x0: guess of the initial state, (n_states,), or of the whole history, (n_states, n); empty for a model without
            states.
        x0_std: how well the initial state is known: infinity leaves it free (the default), 0 holds it at
            x0, anything between is a Gaussian prior; scalar or (n_states,).
        u_mid: inputs halfway between samples, (n_inputs, n - 1); as `hold` says when left out.
        hold: each input between samples, or one word for all: "zero" keeps the value of the last sample and jumps
            at the next, as a digital controller does; "linear"; "cubic". Delayed inputs are interpolated by a cubic.
        history: states and inputs before the start, which delayed quantities need; without it the first
            sample is held backwards.
        courses: quantities that vary along the segment as known shapes, whose weights are in theta0.
        ignores: parameters that neither function looks at in this segment, such as the biases of another
            record's instruments: they are not differentiated by.
    """

    t: FloatArray
    u: FloatArray
    y: FloatArray
    x0: FloatArray
    x0_std: float | FloatArray = np.inf
    u_mid: FloatArray | None = None
    history: History | None = None
    courses: tuple[Course, ...] = ()
    ignores: frozenset[str] = frozenset()
    hold: Hold | Sequence[Hold] = "cubic"


@dataclass(frozen=True)
class LookBack:
    """Quantities a delay earlier: weights on the samples, plus what comes from the history before them."""

    stencil: Stencil
    before: History | None
    before_rate: History | None


@dataclass(frozen=True)
class Grid:
    """A segment made ready: samples and midpoints, measured mask, interpolator.

    `t` and `u` hold the n samples first and then the n - 1 midpoints, (2 n - 1,) and (n_inputs, 2 n - 1); so do
    the courses. Where an input `jumps` at the samples, the n - 1 ends of the intervals follow, before the jump.
    """

    t: FloatArray
    u: FloatArray
    y: FloatArray
    measured: BoolArray
    step: FloatArray
    start: FloatArray
    start_std: FloatArray
    interpolator: Interpolator
    history: History | None = None
    courses: tuple[SampledCourse, ...] = ()
    ignores: frozenset[str] = frozenset()
    jumps: bool = False

    @property
    def n(self) -> int:
        """Number of samples."""
        return int(self.y.shape[1])

    @property
    def first(self) -> FloatArray:
        """The guess of the initial state, (n_states,)."""
        return self.start if self.start.ndim == 1 else self.start[:, 0]

    def look_back(self, delay: float) -> LookBack:
        """How x(t - delay) and u(t - delay) come about at all samples and midpoints; delay in s."""
        query = self.t - delay
        stencil = self.interpolator.stencil(query)
        history = self.history
        if history is None or delay <= 0:
            return LookBack(stencil, None, None)
        early = query < self.t[0]
        within = ~early[:, None]
        stencil = Stencil(stencil.index, stencil.value * within, stencil.rate * within)
        past = Interpolator(np.asarray(history.t, dtype=float)).stencil(query[early])
        known = [
            _spread(early, signal)
            for signal in (
                past.apply(history.x),
                past.apply(history.u),
                past.apply_rate(history.x),
                past.apply_rate(history.u),
            )
        ]
        return LookBack(stencil, History(query, *known[:2]), History(query, *known[2:]))


def inputs_of(segment: Segment) -> FloatArray:
    """The known inputs at the samples, (n_inputs, n); (0, n) where there are none."""
    u = np.asarray(segment.u, dtype=float)
    return u.reshape(0, np.size(segment.t)) if u.size == 0 else np.atleast_2d(u)


def with_history(segment: Segment, x: FloatArray) -> Segment:
    """The segment with a history (n_states, n), what is known of its initial state as it was."""
    start = np.asarray(segment.x0, dtype=float)
    held = np.isfinite(np.broadcast_to(np.asarray(segment.x0_std, dtype=float), (x.shape[0],)))
    history = x.copy()
    history[held, 0] = start[held] if start.ndim == 1 else start[held, 0]
    return replace(segment, x0=history)


def build_grid(segment: Segment, number: int) -> Grid:
    """Check a segment and lay out its grid.

    Raises:
        UsageError: shapes that do not fit together, too few samples, times that do not increase, inputs that
            are not finite.
    """
    t = np.asarray(segment.t, dtype=float)
    y = np.atleast_2d(np.asarray(segment.y, dtype=float))
    u = inputs_of(segment)
    x0 = np.asarray(segment.x0, dtype=float)
    _check(t, u, y, x0, number)
    interpolator = Interpolator(t)
    middle = 0.5 * (t[:-1] + t[1:])
    hold = holds(segment.hold, u.shape[0], number)
    u_mid = (
        _halfway(u, hold, interpolator, middle)
        if segment.u_mid is None
        else np.asarray(segment.u_mid, dtype=float)
    )
    if u_mid.shape != (u.shape[0], t.size - 1):
        raise UsageError(
            f"segment {number}: u_mid has shape {u_mid.shape}; expected {(u.shape[0], t.size - 1)}, "
            "one column per interval"
        )
    times, inputs = [t, middle], [u, u_mid]
    if "zero" in hold:
        kept = np.array([kind == "zero" for kind in hold])[:, None]
        times.append(t[1:])
        inputs.append(np.where(kept, u[:, :-1], u[:, 1:]))
    at = np.concatenate(times)
    return Grid(
        t=at,
        u=np.concatenate(inputs, axis=1),
        y=y,
        measured=np.isfinite(y),
        step=np.diff(t),
        start=x0,
        start_std=_start_std(segment.x0_std, x0.shape[0], number),
        interpolator=interpolator,
        history=segment.history,
        courses=sampled(segment.courses, at, number),
        ignores=frozenset(segment.ignores),
        jumps="zero" in hold,
    )


def holds(hold: Hold | Sequence[Hold], count: int, number: int) -> tuple[str, ...]:
    """What each of `count` inputs of segment `number` does between samples; UsageError for what is no such word."""
    found = (hold,) * count if isinstance(hold, str) else tuple(hold)
    if len(found) != count or not set(found) <= {"zero", "linear", "cubic"}:
        raise UsageError(
            f"segment {number}: hold is {hold!r}; expected 'zero', 'linear' or 'cubic', one word for all inputs or "
            f"one for each of the {count}"
        )
    return found


def _halfway(
    u: FloatArray, hold: tuple[str, ...], interpolator: Interpolator, middle: FloatArray
) -> FloatArray:
    """Inputs at the midpoints (n_inputs, n - 1), each as it is held."""
    ways = {
        "zero": u[:, :-1],
        "linear": 0.5 * (u[:, :-1] + u[:, 1:]),
        "cubic": interpolator.stencil(middle).apply(u) if "cubic" in hold else u[:, :-1],
    }
    return as_held(ways, hold)


def as_held(ways: Mapping[str, FloatArray], hold: Sequence[str]) -> FloatArray:
    """Inputs (n_inputs, times), each as it is held, out of all of them in every way."""
    found = np.empty_like(ways["zero"])
    for row, kind in enumerate(hold):
        found[row] = ways[kind][row]
    return found


def _start_std(x0_std: float | FloatArray, n_states: int, number: int) -> FloatArray:
    given = np.asarray(x0_std, dtype=float)
    if given.shape not in ((), (n_states,)) or not np.all(given >= 0.0):
        raise UsageError(
            f"segment {number}: x0_std is {given.tolist()}; expected one number, or one for each of the {n_states} "
            "states, none negative: 0 holds an initial state, infinity leaves it free"
        )
    return np.broadcast_to(given, (n_states,))


def check_alike(grids: Sequence[Grid]) -> None:
    """Refuse segments whose states, inputs or outputs differ in number.

    Raises:
        UsageError: with the numbers of each segment.
    """
    for what, counts in (
        ("states (rows of x0)", [grid.start.shape[0] for grid in grids]),
        ("inputs (rows of u)", [grid.u.shape[0] for grid in grids]),
        ("outputs (rows of y)", [grid.y.shape[0] for grid in grids]),
    ):
        if len(set(counts)) > 1:
            raise UsageError(
                f"the segments have {counts} {what}; expected the same number in each, since one model describes them "
                "all. An output that a segment lacks is a row of NaN"
            )


def _spread(where: BoolArray, signal: FloatArray) -> FloatArray:
    """The signal's columns at the marked places, zero elsewhere."""
    full = np.zeros((signal.shape[0], where.size))
    full[:, where] = signal
    return full


def _check(t: FloatArray, u: FloatArray, y: FloatArray, x0: FloatArray, number: int) -> None:
    if t.ndim != 1 or t.size < WIDTH:
        raise UsageError(
            f"segment {number}: t has shape {t.shape}; expected one dimension and at least {WIDTH} samples"
        )
    if not np.all(np.isfinite(t)) or np.any(np.diff(t) <= 0):
        raise UsageError(
            f"segment {number}: the sample times do not increase, or are not finite; "
            "remove repeated samples, and cut the record into segments where it has gaps"
        )
    for name, array in (("u", u), ("y", y)):
        if array.shape[1:] != t.shape:
            raise UsageError(
                f"segment {number}: {name} has shape {array.shape}; expected (rows, {t.size}), "
                "one column per sample"
            )
    if not np.any(np.isfinite(y)):
        raise UsageError(
            f"segment {number}: y, of shape {y.shape}, holds no measured value; expected at least one row that is not "
            "NaN throughout. Check the record, or leave the segment out"
        )
    if not np.all(np.isfinite(u)):
        raise UsageError(
            f"segment {number}: u is not finite everywhere; only y may have gaps (NaN): interpolate u first"
        )
    if x0.ndim in (1, 2) and x0.shape[0] == 0:
        raise UsageError(
            f"segment {number}: x0 is empty, so that the model has no states; expected at least one. For a model "
            "without states give None as dynamics"
        )
    if x0.ndim not in (1, 2) or (x0.ndim == 2 and x0.shape[1] != t.size) or not np.all(np.isfinite(x0)):
        raise UsageError(
            f"segment {number}: x0 has shape {x0.shape}; expected finite values, "
            f"(n_states,) or (n_states, {t.size})"
        )
