"""From flight records to the segments of the likelihood: block means as measurements, smooth inputs.

States are wanted at nodes only as far apart as the motion allows. The measurement at a node is the mean of
the samples around it, taken in de-rolled axes, less what the mean of the predicted motion differs from its
value at the node. That difference is of second order in the block and comes from the regression, which knows
it to far below the noise but where a knot lies in the block: such blocks are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from brv_hypo.arrays import ComplexArray, FloatArray, IntArray
from brv_hypo.design.columns import Column
from brv_hypo.design.frame import RateFrame
from brv_hypo.design.timebasis import TimeFunction
from brv_hypo.design.weakform import WeakSegment
from brv_hypo.flight.record import Vehicle
from brv_hypo.identification.inputs import smooth_pressure, smooth_speed, smoothed
from brv_hypo.identification.instruments import lever_force
from brv_hypo.likelihood import Segment
from brv_hypo.motion.attitude import derolled_attitude, running_integral
from brv_hypo.motion.frames import angle_of_attack, crossflow
from brv_hypo.motion.motion import Motion
from brv_hypo.motion.reconstruction import Reconstruction

INPUTS = (
    "segment",
    "half",
    "p",
    "p_rate",
    "roll",
    "speed",
    "speed_rate",
    "pressure",
    "axial",
    "mach",
    "reynolds",
    "meridian",
    "gravity_xy",
    "gravity_yy",
    "gravity_zy",
    "gravity_xz",
    "gravity_yz",
    "gravity_zz",
)
ROW = {name: row for row, name in enumerate(INPUTS)}
SLOPES = len(INPUTS)
"""First of the rows that hold, for each column with a knot, first and second derivative by time of the
angular acceleration that it makes per unit, in de-rolled axes: real and imaginary part of each, rad/s^3 and
rad/s^4."""
FEWEST_NODES = 12
LARGEST_BLOCK = 5
NODES_IN_A_DELAY = 48
"""The cost of a step grows with the square of the nodes that a delay spans."""


@dataclass(frozen=True)
class Context:
    """What is constant over a segment: its flight, vehicle, first instant (s), meridian rate there (rad/s), a
    block's length (s).
    """

    flight: int
    vehicle: Vehicle
    start: float
    meridian_rate: float
    block: float


@dataclass(frozen=True)
class NodeRecord:
    """One segment of one flight at its nodes and at its samples.

    `measured` and `expected` (2, samples) are omega and transverse specific force in de-rolled axes, as read
    and as the regression has them; `turn` (samples,) is exp(i Phi), `time` s; `middle` (nodes,) the samples
    at the nodes.
    """

    context: Context
    segment: Segment
    time: FloatArray
    turn: ComplexArray
    measured: ComplexArray
    expected: ComplexArray
    middle: IntArray

    def innovations(self, outputs: FloatArray) -> FloatArray:
        """Measured minus predicted q, r, a_y, a_z at every sample, (4, samples), from the outputs (4, nodes).

        Between nodes the prediction follows the regression's, plus the difference of the two.
        """
        seen = np.all(np.isfinite(outputs), axis=0)
        middle = self.middle[seen]
        predicted = (outputs[::2] + 1j * outputs[1::2])[:, seen] * self.turn[middle]
        nodes = self.time[middle]
        correction = CubicSpline(nodes, predicted - self.expected[:, middle], axis=1)
        inside = np.clip(self.time, nodes[0], nodes[-1])
        residual = (self.measured - self.expected - correction(inside)) * np.conj(self.turn)
        return _pairs(list(residual))


def block_size(frame: RateFrame, columns: Sequence[Column], values: FloatArray, tolerance: float) -> int:
    """Samples in a block: the most at which collocation integrates the model's moment as well as the samples
    do.

    The largest difference between the two angular rates may be `tolerance` times the gyros' white noise. The
    number is odd, so that a sample stands in the middle.
    """
    moments, knots = frame.moments(columns) @ values, knots_of(columns)
    longest = max(segment.time.size for segment in frame.segments)
    size = _least_block(frame, columns)
    for trial in range(size + 2, min(LARGEST_BLOCK, longest // FEWEST_NODES) + 1, 2):
        for part, (a, b) in zip(frame.segments, frame.pieces, strict=True):
            allowed = tolerance * frame.reconstructions[part.flight].gyro_sigma
            if _quadrature_error(part, moments[a:b], trial, knots) > allowed:
                return size
        size = trial
    return size


def _least_block(frame: RateFrame, columns: Sequence[Column]) -> int:
    """The smallest odd block with which no delay spans too many nodes."""
    longest = max((column.delay or 0.0 for column in columns), default=0.0)
    step = min(frame.reconstructions[segment.flight].flight.step for segment in frame.segments)
    wanted = int(np.ceil(longest / (NODES_IN_A_DELAY * step)))
    return min(max(wanted + (wanted + 1) % 2, 1), LARGEST_BLOCK)


def knots_of(columns: Sequence[Column]) -> list[float]:
    """Times (s) at which a column has a jump or a kink."""
    return sorted({edge for c in columns for edge in (c.course.start, c.course.stop) if np.isfinite(edge)})


def _quadrature_error(part: WeakSegment, moments: ComplexArray, size: int, knots: Sequence[float]) -> float:
    """Largest error of the angular rate, rad/s, by Simpson's rule on every `size`-th sample; intervals with
    knots left out.
    """
    acceleration = CubicSpline(part.time, part.factor * moments)
    nodes = part.time[size // 2 :: size]
    if nodes.size < 2:
        return 0.0
    step = nodes[1] - nodes[0]
    values, between = acceleration(nodes), acceleration(0.5 * (nodes[1:] + nodes[:-1]))
    simpson = step / 6.0 * (values[:-1] + 4.0 * between + values[1:])
    error = simpson - np.diff(acceleration.antiderivative()(nodes))
    for knot in knots:
        error[(nodes[:-1] - step <= knot) & (knot <= nodes[1:] + step)] = 0.0
    return float(np.max(np.abs(np.cumsum(error))))


def node_records(
    frame: RateFrame,
    columns: Sequence[Column],
    values: FloatArray,
    gravity_turn: Sequence[FloatArray],
    size: int,
) -> tuple[NodeRecord, ...]:
    """Every segment long enough; `gravity_turn` are each flight's axes of the first sample in its de-rolled
    axes.
    """
    predicted, moments = frame.columns(columns) @ values, frame.moments(columns) @ values
    shapes = frame.moments(
        [replace(column, course=TimeFunction("constant")) for column in columns if has_knot(column)]
    )
    found: list[NodeRecord] = []
    for part, (a, b) in zip(frame.segments, frame.pieces, strict=True):
        count = (b - a) // size
        if count < FEWEST_NODES:
            continue
        local = np.arange(count * size).reshape(count, size)
        found.append(
            _node_record(
                frame,
                part,
                predicted[a:b],
                moments[a:b],
                shapes[a:b],
                local,
                gravity_turn[part.flight],
                len(found),
                knots_of(columns),
            )
        )
    return tuple(found)


def roll_angle(reconstruction: Reconstruction) -> FloatArray:
    """Integral of the smoothed roll rate (n,), rad, from the first sample."""
    flight = reconstruction.flight
    return running_integral(flight.time, smoothed(flight.p))


def gravity_axes(reconstruction: Reconstruction) -> FloatArray:
    """(n, 3, 3): row j holds the axes of the first sample along de-rolled axis j at each sample."""
    flight = reconstruction.flight
    omega = reconstruction.motion.q + 1j * reconstruction.motion.r
    turn = derolled_attitude(flight.time, omega * np.exp(1j * roll_angle(reconstruction)))
    return np.asarray(np.transpose(turn, (0, 2, 1)))


def _node_record(
    frame: RateFrame,
    part: WeakSegment,
    predicted: ComplexArray,
    moments: ComplexArray,
    shapes: ComplexArray,
    local: IntArray,
    gravity_turn: FloatArray,
    number: int,
    knots: Sequence[float],
) -> NodeRecord:
    reconstruction = frame.reconstructions[part.flight]
    flight, motion = reconstruction.flight, frame.motions[part.flight]
    samples = slice(part.rows.start, part.rows.start + local.size)
    kept = slice(0, local.size)
    roll = roll_angle(reconstruction)[samples]
    turn = np.exp(1j * roll)
    spin = np.exp(
        -1j * (1.0 - flight.vehicle.inertia_ratio) * running_integral(flight.time, flight.p)[samples]
    )
    omega = (predicted + np.mean(part.observed - predicted))[kept] * spin * turn
    xi = crossflow(motion.alpha, motion.windward_meridian)[samples]
    expected = np.stack(
        [omega, _expected_force(reconstruction, samples, omega / turn, moments[kept], xi) * turn]
    )
    measured = np.stack([flight.q + 1j * flight.r, flight.ay + 1j * flight.az])[:, samples] * turn
    middle = local[:, local.shape[1] // 2]
    mean = (measured - expected)[:, local].mean(axis=2) + expected[:, middle]
    nodes = flight.time[samples][middle]
    tables = _inputs(reconstruction, motion, samples, local, gravity_turn, roll, number)
    acceleration = (flight.dynamic_pressure[samples] * flight.vehicle.moment_scale * turn)[middle]
    slopes = CubicSpline(nodes, shapes[middle] * acceleration[:, None])
    at_nodes, halfway = (
        np.concatenate([table, _slope_rows(slopes, at)])
        for table, at in zip(tables, (nodes, 0.5 * (nodes[1:] + nodes[:-1])), strict=True)
    )
    state = np.stack([omega, xi * flight.velocity[samples] * turn])[:, middle]
    context = Context(
        part.flight,
        flight.vehicle,
        float(nodes[0]),
        float(motion.windward_meridian_rate[samples][middle[0]]),
        flight.step * local.shape[1],
    )
    outputs = _pairs(list(mean * np.conj(turn[middle])))
    if local.shape[1] > 1:
        for knot in knots:
            outputs[:, np.abs(nodes - knot) < context.block] = np.nan
    segment = Segment(nodes, at_nodes, outputs, _pairs(list(state)), u_mid=halfway)
    return NodeRecord(context, segment, flight.time[samples], turn, measured, expected, middle)


def _expected_force(
    reconstruction: Reconstruction,
    samples: slice,
    omega: ComplexArray,
    moments: ComplexArray,
    xi: ComplexArray,
) -> ComplexArray:
    """What the accelerometers should read across the body at the samples, m/s^2."""
    flight = reconstruction.flight
    pressure, p = flight.dynamic_pressure[samples], flight.p[samples]
    slope = np.nan_to_num(reconstruction.normal_force_slope[samples])
    force = (
        -pressure * (flight.vehicle.reference_area / flight.vehicle.mass) * slope * alpha_over_sine(xi) * xi
    )
    omega_rate = (
        pressure * flight.vehicle.moment_scale * moments
        - 1j * (1.0 - flight.vehicle.inertia_ratio) * p * omega
    )
    return np.asarray(
        force + lever_force(flight.vehicle.accelerometer_position, omega, omega_rate, p, np.zeros_like(p))
    )


def _inputs(
    reconstruction: Reconstruction,
    motion: Motion,
    rows: slice,
    local: IntArray,
    gravity_turn: FloatArray,
    roll: FloatArray,
    number: int,
) -> tuple[FloatArray, FloatArray]:
    """Inputs at the nodes (inputs, n) and halfway between them (inputs, n - 1)."""
    flight = reconstruction.flight
    middle = local[:, local.shape[1] // 2]
    nodes = flight.time[rows][middle]
    halfway = 0.5 * (nodes[1:] + nodes[:-1])
    speed = smooth_speed(flight, crossflow(motion.alpha, motion.windward_meridian))
    mean = {
        name: CubicSpline(nodes, np.nan_to_num(values)[rows][local].mean(axis=1))
        for name, values in (
            ("p", smoothed(flight.p)),
            ("speed", speed),
            ("pressure", smooth_pressure(flight, speed)),
            ("axial", flight.ax),
            ("mach", motion.mach),
            ("reynolds", motion.reynolds),
        )
    }
    exact = {
        "roll": CubicSpline(nodes, roll[middle]),
        "meridian": CubicSpline(nodes, motion.windward_meridian[rows][middle]),
        **{
            f"gravity_{first}{second}": CubicSpline(nodes, gravity_turn[rows][middle, i, j])
            for i, second in ((1, "y"), (2, "z"))
            for j, first in enumerate("xyz")
        },
    }
    tables = []
    for time, half in ((nodes, 0.0), (halfway, 0.5 * float(nodes[1] - nodes[0]))):
        table = {name: spline(time) for name, spline in {**mean, **exact}.items()}
        table |= {"p_rate": mean["p"](time, 1), "speed_rate": mean["speed"](time, 1)}
        table |= {"segment": np.full(time.size, float(number)), "half": np.full(time.size, half)}
        tables.append(np.stack([table[name] for name in INPUTS]))
    return tables[0], tables[1]


def _slope_rows(acceleration: CubicSpline, at: FloatArray) -> FloatArray:
    """The rows from SLOPES on (4 x columns with a knot, times) at the times `at`."""
    first, second = acceleration(at, 1).T, acceleration(at, 2).T
    return np.stack([first.real, first.imag, second.real, second.imag], axis=1).reshape(-1, at.size)


def has_knot(column: Column) -> bool:
    """Whether the column's course has a jump or a kink."""
    return bool(np.isfinite(column.course.start) or np.isfinite(column.course.stop))


def alpha_over_sine(xi: ComplexArray) -> FloatArray:
    """alpha / sin(alpha) (n,): a force linear in alpha follows it times the crossflow."""
    size = np.maximum(np.abs(xi), 1e-12)
    return np.asarray(angle_of_attack(xi) / size)


def _pairs(signals: Sequence[ComplexArray]) -> FloatArray:
    """Complex signals as real rows, real part first (2 x signals, n)."""
    return np.stack([part for signal in signals for part in (signal.real, signal.imag)])
