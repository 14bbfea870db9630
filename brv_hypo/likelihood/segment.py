"""One stretch of measured record, and its time grid for collocation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.likelihood.course import Course, SampledCourse, sampled
from brv_hypo.likelihood.interpolation import WIDTH, Interpolator, Stencil


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
        x0: guess of the initial state, (n_states,), or of the whole history, (n_states, n).
        x0_std: how well the initial state is known: infinity leaves it free (the default), 0 holds it at
            x0, anything between is a Gaussian prior; scalar or (n_states,).
        u_mid: inputs halfway between samples, (n_inputs, n - 1); interpolated by a cubic when left out.
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
    the courses.
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

    @property
    def n(self) -> int:
        """Number of samples."""
        return int(self.y.shape[1])

    @property
    def samples(self) -> slice:
        """Where the samples stand in `t` and `u`."""
        return slice(0, self.n)

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


def build_grid(segment: Segment, number: int) -> Grid:
    """Check a segment and lay out its grid.

    Raises:
        UsageError: shapes that do not fit together, too few samples, times that do not increase, inputs that
            are not finite.
    """
    t = np.asarray(segment.t, dtype=float)
    y = np.atleast_2d(np.asarray(segment.y, dtype=float))
    u = np.asarray(segment.u, dtype=float)
    u = u.reshape(0, t.size) if u.size == 0 else np.atleast_2d(u)
    x0 = np.asarray(segment.x0, dtype=float)
    _check(t, u, y, x0, number)
    interpolator = Interpolator(t)
    middle = 0.5 * (t[:-1] + t[1:])
    u_mid = (
        interpolator.stencil(middle).apply(u)
        if segment.u_mid is None
        else np.asarray(segment.u_mid, dtype=float)
    )
    if u_mid.shape != (u.shape[0], t.size - 1):
        raise UsageError(
            f"segment {number}: u_mid has shape {u_mid.shape}; expected {(u.shape[0], t.size - 1)}, "
            "one column per interval"
        )
    n_states = x0.shape[0]
    return Grid(
        t=np.concatenate([t, middle]),
        u=np.concatenate([u, u_mid], axis=1),
        y=y,
        measured=np.isfinite(y),
        step=np.diff(t),
        start=x0,
        start_std=np.broadcast_to(np.asarray(segment.x0_std, dtype=float), (n_states,)),
        interpolator=interpolator,
        history=segment.history,
        courses=sampled(segment.courses, np.concatenate([t, middle]), number),
        ignores=frozenset(segment.ignores),
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
    if not np.all(np.isfinite(u)):
        raise UsageError(
            f"segment {number}: u is not finite everywhere; only y may have gaps (NaN): interpolate u first"
        )
    if x0.ndim not in (1, 2) or (x0.ndim == 2 and x0.shape[1] != t.size) or not np.all(np.isfinite(x0)):
        raise UsageError(
            f"segment {number}: x0 has shape {x0.shape}; expected finite values, "
            f"(n_states,) or (n_states, {t.size})"
        )
