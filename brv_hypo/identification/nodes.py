"""From flight records to the segments of the likelihood: block means as measurements, smooth inputs.

Nodes are as far apart as the motion allows (`block_size`). Near alpha = 0 the windward meridian turns by most of pi
between two samples; there `Meridian` puts more nodes in between, which measure nothing.

The measurement at the node in the middle of a block is the mean of its samples, in de-rolled axes, less the
difference between the mean of the predicted motion and its value at the node. That difference is of second order
in the block, and the regression gives it to far below the noise, except where a knot is in the block: such
blocks are left out. `node_records` is the entrance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from brv_hypo.arrays import ComplexArray, FloatArray, IntArray
from brv_hypo.flight.record import Flight, Vehicle
from brv_hypo.identification import parameters
from brv_hypo.likelihood import Segment
from brv_hypo.linearisation.frame import RateFrame, WeakSegment
from brv_hypo.linearisation.moment_model import delays_requested
from brv_hypo.linearisation.response import gravity_axes
from brv_hypo.model.common_time import OwnTime
from brv_hypo.model.term import Regressor, TimeBasis, evaluated
from brv_hypo.motion.inertial import NominalMotion, inertial_record
from brv_hypo.motion.inputs import SmoothInputs
from brv_hypo.motion.interpolation import running_integral
from brv_hypo.motion.methods import ReconstructionConfig
from brv_hypo.motion.motion import Motion, crossflow

IDENTIFIED_FEWEST_NODES = 12  # of a segment
IDENTIFIED_LARGEST_BLOCK = 5  # samples from node to node
IDENTIFIED_QUADRATURE = 0.2  # of the gyros' noise, that the spacing of nodes may cost
IDENTIFIED_PARTS = 16  # of what is between two nodes, at most
IDENTIFIED_TURN = 0.5  # rad that the meridian, or its rate times a delay, may turn by between two nodes
INPUTS = (
    *("segment", "half", "p", "p_rate", "roll", "speed", "speed_rate", "pressure", "mach", "reynolds", "meridian"),
    *("gravity_xy", "gravity_yy", "gravity_zy", "gravity_xz", "gravity_yz", "gravity_zz", "air_y", "air_z"),
)
ROW = {name: row for row, name in enumerate(INPUTS)}
SLOPES = len(INPUTS)
"""First of the rows that hold, for each column with a knot, first and second derivative by time of the angular
acceleration that it makes per unit, in de-rolled axes: real and imaginary part of each, rad/s^3 and rad/s^4."""


def block_size(frame: RateFrame, columns: Sequence[Regressor], values: FloatArray) -> int:
    """Samples in a block: the most at which collocation integrates the model's moment as well as the samples do. The
    largest difference between the two angular rates may be IDENTIFIED_QUADRATURE times the gyros' white noise,
    stretches left out that have nodes in between. The number is odd, so that a sample is in the middle.
    """
    moments = frame.moments(columns) @ values
    meridians = [Meridian(derolled_crossflow(frame, part), delays_of(frame, columns)) for part in frame.segments]
    longest = max(segment.time.size for segment in frame.segments)
    size = 1
    for trial in range(3, min(IDENTIFIED_LARGEST_BLOCK, longest // IDENTIFIED_FEWEST_NODES) + 1, 2):
        for part, (a, b), meridian in zip(frame.segments, frame.pieces, meridians, strict=True):
            allowed = IDENTIFIED_QUADRATURE * frame.reconstructions[part.flight].gyro_sigma
            knots = knots_of(columns, frame.own_time(part.flight))
            if _quadrature_error(part, moments[a:b], trial, knots, meridian) > allowed:
                return size
        size = trial
    return size


def knots_of(columns: Sequence[Regressor], own: OwnTime | None) -> list[float]:
    """Times (s) at which a column has a jump or a kink, on a flight whose own time goes so with the common one."""
    edges = {edge for c in columns for edge in (c.time_basis.start, c.time_basis.stop) if np.isfinite(edge)}
    return sorted(edges if own is None else {own.own_at(edge) for edge in edges})


def delays_of(frame: RateFrame, columns: Sequence[Regressor]) -> tuple[float, ...]:
    """The delays (s) of the mechanisms of a model, whether these are parameters or not."""
    return delays_requested(frame.motions[0], lambda motion: evaluated(columns, frame.mechanisms, motion))


@dataclass(frozen=True)
class Meridian:
    """How fast the meridian turns in de-rolled axes: `crossflow` is xi there, `delays` s how much earlier counts."""

    crossflow: CubicSpline
    delays: tuple[float, ...]

    def with_nodes_between(self, nodes: FloatArray) -> FloatArray:
        """The nodes (n,) s and more between them where the meridian turns fast, or did so a delay earlier."""
        parts = self.parts(nodes)
        steps = np.diff(nodes) / parts
        first = np.repeat(nodes[:-1], parts)
        within = np.arange(first.size) - np.repeat(np.cumsum(parts) - parts, parts)
        return np.append(first + within * np.repeat(steps, parts), nodes[-1])

    def parts(self, nodes: FloatArray) -> IntArray:
        """Into how many each interval is to be cut (n - 1,), 16 at most."""
        step = np.diff(nodes)
        inside = nodes[:-1, None] + step[:, None] * np.linspace(0.0, 1.0, IDENTIFIED_PARTS + 1)
        xi, xi_rate = self.crossflow(inside), self.crossflow(inside, 1)
        rate = (xi_rate * np.conj(xi)).imag / np.maximum(np.abs(xi) ** 2, 1e-16)
        turned = np.max(np.abs(rate), axis=1) * step
        wanted = np.maximum(turned, max(self.delays, default=0.0) * np.ptp(rate, axis=1))
        for delay in self.delays:
            earlier = np.floor(np.interp(nodes - delay, nodes, np.arange(nodes.size))).astype(np.int64)
            for place in (earlier[:-1], earlier[1:]):
                wanted = np.maximum(wanted, turned[np.minimum(place, turned.size - 1)])
        return np.asarray(np.clip(np.ceil(wanted / IDENTIFIED_TURN), 1, IDENTIFIED_PARTS), dtype=np.int64)


def derolled_crossflow(frame: RateFrame, part: WeakSegment) -> CubicSpline:
    """(v + i w) / V of a segment in de-rolled axes, over time."""
    flight, motion = frame.reconstructions[part.flight].flight, frame.motions[part.flight]
    xi = crossflow(motion.alpha, motion.windward_meridian) * np.exp(1j * running_integral(flight.time, flight.p))
    return CubicSpline(part.time, xi[part.rows])


def _quadrature_error(
    part: WeakSegment, moments: ComplexArray, size: int, knots: Sequence[float], meridian: Meridian
) -> float:
    """Largest error (rad/s) of the rate, by Simpson's rule on every `size`-th sample, knots left out."""
    acceleration = CubicSpline(part.time, part.factor * moments)
    nodes = part.time[size // 2 :: size]
    if nodes.size < 2:
        return 0.0
    step = nodes[1] - nodes[0]
    values, between = acceleration(nodes), acceleration(0.5 * (nodes[1:] + nodes[:-1]))
    simpson = step / 6.0 * (values[:-1] + 4.0 * between + values[1:])
    error = simpson - np.diff(acceleration.antiderivative()(nodes))
    error[meridian.parts(nodes) > 1] = 0.0
    for knot in knots:
        error[(nodes[:-1] - step <= knot) & (knot <= nodes[1:] + step)] = 0.0
    return float(np.max(np.abs(np.cumsum(error))))


@dataclass(frozen=True)
class Context:
    """What is constant over a segment."""

    flight: int
    vehicle: Vehicle
    start: float  # its first instant, s
    meridian_rate: float  # there, rad/s
    block: float  # a block's length, s
    gravity: tuple[FloatArray, FloatArray]  # as `gravity_axes` has it
    own: OwnTime | None = None  # how its time goes with the common one, where flights share it

    def coefficient_time(self, time: FloatArray) -> FloatArray:
        """The times of the time bases at the flight's own times (n,), s."""
        return time if self.own is None else self.own.common_at(time)


@dataclass(frozen=True)
class NodeRecord:
    """One segment of one flight at its nodes and at its samples."""

    context: Context
    segment: Segment
    time: FloatArray  # (samples,), s
    turn: ComplexArray  # exp(i Phi) (samples,)
    measured: ComplexArray  # omega and transverse specific force in de-rolled axes as read, (2, samples)
    expected: ComplexArray  # the same as the regression has them
    middle: IntArray  # the samples at the nodes (nodes,), for nodes that measure nothing the next ones
    samples: slice  # those of the flight
    tolerated: tuple[parameters.Tolerated, ...]  # the flight's values whose parameters count sigmas

    def predicted(self, outputs: FloatArray) -> ComplexArray:
        """Rate and force, de-rolled, at all samples (2, samples): the regression's, corrected at outputs (4, nodes)."""
        valid = np.all(np.isfinite(outputs), axis=0)
        middle = self.middle[valid]
        at_nodes = (outputs[::2] + 1j * outputs[1::2])[:, valid] * self.turn[middle]
        nodes = self.time[middle]
        correction = CubicSpline(nodes, at_nodes - self.expected[:, middle], axis=1)
        inside = np.clip(self.time, nodes[0], nodes[-1])
        return np.asarray(self.expected + correction(inside))

    def innovations(self, outputs: FloatArray) -> FloatArray:
        """Measured minus predicted q, r, a_y, a_z at every sample, (4, samples), from the outputs (4, nodes)."""
        return real_rows(*(self.measured - self.predicted(outputs)) * np.conj(self.turn))

    def fitted(self, flight: Flight, outputs: FloatArray) -> Flight:
        """The flight with the outputs (4, nodes) for readings of the segment."""
        rate, force = _transverse(flight)
        rate[self.samples], force[self.samples] = self.predicted(outputs) * np.conj(self.turn)
        return replace(flight, q=rate.real, r=rate.imag, ay=force.real, az=force.imag)


def node_records(
    frame: RateFrame,
    columns: Sequence[Regressor],
    values: FloatArray,
    rates: ComplexArray,
    inputs: Sequence[SmoothInputs],
    size: int,
    delays: tuple[float, ...],
    fitted: Callable[[int, Flight], Flight] = lambda _, flight: flight,
) -> tuple[NodeRecord, ...]:
    """Every segment long enough; `inputs` are each flight's, `delays` (s) those for which nodes are placed. `rates`
    (rows,) rad/s are de-rolled, as the regression has them; `fitted` puts in an earlier fit's readings.
    """
    noise_free = parameters.noise_free_flights(frame, rates, frame.moments(columns) @ values, inputs)
    quiet = [fitted(number, flight) for number, flight in enumerate(noise_free)]
    errors = parameters.record_errors(frame, quiet, inputs, frozenset(column.mechanism for column in columns))
    nominal = (NominalMotion(inertial_record(r.flight, ReconstructionConfig()), r.start) for r in frame.reconstructions)
    gravity, constant = [gravity_axes(each) for each in nominal], TimeBasis("constant")
    shapes = frame.moments([replace(column, time_basis=constant) for column in columns if has_knot(column)])
    found: list[NodeRecord] = []
    for part, (a, b) in zip(frame.segments, frame.pieces, strict=True):
        count, own = (b - a) // size, frame.own_time(part.flight)
        if count < IDENTIFIED_FEWEST_NODES:
            continue
        flight, motion = frame.reconstructions[part.flight].flight, frame.motions[part.flight]
        local = np.arange(count * size).reshape(count, size)
        middle, samples = local[:, size // 2], slice(part.rows.start, part.rows.start + local.size)
        time, turn = flight.time[samples], np.exp(1j * inputs[part.flight].roll[samples])
        expected = _transverse(quiet[part.flight])[:, samples] * turn
        measured = _transverse(flight)[:, samples] * turn
        nodes = Meridian(derolled_crossflow(frame, part), delays).with_nodes_between(time[middle])
        halfway = 0.5 * (nodes[1:] + nodes[:-1])
        acceleration = (flight.dynamic_pressure[samples] * flight.vehicle.moment_scale * turn)[middle]
        slopes = CubicSpline(time[middle], shapes[a:b][middle] * acceleration[:, None])
        table = _input_table(flight, motion, inputs[part.flight], samples, local, len(found))
        at_nodes = np.concatenate([table(nodes, np.zeros(nodes.size)), _slope_rows(slopes, nodes)])
        between = np.concatenate([table(halfway, 0.5 * np.diff(nodes)), _slope_rows(slopes, halfway)])
        xi = crossflow(motion.alpha, motion.windward_meridian)[samples]
        state = CubicSpline(time, np.stack([expected[0], xi * flight.velocity[samples] * turn]), axis=1)(nodes)
        mean = (measured - expected)[:, local].mean(axis=2) + expected[:, middle]
        outputs = np.full((4, nodes.size), np.nan)
        outputs[:, np.searchsorted(nodes, time[middle])] = real_rows(*mean * np.conj(turn[middle]))
        block = flight.step * size
        for knot in knots_of(columns, own) if size > 1 else ():
            outputs[:, np.abs(nodes - knot) < block] = np.nan
        known, meridian_rate = errors[part.flight], float(motion.windward_meridian_rate[samples][middle[0]])
        smoothed = (parameters.input_error(error, part.flight) for error in inputs[part.flight].errors)
        histories = (*smoothed, *parameters.error_histories(known, part.flight, time, samples, turn, local))
        start, vehicle = float(nodes[0]), flight.vehicle
        context = Context(part.flight, vehicle, start, meridian_rate, block, gravity[part.flight], own)
        segment = Segment(nodes, at_nodes, outputs, real_rows(*state), u_mid=between, time_varying=histories)
        next_sample = np.clip(np.searchsorted(time, nodes), 0, time.size - 1)
        found.append(NodeRecord(context, segment, time, turn, measured, expected, next_sample, samples, tuple(known)))
    return tuple(found)


def _transverse(flight: Flight) -> ComplexArray:
    """q + i r rad/s and a_y + i a_z m/s^2, (2, n)."""
    return np.stack([flight.q + 1j * flight.r, flight.ay + 1j * flight.az])


def _input_table(
    flight: Flight, motion: Motion, smooth: SmoothInputs, rows: slice, local: IntArray, number: int
) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Inputs (inputs, n) of one segment at any times (n,) s, in the middle of intervals of twice so many s (n,). Means
    over blocks where the instruments are noisy, splines between.
    """
    middle = local[:, local.shape[1] // 2]
    noisy = {
        **{"p": smooth.roll_rate, "speed": smooth.speed, "pressure": smooth.pressure},
        **{"mach": motion.mach, "reynolds": motion.reynolds},
    }
    exact = {"roll": smooth.roll, "meridian": motion.windward_meridian}
    for i, second in ((1, "y"), (2, "z")):
        exact |= {f"gravity_{first}{second}": smooth.gravity_axes[:, i, j] for j, first in enumerate("xyz")}
    at_nodes = {name: np.nan_to_num(values)[rows][local].mean(axis=1) for name, values in noisy.items()}
    at_nodes |= {name: values[rows][middle] for name, values in exact.items()}
    splines = {name: CubicSpline(flight.time[rows][middle], values) for name, values in at_nodes.items()}

    def table(time: FloatArray, half: FloatArray) -> FloatArray:
        found = {name: spline(time) for name, spline in splines.items()}
        found |= {f"{name}_rate": splines[name](time, 1) for name in ("p", "speed")}
        found |= {"segment": np.full(time.size, float(number)), "half": half}
        found |= dict.fromkeys(("air_y", "air_z"), np.zeros(time.size))
        if flight.wind is not None:
            # What the crossflow gains in de-rolled axes as the known wind changes, m/s^2: means over an interval or a
            # block, so that Simpson's rule gives the whole change, steps included.
            width = np.where(half > 0.0, half, 0.5 * flight.step * local.shape[1])
            before, after = (
                np.array([np.interp(time + end * width, flight.time, wind) for wind in flight.wind.T])
                for end in (-1.0, 1.0)
            )
            axes = np.array([[found[f"gravity_{first}{axis}"] for first in "xyz"] for axis in "yz"])
            found["air_y"], found["air_z"] = np.einsum("jin,in->jn", axes, (before - after) / (2.0 * width))
        return np.stack([found[name] for name in INPUTS])

    return table


def _slope_rows(acceleration: CubicSpline, at: FloatArray) -> FloatArray:
    """The rows from SLOPES on (4 x columns with a knot, times) at the times `at`."""
    first, second = acceleration(at, 1).T, acceleration(at, 2).T
    return np.stack([first.real, first.imag, second.real, second.imag], axis=1).reshape(-1, at.size)


def has_knot(column: Regressor) -> bool:
    """Whether the column's time basis has a jump or a kink."""
    return bool(np.isfinite(column.time_basis.start) or np.isfinite(column.time_basis.stop))


def real_rows(*signals: ComplexArray) -> FloatArray:
    """Complex signals as real rows, real part first (2 x signals, n)."""
    return np.stack([part for signal in signals for part in (signal.real, signal.imag)])
