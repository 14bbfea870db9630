"""A continuous measured record, and its time grid for collocation.

A `Segment` holds times, inputs, outputs (nan where nothing was measured) and a first guess of the states. Inputs run
between samples as their `hold` says: constant, linear, or by the local cubic of `Interpolator`, whose nodal slopes
are those of the quartic through five samples: fourth-order accurate, with a continuous first derivative, so that a
cost that depends on x(t - tau) is smooth in tau.

A `TimeVaryingParameter` is theta(t) = sum over j of weight_j basis_j(t), the weights being parameters; its derivative
is computed once, those by the weights are the basis functions times it.

`build_grid` checks a segment and lays out its grid; `stepped_inputs` detects inputs that look like zero-order holds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray, IntArray
from brv_hypo.errors import UsageError

# ---- Local cubic interpolation of sampled signals: weights on nearby samples, and their rate of change ----


WIDTH = 6
"""Samples that take part in one interpolated value."""

_SLOPE_WIDTH = 5


@dataclass(frozen=True)
class Stencil:
    """Interpolation at n query times as weights on samples.

    `index` (n, WIDTH) are sample numbers, `value` (n, WIDTH) the weights of the signal and `rate`
    (n, WIDTH), 1/s, those of its time derivative. Outside the samples the end value is held, rate 0.
    """

    index: IntArray
    value: FloatArray
    rate: FloatArray

    def part(self, where: slice | IntArray) -> Stencil:
        """The stencil of some of the query times."""
        return Stencil(self.index[where], self.value[where], self.rate[where])

    def apply(self, signal: FloatArray) -> FloatArray:
        """The signal, (m, n_samples), at the query times, (m, n)."""
        return self._apply(signal, self.value)

    def apply_rate(self, signal: FloatArray) -> FloatArray:
        """The time derivative of the signal, (m, n_samples), at the query times, (m, n)."""
        return self._apply(signal, self.rate)

    def _apply(self, signal: FloatArray, weights: FloatArray) -> FloatArray:
        found = np.zeros((signal.shape[0], self.index.shape[0]), dtype=signal.dtype)
        for index, weight in zip(self.index.T, weights.T, strict=True):
            found += signal[:, index] * weight
        return found


class Interpolator:
    """Builds stencils on one time base t, (n_samples,), s, increasing, at least six samples."""

    def __init__(self, t: FloatArray) -> None:
        self.t = t
        n = t.size
        nodes = np.arange(n)
        self._slope_start = np.clip(nodes - _SLOPE_WIDTH // 2, 0, n - _SLOPE_WIDTH)
        self._slope = _slope_weights(t, nodes, self._slope_start)

    def part(self, first: int, last: int) -> Interpolator:
        """The interpolator of some of the samples."""
        return Interpolator(self.t[first:last])

    def stencil(self, query: FloatArray) -> Stencil:
        """Weights at the query times, (n,), s."""
        t = self.t
        clipped = np.clip(query, t[0], t[-1])
        left = np.clip(np.searchsorted(t, clipped, side="right") - 1, 0, t.size - 2)
        step = t[left + 1] - t[left]
        s = (clipped - t[left]) / step
        hermite = (1 + 2 * s) * (1 - s) ** 2, s**2 * (3 - 2 * s), s * (1 - s) ** 2, s**2 * (s - 1)
        slopes = 6 * s * (s - 1), -6 * s * (s - 1), (1 - s) * (1 - 3 * s), s * (3 * s - 2)
        start = np.clip(left - 2, 0, t.size - WIDTH)
        value = self._combine(left, start, (hermite[0], hermite[1], hermite[2] * step, hermite[3] * step))
        rate = self._combine(left, start, (slopes[0] / step, slopes[1] / step, slopes[2], slopes[3]))
        rate[query != clipped] = 0.0
        return Stencil(start[:, None] + np.arange(WIDTH), value, rate)

    def _combine(self, left: IntArray, start: IntArray, basis: tuple[FloatArray, ...]) -> FloatArray:
        """Hermite basis (left and right values, left and right slopes) spread over the samples."""
        weights = np.zeros((left.size, WIDTH))
        rows = np.arange(left.size)
        for node, at_node, at_slope in ((left, basis[0], basis[2]), (left + 1, basis[1], basis[3])):
            weights[rows, node - start] += at_node
            first = self._slope_start[node] - start
            for j in range(_SLOPE_WIDTH):
                weights[rows, first + j] += at_slope * self._slope[node, j]
        return np.asarray(weights)


def _slope_weights(t: FloatArray, nodes: IntArray, start: IntArray) -> FloatArray:
    """Weights, (n, 5), 1/s, of the derivative at each node of the quartic through five samples."""
    z = t[start[:, None] + np.arange(_SLOPE_WIDTH)]
    apart = z[:, :, None] - z[:, None, :]
    apart[:, range(_SLOPE_WIDTH), range(_SLOPE_WIDTH)] = 1.0
    barycentric = 1.0 / apart.prod(axis=2)
    rows = np.arange(nodes.size)
    here = nodes - start
    distance = t[nodes][:, None] - z
    distance[rows, here] = 1.0
    weights = barycentric / barycentric[rows, here][:, None] / distance
    weights[rows, here] = 0.0
    weights[rows, here] = -weights.sum(axis=1)
    return np.asarray(weights)


# ---- Quantities that vary along a record as known shapes, whose weights are parameters ----


@dataclass(frozen=True)
class TimeVaryingParameter:
    """theta[name] (n,) = sum over j of theta[weights[j]] shapes(t)[j], as the user's functions see it.

    Attributes:
        name: under which dynamics and outputs find the values, at their own samples; no parameter has it.
        weights: names of parameters that act through time-varying parameters only: this one and others.
        shapes: t (n,), s -> (len(weights), n).
    """

    name: str
    weights: tuple[str, ...]
    shapes: Callable[[FloatArray], FloatArray]

    def at(self, t: FloatArray, theta: Mapping[str, float]) -> FloatArray:
        """Its value (n,) at times t (n,), s."""
        return np.array([theta[weight] for weight in self.weights]) @ self.shapes(t)


@dataclass(frozen=True)
class SampledParameter:
    """A time-varying parameter at some instants: `shapes` is (len(weights), n)."""

    name: str
    weights: tuple[str, ...]
    shapes: FloatArray

    def at(self, theta: Mapping[str, Any]) -> Any:
        """Its value (n,)."""
        return np.array([theta[weight] for weight in self.weights]) @ self.shapes

    def part(self, where: slice | IntArray) -> SampledParameter:
        """Some of the instants."""
        return SampledParameter(self.name, self.weights, self.shapes[:, where])


def sampled(time_varying: tuple[TimeVaryingParameter, ...], t: FloatArray, number: int) -> tuple[SampledParameter, ...]:
    """The time-varying parameters at times t (n,), s.

    Raises:
        UsageError: shapes of the wrong size.
    """
    found = []
    for varying in time_varying:
        shapes = np.asarray(varying.shapes(t), dtype=float)
        expected = (len(varying.weights), t.size)
        if shapes.shape != expected:
            raise UsageError(
                f"segment {number}: the shapes of time-varying parameter {varying.name!r} are {shapes.shape}; "
                f"expected {expected}, one row for each weight and one column for each time"
            )
        found.append(SampledParameter(varying.name, varying.weights, shapes))
    return tuple(found)


# ---- One stretch of measured record, and its time grid for collocation ----


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
        time_varying: parameters that vary along the segment as known shapes, whose weights are in theta0.
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
    time_varying: tuple[TimeVaryingParameter, ...] = ()
    ignores: frozenset[str] = frozenset()
    hold: Hold | Sequence[Hold] = "cubic"


@dataclass(frozen=True)
class DelayedSamples:
    """Quantities a delay earlier: weights on the samples, plus what comes from the history before them."""

    stencil: Stencil
    before: History | None
    before_rate: History | None


@dataclass(frozen=True)
class Grid:
    """A segment made ready: samples and midpoints, measured mask, interpolator.

    `t` and `u` hold the n samples first and then the n - 1 midpoints, (2 n - 1,) and (n_inputs, 2 n - 1); so do
    the time-varying parameters. Where an input `jumps` at the samples, the n - 1 ends of the intervals follow,
    before the jump.
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
    time_varying: tuple[SampledParameter, ...] = ()
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

    def delayed_samples(self, delay: float) -> DelayedSamples:
        """How x(t - delay) and u(t - delay) come about at all samples and midpoints; delay in s."""
        query = self.t - delay
        stencil = self.interpolator.stencil(query)
        history = self.history
        if history is None or delay <= 0:
            return DelayedSamples(stencil, None, None)
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
        return DelayedSamples(stencil, History(query, *known[:2]), History(query, *known[2:]))


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
        time_varying=sampled(segment.time_varying, at, number),
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


def check_consistent(grids: Sequence[Grid]) -> None:
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


# Share of the intervals over which such an input keeps its value exactly, at least: a fast motion rarely keeps it.
_KEPT = 0.5
# Share of its changes that are isolated between intervals that keep the value: those of a smooth pulse stand together.
_ALONE = 0.5
# Changes that are alone, at least: one or two are a switch, or a sample that was repeated.
_LEAST_CHANGES = 3
# Median change as a share of the input's range, at least: rounding to fewer than 20 levels makes such ones too.
_LARGE = 0.05


def stepped_inputs(segments: Sequence[Segment]) -> tuple[str, ...]:
    """A remark that names the inputs that keep and jump, but have the hold "cubic"; none where there are none."""
    found = {
        row: share
        for number, segment in enumerate(segments)
        if segment.u_mid is None
        for row, share in _stepped_on_cubics(segment, number).items()
    }
    if not found:
        return ()
    return (
        f"inputs {sorted(found)} run on a cubic between samples (hold 'cubic'), but keep their value over "
        f"{100.0 * min(found.values()):.0f} % of the intervals and jump between: likely cause: a digital controller's "
        "commands, for which a cubic biases the estimate. Give the segments hold='zero' for these inputs ('linear' if "
        "they ramp from sample to sample), and take the likelier fit",
    )


def _stepped_on_cubics(segment: Segment, number: int) -> dict[int, float]:
    """The rows of such inputs, with the share of the intervals over which each keeps its value."""
    rows = inputs_of(segment)
    kinds = holds(segment.hold, len(rows), number)
    return {
        row: float(np.mean(np.diff(values) == 0.0))
        for row, (values, kind) in enumerate(zip(rows, kinds, strict=True))
        if kind == "cubic" and _is_stepped(values)
    }


def _is_stepped(values: FloatArray) -> bool:
    """True for samples (n,) that stay exactly, and change by large isolated steps."""
    change = np.abs(np.diff(values))
    kept: BoolArray = change == 0.0
    if np.mean(kept) < _KEPT or np.all(kept):
        return False
    alone = ~kept[1:-1] & kept[:-2] & kept[2:]
    large = float(np.median(change[~kept])) > _LARGE * float(np.ptp(values))
    return bool(large and np.count_nonzero(alone) >= max(_LEAST_CHANGES, _ALONE * np.count_nonzero(~kept)))
