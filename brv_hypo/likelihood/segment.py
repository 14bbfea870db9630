"""The checked input: a continuous measured record with its time grid for collocation, and the unknown parameters.

A `Segment` holds times, inputs, outputs (nan where nothing was measured) and a first guess of the states. Inputs run
between samples as `hold` says: constant, linear, or by the local cubic of `interpolation`, whose nodal slopes are those
of the quartic through five samples: fourth-order accurate, with a continuous first derivative, so that a cost that
depends on x(t - tau) is smooth in tau.

A `TimeVaryingParameter` is theta(t) = sum over j of weight_j basis_j(t), the weights being parameters; its derivative
is computed once, those by the weights are the basis functions times it. `build_grid` checks a segment and lays out its
grid, `build_parameters` the names, start values, bounds and priors.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray, IntArray
from brv_hypo.errors import UsageError

if TYPE_CHECKING:
    from scipy.sparse import csr_array

WIDTH = 6  # samples that take part in one interpolated value
_SLOPE_WIDTH = 5

Weights = tuple["csr_array[np.float64]", "csr_array[np.float64]"]
"""What gives a signal at some times and its derivative there, 1/s, from its samples: each (times, samples)."""


def interpolation(t: FloatArray, query: FloatArray) -> Weights:
    """At the query times, (m,) s, of a signal sampled at t, (n,) s, at least six; outside, the end value, of rate 0."""
    from scipy.sparse import csr_array  # here, for a cheap import of the package

    clipped = np.clip(query, t[0], t[-1])
    left = np.clip(np.searchsorted(t, clipped, side="right") - 1, 0, t.size - 2)
    step = t[left + 1] - t[left]
    s, inside = (clipped - t[left]) / step, query == clipped
    slopes, neighbours = _slopes(t), np.stack([left, left + 1], axis=1).ravel()

    def spread(*weights: FloatArray) -> csr_array[np.float64]:
        """Weights of the samples before and after."""
        rows = 2 * np.arange(query.size + 1)
        return csr_array((np.stack(weights, axis=1).ravel(), neighbours, rows), shape=(query.size, t.size))

    by_value = spread((1 + 2 * s) * (1 - s) ** 2, s**2 * (3 - 2 * s))
    by_slope = spread(s * (1 - s) ** 2 * step, s**2 * (s - 1) * step)
    rate_by_value = spread(6 * s * (s - 1) / step * inside, -6 * s * (s - 1) / step * inside)
    rate_by_slope = spread((1 - s) * (1 - 3 * s) * inside, s * (3 * s - 2) * inside)
    return by_value + by_slope @ slopes, rate_by_value + rate_by_slope @ slopes


def _slopes(t: FloatArray) -> csr_array[np.float64]:
    """The derivative at each sample of the quartic through five samples, 1/s, (n, n)."""
    from scipy.sparse import csr_array

    rows = np.arange(t.size)
    start = np.clip(rows - _SLOPE_WIDTH // 2, 0, t.size - _SLOPE_WIDTH)
    columns = start[:, None] + np.arange(_SLOPE_WIDTH)
    z, here = t[columns], rows - start
    apart = z[:, :, None] - z[:, None, :]
    apart[:, range(_SLOPE_WIDTH), range(_SLOPE_WIDTH)] = 1.0
    barycentric = 1.0 / apart.prod(axis=2)
    distance = t[:, None] - z
    distance[rows, here] = 1.0
    weights = barycentric / barycentric[rows, here][:, None] / distance
    weights[rows, here] = 0.0
    weights[rows, here] = -weights.sum(axis=1)
    return csr_array((weights.ravel(), columns.ravel(), _SLOPE_WIDTH * np.arange(t.size + 1)), shape=(t.size, t.size))


@dataclass(frozen=True)
class TimeVaryingParameter:
    """theta[name] (n,) = sum over j of theta[weights[j]] shapes(t)[j], as the user's functions see it."""

    name: str  # under which dynamics and outputs find the values, at their own samples; no parameter has it
    weights: tuple[str, ...]  # parameters that act through time-varying parameters only: this one and others
    shapes: Callable[[FloatArray], FloatArray]  # t (n,), s -> (len(weights), n)


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
    """The time-varying parameters at times t (n,), s; UsageError for shapes of the wrong size."""
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


Hold = Literal["zero", "linear", "cubic"]
"""An input between samples: as at the last one, jumping at the next, on a straight line, or on a cubic."""


@dataclass(frozen=True)
class Segment:
    """A continuous stretch of record, with its own initial state."""

    t: FloatArray  # sample times, (n,), s, increasing; at least six
    u: FloatArray  # known inputs, (n_inputs, n); (0, n) where there are none
    y: FloatArray  # measured outputs, (n_outputs, n); NaN where one was not measured
    x0: FloatArray  # guess of the initial state, (n_states,), or of the whole history, (n_states, n)
    x0_std: float | FloatArray = np.inf  # of x0, scalar or (n_states,): infinity leaves it free, 0 holds it, a prior
    u_mid: FloatArray | None = None  # inputs halfway between samples, (n_inputs, n - 1); as `hold` says when left out
    time_varying: tuple[TimeVaryingParameter, ...] = ()  # known shapes in time; their weights are in theta0
    ignores: frozenset[str] = frozenset()  # parameters that neither function uses here: not differentiated by
    hold: Hold = "cubic"  # inputs between samples; delayed inputs are interpolated by a cubic


@dataclass(frozen=True)
class Grid:
    """A segment made ready: n samples, the n - 1 midpoints, and where inputs jump the n - 1 ends before the jump."""

    t: FloatArray  # times of samples, midpoints and ends, in that order, (2 n - 1,) or (3 n - 2,), s
    u: FloatArray  # inputs there, (n_inputs, times)
    y: FloatArray  # measured outputs, (n_outputs, n), NaN in gaps
    measured: BoolArray  # where they are not, (n_outputs, n)
    step: FloatArray  # lengths of the intervals, (n - 1,), s
    start: FloatArray  # guess of the initial state, (n_states,), or of the history, (n_states, n)
    start_std: FloatArray  # standard deviation of the initial state, (n_states,), infinite where it is free
    time_varying: tuple[SampledParameter, ...] = ()  # time-varying parameters at `t`
    ignores: frozenset[str] = frozenset()  # see `Segment`
    jumps: bool = False  # whether inputs jump at the samples

    @property
    def n(self) -> int:
        """Number of samples."""
        return int(self.y.shape[1])

    @property
    def intervals(self) -> tuple[slice, slice, slice]:
        """Where `t` and `u` have the intervals' starts, midpoints and ends; without jumps the ends are samples."""
        n = self.n
        return slice(n - 1), slice(n, 2 * n - 1), slice(2 * n - 1, None) if self.jumps else slice(1, n)

    @property
    def first(self) -> FloatArray:
        """The guess of the initial state, (n_states,)."""
        return self.start if self.start.ndim == 1 else self.start[:, 0]

    def delayed(self, delay: float) -> Weights:
        """How x(t - delay) and u(t - delay) come about from the samples, at all times; delay in s."""
        return interpolation(self.t[: self.n], self.t - delay)


def inputs_of(segment: Segment) -> FloatArray:
    """The known inputs at the samples, (n_inputs, n); (0, n) where there are none."""
    u = np.asarray(segment.u, dtype=float)
    return u.reshape(0, np.size(segment.t)) if u.size == 0 else np.atleast_2d(u)


def build_grid(segment: Segment, number: int) -> Grid:
    """Check a segment and lay out its grid; UsageError for what does not fit together."""
    for fault in _faults(segment):
        raise UsageError(f"segment {number}: {fault}")
    t, u = np.asarray(segment.t, dtype=float), inputs_of(segment)
    y, x0 = np.atleast_2d(np.asarray(segment.y, dtype=float)), np.asarray(segment.x0, dtype=float)
    middle = 0.5 * (t[:-1] + t[1:])
    u_mid = inputs_at(segment, middle) if segment.u_mid is None else np.asarray(segment.u_mid, dtype=float)
    jumps = segment.hold == "zero"
    at = np.concatenate([t, middle, t[1:] if jumps else t[:0]])
    return Grid(
        t=at,
        u=np.concatenate([u, u_mid, u[:, :-1] if jumps else u[:, :0]], axis=1),
        y=y,
        measured=np.isfinite(y),
        step=np.diff(t),
        start=x0,
        start_std=np.broadcast_to(np.asarray(segment.x0_std, dtype=float), x0.shape[:1]),
        time_varying=sampled(segment.time_varying, at, number),
        ignores=frozenset(segment.ignores),
        jumps=jumps,
    )


def _faults(segment: Segment) -> Iterator[str]:
    """What does not fit together, each as far as what comes before it does."""
    t, y = np.asarray(segment.t, dtype=float), np.atleast_2d(np.asarray(segment.y, dtype=float))
    u, x0, x0_std = inputs_of(segment), np.asarray(segment.x0, dtype=float), np.asarray(segment.x0_std, dtype=float)
    if t.ndim != 1 or t.size < WIDTH:
        yield f"t has shape {t.shape}; expected one dimension and at least {WIDTH} samples"
    if not np.all(np.isfinite(t)) or np.any(np.diff(t) <= 0):
        yield (
            "the sample times do not increase, or are not finite; remove repeated samples, and cut the record into "
            "segments where it has gaps"
        )
    for name, array in (("u", u), ("y", y)):
        if array.shape[1:] != t.shape:
            yield f"{name} has shape {array.shape}; expected (rows, {t.size}), one column per sample"
    if not np.any(np.isfinite(y)):
        yield (
            f"y, of shape {y.shape}, holds no measured value; expected at least one row that is not NaN throughout. "
            "Check the record, or leave the segment out"
        )
    if not np.all(np.isfinite(u)):
        yield "u is not finite everywhere; only y may have gaps (NaN): interpolate u first"
    if x0.ndim in (1, 2) and x0.shape[0] == 0:
        yield "x0 is empty, so that the model has no states; expected at least one"
    if x0.ndim not in (1, 2) or (x0.ndim == 2 and x0.shape[1] != t.size) or not np.all(np.isfinite(x0)):
        yield f"x0 has shape {x0.shape}; expected finite values, (n_states,) or (n_states, {t.size})"
    if segment.hold not in get_args(Hold):
        yield f"hold is {segment.hold!r}; expected one of {list(get_args(Hold))}"
    if x0_std.shape not in ((), x0.shape[:1]) or not np.all(x0_std >= 0.0):
        yield (
            f"x0_std is {x0_std.tolist()}; expected one number, or one for each of the {x0.shape[0]} "
            "states, none negative: 0 holds an initial state, infinity leaves it free"
        )
    expected = (u.shape[0], t.size - 1)
    if segment.u_mid is not None and np.shape(segment.u_mid) != expected:
        yield f"u_mid has shape {np.shape(segment.u_mid)}; expected {expected}, one column per interval"


def inputs_at(segment: Segment, at: FloatArray) -> FloatArray:
    """Inputs (n_inputs, len(at)) at times within the segment, as it has them between its samples."""
    t, u = np.asarray(segment.t, dtype=float), inputs_of(segment)
    before = np.clip(np.searchsorted(t, at, side="right") - 1, 0, t.size - 2)
    s = (at - t[before]) / (t[before + 1] - t[before])
    if segment.u_mid is not None:
        middle = np.asarray(segment.u_mid, dtype=float)[:, before]
        end = u[:, before if segment.hold == "zero" else before + 1]
        within = 2 * (s - 0.5) * (s - 1) * u[:, before] + 4 * s * (1 - s) * middle + 2 * s * (s - 0.5) * end
        return np.where(at >= t[-1], u[:, -1:], within)
    if segment.hold == "zero":
        return u[:, np.where(at >= t[-1], t.size - 1, before)]
    if segment.hold == "linear":
        return np.asarray((1.0 - s) * u[:, before] + s * u[:, before + 1])
    return np.asarray(u @ interpolation(t, at)[0].T)


@dataclass(frozen=True)
class Parameters:
    """The free parameters as one vector, (p,), in the order of `names`."""

    names: tuple[str, ...]  # names of the free parameters
    start: FloatArray  # start values, (p,)
    lower: FloatArray  # lower bounds, (p,), -infinity where there is none
    upper: FloatArray  # upper bounds, (p,)
    prior_mean: FloatArray  # means of the priors, (p,)
    prior_std: FloatArray  # standard deviations of the priors, (p,), infinity where there is none
    held: Mapping[str, float]  # values of the parameters that are held, by name

    def as_mapping(self, vector: FloatArray) -> dict[str, float]:
        """Name to value, held ones last, as the user's functions see them."""
        return dict(zip(self.names, vector.tolist(), strict=True)) | dict(self.held)

    def spread(self, values: Mapping[str, float], rest: float) -> FloatArray:
        """One number a parameter, (p,), `rest` for those not named; UsageError for a name that theta0 does not have."""
        unknown = sorted(set(values) - {*self.names, *self.held})
        if unknown:
            raise UsageError(f"reach names {unknown}, which theta0 does not have; it has {sorted(self.names)}")
        return np.array([values.get(name, rest) for name in self.names], dtype=float)


def build_parameters(
    theta0: Mapping[str, float], bounds: Mapping[str, tuple[float, float]], priors: Mapping[str, tuple[float, float]]
) -> Parameters:
    """The parameters in one vector, those of equal bounds held; UsageError for what makes no sense."""
    for fault in _senseless(theta0, bounds, priors):
        raise UsageError(fault)
    limits = {name: bounds.get(name, (-np.inf, np.inf)) for name in theta0}
    names = tuple(name for name, (lower, upper) in limits.items() if lower < upper)
    lower, upper = np.array([limits[name] for name in names], dtype=float).T
    prior = np.array([priors.get(name, (0.0, np.inf)) for name in names], dtype=float)
    return Parameters(
        names=names,
        start=np.array([float(theta0[name]) for name in names]),
        lower=lower,
        upper=upper,
        prior_mean=prior[:, 0],
        prior_std=prior[:, 1],
        held={name: float(theta0[name]) for name in theta0 if name not in names},
    )


def _senseless(
    theta0: Mapping[str, float], bounds: Mapping[str, tuple[float, float]], priors: Mapping[str, tuple[float, float]]
) -> Iterator[str]:
    """Unknown names, bounds and priors that make no sense, starts outside their bounds, nothing free."""
    for what, given in (("bounds", bounds), ("priors", priors)):
        unknown = sorted(set(given) - set(theta0))
        if unknown:
            yield f"{what} names {unknown}, which theta0 does not have; it has {sorted(theta0)}"
    if not theta0:
        yield "theta0 is empty: there is nothing to estimate; expected start values by name"
    for name, value in theta0.items():
        (lower, upper), (mean, std) = bounds.get(name, (-np.inf, np.inf)), priors.get(name, (0.0, np.inf))
        if not np.isfinite(value):
            yield f"theta0[{name!r}] is {value}; expected a finite start value"
        if not lower <= upper:
            yield f"bounds of {name!r} are ({lower}, {upper}); expected lower <= upper, equal to hold it"
        if not lower <= value <= upper:
            yield f"theta0[{name!r}] = {value} lies outside its bounds ({lower}, {upper}); move one of them"
        if not std > 0:
            yield f"the prior of {name!r} has mean {mean} and standard deviation {std}; expected a positive one"
    if all(name in bounds and bounds[name][0] == bounds[name][1] for name in theta0):
        yield "every parameter of theta0 is held by its bounds: there is nothing to estimate; free one"
