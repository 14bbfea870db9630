"""From flight records to the segments of the likelihood: block means as measurements, smooth inputs.

States are wanted at nodes as far apart as the motion allows (`placing`). The measurement at the node in the
middle of a block is the mean of its samples, taken in de-rolled axes, less what the mean of the predicted
motion differs from its value at the node. That difference is of second order in the block and comes from the
regression, which knows it to far below the noise but where a knot lies in the block: such blocks are left
out. Nodes in between measure nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from brv_hypo.arrays import ComplexArray, FloatArray, IntArray
from brv_hypo.constants import IDENTIFIED_FEWEST_NODES
from brv_hypo.flight.record import Flight, Vehicle
from brv_hypo.identification.placing import Meridian, derolled_crossflow, knots_of
from brv_hypo.identification.readings import noise_free_flights
from brv_hypo.identification.record_errors import RecordErrors, Tolerated, record_errors
from brv_hypo.identification.structure import input_course
from brv_hypo.likelihood import Segment
from brv_hypo.model.columns import Column
from brv_hypo.model.common_time import OwnTime
from brv_hypo.model.time_variation import TimeFunction
from brv_hypo.motion.frames import crossflow
from brv_hypo.motion.inputs import SmoothInputs
from brv_hypo.motion.motion import Motion
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.weakform import WeakSegment

INPUTS = (
    "segment",
    "half",
    "p",
    "p_rate",
    "roll",
    "speed",
    "speed_rate",
    "pressure",
    "mach",
    "reynolds",
    "meridian",
    "gravity_xy",
    "gravity_yy",
    "gravity_zy",
    "gravity_xz",
    "gravity_yz",
    "gravity_zz",
    "air_y",
    "air_z",
)
ROW = {name: row for row, name in enumerate(INPUTS)}
SLOPES = len(INPUTS)
"""First of the rows that hold, for each column with a knot, first and second derivative by time of the
angular acceleration that it makes per unit, in de-rolled axes: real and imaginary part of each, rad/s^3 and
rad/s^4."""

@dataclass(frozen=True)
class Context:
    """What is constant over a segment: its flight, vehicle, first instant (s), meridian rate there (rad/s), a
    block's length (s); how its time goes with the common one, where flights share it.
    """

    flight: int
    vehicle: Vehicle
    start: float
    meridian_rate: float
    block: float
    own: OwnTime | None = None

    def course_time(self, time: FloatArray) -> FloatArray:
        """The times that courses are told in at the flight's own times (n,), s."""
        return time if self.own is None else self.own.common_at(time)


@dataclass(frozen=True)
class NodeRecord:
    """One segment of one flight at its nodes and at its samples.

    `measured` and `expected` (2, samples) are omega and transverse specific force in de-rolled axes, as read
    and as the regression has them; `turn` (samples,) is exp(i Phi), `time` s; `middle` (nodes,) the samples
    at the nodes, for nodes that measure nothing the next ones; `samples` are those of the flight; `tolerated` the
    flight's values whose parameters count sigmas.
    """

    context: Context
    segment: Segment
    time: FloatArray
    turn: ComplexArray
    measured: ComplexArray
    expected: ComplexArray
    middle: IntArray
    samples: slice
    tolerated: tuple[Tolerated, ...]

    def predicted(self, outputs: FloatArray) -> ComplexArray:
        """Angular rate and force in de-rolled axes at every sample, (2, samples), from the outputs (4, nodes).

        Between nodes the prediction follows the regression's, plus the difference of the two.
        """
        seen = np.all(np.isfinite(outputs), axis=0)
        middle = self.middle[seen]
        at_nodes = (outputs[::2] + 1j * outputs[1::2])[:, seen] * self.turn[middle]
        nodes = self.time[middle]
        correction = CubicSpline(nodes, at_nodes - self.expected[:, middle], axis=1)
        inside = np.clip(self.time, nodes[0], nodes[-1])
        return np.asarray(self.expected + correction(inside))

    def innovations(self, outputs: FloatArray) -> FloatArray:
        """Measured minus predicted q, r, a_y, a_z at every sample, (4, samples), from the outputs (4, nodes)."""
        return _pairs(list((self.measured - self.predicted(outputs)) * np.conj(self.turn)))

    def fitted(self, flight: Flight, outputs: FloatArray) -> Flight:
        """The flight with the outputs (4, nodes) for readings of the segment."""
        rate, force = _transverse(flight)
        rate[self.samples], force[self.samples] = self.predicted(outputs) * np.conj(self.turn)
        return replace(flight, q=rate.real, r=rate.imag, ay=force.real, az=force.imag)


def node_records(
    frame: RateFrame,
    columns: Sequence[Column],
    values: FloatArray,
    rates: ComplexArray,
    inputs: Sequence[SmoothInputs],
    size: int,
    delays: tuple[float, ...],
    fitted: Callable[[int, Flight], Flight] = lambda _, flight: flight,
) -> tuple[NodeRecord, ...]:
    """Every segment long enough; `inputs` are each flight's, `delays` (s) those for which nodes are placed.

    `rates` (rows,) rad/s are de-rolled, as the regression has them; `fitted` puts an earlier fit's readings into a
    noise-free flight.
    """
    moments = frame.moments(columns) @ values
    noise_free = noise_free_flights(frame, rates, moments, inputs)
    expected = [fitted(number, flight) for number, flight in enumerate(noise_free)]
    errors = record_errors(frame, expected, inputs, frozenset(column.mechanism for column in columns))
    shapes = frame.moments(
        [replace(column, course=TimeFunction("constant")) for column in columns if has_knot(column)]
    )
    found: list[NodeRecord] = []
    for part, (a, b) in zip(frame.segments, frame.pieces, strict=True):
        count = (b - a) // size
        if count < IDENTIFIED_FEWEST_NODES:
            continue
        local = np.arange(count * size).reshape(count, size)
        found.append(
            _node_record(
                frame,
                part,
                expected[part.flight],
                errors[part.flight],
                shapes[a:b],
                local,
                inputs[part.flight],
                len(found),
                knots_of(columns, frame.own_time(part.flight)),
                Meridian(derolled_crossflow(frame, part), delays),
            )
        )
    return tuple(found)


def _node_record(
    frame: RateFrame,
    part: WeakSegment,
    noise_free: Flight,
    errors: RecordErrors,
    shapes: ComplexArray,
    local: IntArray,
    inputs: SmoothInputs,
    number: int,
    knots: Sequence[float],
    meridian: Meridian,
) -> NodeRecord:
    reconstruction = frame.reconstructions[part.flight]
    flight, motion = reconstruction.flight, frame.motions[part.flight]
    samples = slice(part.rows.start, part.rows.start + local.size)
    turn = np.exp(1j * inputs.roll[samples])
    xi = crossflow(motion.alpha, motion.windward_meridian)[samples]
    expected = _transverse(noise_free)[:, samples] * turn
    measured = _transverse(flight)[:, samples] * turn
    middle = local[:, local.shape[1] // 2]
    time = flight.time[samples]
    nodes = meridian.with_nodes_between(time[middle])
    measuring = np.searchsorted(nodes, time[middle])
    halfway = 0.5 * (nodes[1:] + nodes[:-1])
    acceleration = (flight.dynamic_pressure[samples] * flight.vehicle.moment_scale * turn)[middle]
    slopes = CubicSpline(time[middle], shapes[middle] * acceleration[:, None])
    table = _InputTable(flight, motion, inputs, samples, local, number)
    at_nodes = np.concatenate([table(nodes, np.zeros(nodes.size)), _slope_rows(slopes, nodes)])
    between = np.concatenate([table(halfway, 0.5 * np.diff(nodes)), _slope_rows(slopes, halfway)])
    state = CubicSpline(time, np.stack([expected[0], xi * flight.velocity[samples] * turn]), axis=1)(nodes)
    context = Context(
        part.flight,
        flight.vehicle,
        float(nodes[0]),
        float(motion.windward_meridian_rate[samples][middle[0]]),
        flight.step * local.shape[1],
        frame.own_time(part.flight),
    )
    mean = (measured - expected)[:, local].mean(axis=2) + expected[:, middle]
    outputs = np.full((4, nodes.size), np.nan)
    outputs[:, measuring] = _pairs(list(mean * np.conj(turn[middle])))
    if local.shape[1] > 1:
        for knot in knots:
            outputs[:, np.abs(nodes - knot) < context.block] = np.nan
    smoothed = (input_course(error, part.flight) for error in inputs.errors)
    courses = (*smoothed, *errors.courses(time, samples, turn, local))
    segment = Segment(nodes, at_nodes, outputs, _pairs(list(state)), u_mid=between, courses=courses)
    nearest = np.clip(np.searchsorted(time, nodes), 0, time.size - 1)
    return NodeRecord(context, segment, time, turn, measured, expected, nearest, samples, errors.values)


def _transverse(flight: Flight) -> ComplexArray:
    """q + i r rad/s and a_y + i a_z m/s^2, (2, n)."""
    return np.stack([flight.q + 1j * flight.r, flight.ay + 1j * flight.az])


class _InputTable:
    """Inputs of one segment at any times: means over blocks where the instruments are noisy, splines
    between.
    """

    def __init__(
        self,
        flight: Flight,
        motion: Motion,
        smooth: SmoothInputs,
        rows: slice,
        local: IntArray,
        number: int,
    ) -> None:
        middle = local[:, local.shape[1] // 2]
        nodes = flight.time[rows][middle]
        self._number = float(number)
        self._time, self._wind, self._block = flight.time, flight.wind, flight.step * local.shape[1]
        self._mean = {
            name: CubicSpline(nodes, np.nan_to_num(values)[rows][local].mean(axis=1))
            for name, values in (
                ("p", smooth.roll_rate),
                ("speed", smooth.speed),
                ("pressure", smooth.pressure),
                ("mach", motion.mach),
                ("reynolds", motion.reynolds),
            )
        }
        self._exact = {
            "roll": CubicSpline(nodes, smooth.roll[rows][middle]),
            "meridian": CubicSpline(nodes, motion.windward_meridian[rows][middle]),
            **{
                f"gravity_{first}{second}": CubicSpline(nodes, smooth.gravity_axes[rows][middle, i, j])
                for i, second in ((1, "y"), (2, "z"))
                for j, first in enumerate("xyz")
            },
        }

    def __call__(self, time: FloatArray, half: FloatArray) -> FloatArray:
        """The inputs (inputs, n) at times (n,) s, in the middle of intervals of twice `half` (n,) s."""
        table = {name: spline(time) for name, spline in {**self._mean, **self._exact}.items()}
        table |= {"p_rate": self._mean["p"](time, 1), "speed_rate": self._mean["speed"](time, 1)}
        table |= {"segment": np.full(time.size, self._number), "half": half}
        table |= dict(zip(("air_y", "air_z"), self._gained(time, half, table), strict=True))
        return np.stack([table[name] for name in INPUTS])

    def _gained(self, time: FloatArray, half: FloatArray, table: dict[str, FloatArray]) -> FloatArray:
        """What the crossflow gains in de-rolled axes as the known wind changes (2, n), m/s^2.

        Means over an interval or a block, so that Simpson's rule gives the whole change, steps included.
        """
        if self._wind is None:
            return np.zeros((2, time.size))
        width = np.where(half > 0.0, half, 0.5 * self._block)
        before, after = (
            np.array([np.interp(time + end * width, self._time, wind) for wind in self._wind.T])
            for end in (-1.0, 1.0)
        )
        rate = (before - after) / (2.0 * width)
        axes = np.array([[table[f"gravity_{first}{axis}"] for first in "xyz"] for axis in "yz"])
        return np.asarray(np.einsum("jin,in->jn", axes, rate))


def _slope_rows(acceleration: CubicSpline, at: FloatArray) -> FloatArray:
    """The rows from SLOPES on (4 x columns with a knot, times) at the times `at`."""
    first, second = acceleration(at, 1).T, acceleration(at, 2).T
    return np.stack([first.real, first.imag, second.real, second.imag], axis=1).reshape(-1, at.size)


def has_knot(column: Column) -> bool:
    """Whether the column's course has a jump or a kink."""
    return bool(np.isfinite(column.course.start) or np.isfinite(column.course.stop))


def _pairs(signals: Sequence[ComplexArray]) -> FloatArray:
    """Complex signals as real rows, real part first (2 x signals, n)."""
    return np.stack([part for signal in signals for part in (signal.real, signal.imag)])
