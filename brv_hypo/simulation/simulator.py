"""From a configuration to a simulated flight: integrate, read the instruments, note the truth.

Nodes of the integration are uniform, with every jump and kink of the moments added; steps are cut where the windward
meridian turns fast. Mechanisms with delays are given cubic Hermite interpolation of the motion so far
(`Trajectory.past`). `SimulatedFlight` holds what instruments say and, apart, the truth. Entrance: `simulate`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Unpack

import numpy as np
import yaml

from brv_hypo.arrays import BoolArray, FloatArray, IntArray
from brv_hypo.errors import UnanswerableError, UsageError
from brv_hypo.flight.derived import HIGHEST_ALTITUDE
from brv_hypo.flight.format import Quantity, assemble, save_flight
from brv_hypo.flight.record import Flight, Record
from brv_hypo.model.term import delays_among
from brv_hypo.motion.motion import Motion
from brv_hypo.motion.signals import rms
from brv_hypo.progress import Progress, Report, report_to, silent
from brv_hypo.results import Histories
from brv_hypo.settings import takes_settings
from brv_hypo.simulation.config import ConfigSource, SimulationConfig, SimulationSettings, load_config, numbers
from brv_hypo.simulation.instruments import drawn, recorded, sensed_channels, wind_profile
from brv_hypo.simulation.vehicle import ATTITUDE, RATES, STATES, AirData, Equations, dot, initial_state, planted, system

FASTEST_TURNING = 1000.0  # rad/s, of any body rate: beyond it a motion diverges
_ASIDE = 1e-10  # s by which a stage steps aside from a jump, to see the moments on its own side of it
_SAME = 1e-9  # s between two times that are one
_TURN, _MOST_PARTS = 0.1, 64  # rad by which the meridian may turn in one step; parts of a step, at most


class Trajectory:
    """An integrated flight: states (n, 13, 1) and their rates at the nodes passed so far. At a break the rate jumps:
    the interval before it ends with the rate before the jump, the one after begins with the rate after it.
    """

    def __init__(self, system: Equations) -> None:
        self.system = system
        self.nodes, self.breaks, self.samples = grid(system)
        self.states = np.zeros((self.nodes.size, STATES, 1))
        self.rates = np.zeros_like(self.states)
        """That follow each node; `rates_before` lead up to it, which differ at a break."""
        self.rates_before = np.zeros_like(self.states)
        self.meridians = np.zeros((self.nodes.size, 1))
        self._last = 0
        self._recent: dict[bytes, Motion] = {}

    def store(self, node: int, state: FloatArray, rate: FloatArray, meridian: FloatArray) -> None:
        """The state of a node with the rate that follows it."""
        self.states[node], self.rates[node], self.meridians[node] = state, rate, meridian
        if not self.breaks[node]:
            self.rates_before[node] = rate
        self._last = node
        self._recent.clear()

    def past(self, time: FloatArray) -> Motion:
        """The motion at `time` (1,) s; before the start it is steady (see `Motion.delayed`)."""
        key = time.tobytes()
        if key not in self._recent:
            self._recent[key] = self._motion(time)
        return self._recent[key]

    def _motion(self, time: FloatArray) -> Motion:
        begin, end = self.nodes[0], self.nodes[self._last]
        if np.any(time > end + 1e-9):
            raise UsageError(
                f"a planted mechanism asked for the motion at {float(np.max(time)):.6g} s, but the "
                f"integration has only reached {float(end):.6g} s: its delay is shorter than the step. "
                "Reduce `step` to the delay or less."
            )
        inside = np.maximum(time, begin)
        left = min(max(int(np.searchsorted(self.nodes, inside[0], side="right")) - 1, 0), max(self._last - 1, 0))
        right = left + 1
        step = self.nodes[right] - self.nodes[left]
        s = (inside - self.nodes[left]) / step
        s2, s3 = s * s, s * s * s
        state = (
            (2.0 * s3 - 3.0 * s2 + 1.0) * self.states[left]
            + (s3 - 2.0 * s2 + s) * step * self.rates[left]
            + (3.0 * s2 - 2.0 * s3) * self.states[right]
            + (s3 - s2) * step * self.rates_before[right]
        )
        motion = self.system.motion(time, state, self.system.air_data(time, state), self.meridians[left], self.past)
        if np.all(time >= begin):
            return motion
        turned = motion.windward_meridian + (time - inside) * motion.windward_meridian_rate
        return replace(motion, windward_meridian=turned)


def break_times(system: Equations) -> FloatArray:
    """Where moments jump or kink (s): region edges, and what follows one and two delays later."""
    edges, delays = [], [0.0]
    for item in system.planted:
        edges += [edge for edge in (item.time_basis.start, item.time_basis.stop) if np.isfinite(edge)]
        delays += [item.theta[each.name] * each.seconds for each in delays_among(item.mechanism.parameters())]
    first, later_by = np.unique(np.array(edges, dtype=float)), np.unique(delays)
    # The start is a kink only for delays that reach it.
    kinks = np.concatenate([first, [system.config.start.time]]) if later_by.size > 1 else first
    later = np.unique(kinks[:, None] + later_by)
    return np.unique(np.concatenate([first, np.ravel(later), np.ravel(later[:, None] + later_by)]))


def grid(system: Equations) -> tuple[FloatArray, BoolArray, IntArray]:
    """Nodes (n,) s, a step apart and at breaks; which of them are breaks (n,); the nodes that are samples (m,)."""
    config, breaks = system.config, break_times(system)
    start, step = config.start.time, config.step
    uniform = start + step * np.arange((config.samples - 1) * config.steps_per_sample + 1)
    inside = np.unique(breaks[(breaks >= start - _SAME) & (breaks <= uniform[-1] + _SAME)])
    offset = np.abs(inside - uniform[np.clip(np.rint((inside - start) / step).astype(int), 0, uniform.size - 1)])
    extra = inside[offset > _SAME]
    extra = extra[np.diff(extra, prepend=-np.inf) > _SAME]
    nodes = np.sort(np.concatenate([uniform, extra]))
    marked = np.zeros(nodes.size, dtype=np.bool_)
    marked[np.clip(np.searchsorted(nodes, inside - _SAME), 0, nodes.size - 1)] = True
    return nodes, marked, np.searchsorted(nodes, uniform[:: config.steps_per_sample]).astype(np.int64)


def integrate(system: Equations, state: FloatArray, report: Report = silent) -> Trajectory:
    """The trajectory from `state` (13, 1) by the classical Runge-Kutta method; `report` is called now and then."""
    trajectory = Trajectory(system)
    nodes, breaks = trajectory.nodes, trajectory.breaks

    def rate(time: float, value: FloatArray, near: FloatArray) -> tuple[FloatArray, Motion]:
        instant = np.full(1, time)
        air = system.air_data(instant, value)
        motion = system.motion(instant, value, air, near, trajectory.past)
        return system.state_rate(value, air, motion), motion

    near = np.zeros(1)
    trajectory.store(0, state, np.zeros_like(state), near)  # the first stage may need the past already
    for node in range(nodes.size - 1):
        begin, end = nodes[node], nodes[node + 1]
        after = begin + _ASIDE if breaks[node] else begin
        before = end - _ASIDE if breaks[node + 1] else end
        k1, motion = rate(after, state, near)
        near = motion.windward_meridian
        trajectory.store(node, state, k1, near)
        parts = _parts(motion, end - begin)
        step = (end - begin) / parts
        for part in range(parts):
            now = begin + part * step
            if part > 0:
                k1, motion = rate(now, state, near)
                near = motion.windward_meridian
            k2, _ = rate(now + 0.5 * step, state + (0.5 * step) * k1, near)
            k3, _ = rate(now + 0.5 * step, state + (0.5 * step) * k2, near)
            k4, _ = rate(before if part == parts - 1 else now + step, state + step * k3, near)
            state = state + (step / 6.0) * (k1 + 2.0 * (k2 + k3) + k4)
            state[ATTITUDE] /= np.sqrt(dot(state[ATTITUDE], state[ATTITUDE]))
        if breaks[node + 1]:
            trajectory.rates_before[node + 1] = rate(before, state, near)[0]
        if node % 64 == 0:
            report(node / nodes.size, "simulating")
    k1, motion = rate(nodes[-1] + _ASIDE if breaks[-1] else nodes[-1], state, near)
    trajectory.store(nodes.size - 1, state, k1, motion.windward_meridian)
    return trajectory


def _parts(motion: Motion, step: float) -> int:
    """Into how many parts a step (s) is cut, by how fast the meridian turns where a straight crossflow is least."""
    alpha, turning = motion.alpha, motion.alpha * motion.windward_meridian_rate
    speed_squared = np.maximum(motion.alpha_rate**2 + turning**2, 1e-300)
    ahead = np.clip(-alpha * motion.alpha_rate / speed_squared, 0.0, step)
    nearest = (alpha + motion.alpha_rate * ahead) ** 2 + (turning * ahead) ** 2
    turn = np.abs(alpha * turning) / np.maximum(nearest, 1e-16) * step
    largest = float(np.max(np.minimum(np.fmax(turn, 0.0), np.pi), initial=0.0))  # fmax: 0 where it is NaN
    return min(max(int(np.ceil(largest / _TURN)), 1), _MOST_PARTS)


@dataclass(frozen=True)
class Truth:
    """What was flown, at the record's samples (m,)."""

    time: FloatArray  # s
    alpha: FloatArray  # total angle of attack, rad
    windward_meridian: FloatArray  # rad, unwrapped
    C_m: FloatArray  # total pitching moment
    C_n: FloatArray  # total yawing moment
    C_N: FloatArray  # C_N', the total moment in plane
    C_Z: FloatArray  # C_Z', the total moment out of plane
    planted_in_plane: FloatArray  # what the planted mechanisms add to C_N'
    planted_out_of_plane: FloatArray  # what they add to C_Z'
    planted: tuple[str, ...]  # their names
    parameters: Mapping[str, float]
    """Every number of the configuration by its dotted path, errors and asymmetries as they were drawn."""

    def __repr__(self) -> str:
        return f"<Truth: {', '.join(self.planted) or 'nothing'} planted, {self.time.size} samples>"

    @property
    def planted_share(self) -> tuple[float, float]:
        """Rms of what is planted in and out of plane, each over the rms of the whole moment vector."""
        whole = float(np.sqrt(np.mean(self.C_N**2 + self.C_Z**2)))
        return rms(self.planted_in_plane) / whole, rms(self.planted_out_of_plane) / whole

    def tree(self) -> dict[str, Any]:
        """The content of the group `truth` of format 1."""
        return {
            "planted": "+".join(self.planted) or "none",
            "alpha": Quantity(self.alpha, "rad"),
            "windward_meridian": Quantity(self.windward_meridian, "rad"),
            "C_N_prime": self.C_N,
            "C_Z_prime": self.C_Z,
            "planted_C_N_prime": self.planted_in_plane,
            "planted_C_Z_prime": self.planted_out_of_plane,
            "C_m": self.C_m,
            "C_n": self.C_n,
            # In HDF5 a slash would open a group, and names of terms may hold one.
            "parameters": {
                name.replace("/", " per "): Quantity(np.asarray(value), "as in the configuration")
                for name, value in self.parameters.items()
            },
        }


@dataclass(frozen=True, eq=False, repr=False)
class SimulatedFlight(Histories):
    """`record` as recorded, with gaps (NaN) and spikes; `flight` as an analysis loads it; `truth` apart."""

    record: Record
    truth: Truth
    config: SimulationConfig
    seed: int

    def headline(self) -> str:
        """What was flown, with which seed, and what is planted."""
        return f"{self.config.title}, seed {self.seed}: {', '.join(self.truth.planted) or 'nothing'} planted"

    def columns(self) -> Mapping[str, Any]:
        """The channels of the flight (SI) with the true angles (rad) beside them."""
        true = {"true_alpha": self.truth.alpha, "true_windward_meridian": self.truth.windward_meridian}
        known = {name: np.interp(self.flight.time, self.truth.time, values) for name, values in true.items()}
        return {**self.flight.columns(), **known}

    def units(self) -> Mapping[str, str]:
        """SI units of the columns."""
        return {**self.flight.units(), "true_alpha": "rad", "true_windward_meridian": "rad"}

    @cached_property
    def flight(self) -> Flight:
        """The flight as `load_flight` gives it: despiked, gaps bridged or cut, channels derived."""
        return assemble(self.record)

    def save(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write the record as format 1 with the group `truth`; raises UsageError where the file exists."""
        configuration = yaml.safe_dump(self.config.model_dump(mode="json"), sort_keys=False)
        truth = {**self.truth.tree(), "seed": self.seed, "configuration": configuration}
        save_flight(self.record, path, truth=truth, overwrite=overwrite)


@takes_settings(
    SimulationConfig,
    config="SimulationConfig, mapping, str or Path\n    Or the name of a configuration that comes along.",
    seed="int\n    Of every random draw, 0 or more (`--seed`).",
    plant="str or sequence of str\n    Sets of the configuration's `plantable` block (`--plant`).",
)
def simulate(
    config: ConfigSource,
    *,
    seed: int,
    plant: str | Sequence[str] = (),
    progress: Progress | None = None,
    **settings: Unpack[SimulationSettings],
) -> SimulatedFlight:
    """One 6-DOF flight with planted mechanisms and instrument errors.

    Returns
    -------
    SimulatedFlight
        The record, SI, and apart from it the truth.

    Examples
    --------
    >>> import brv_hypo
    >>> brv_hypo.simulate("research_cone", seed=4, plant=["lag"], duration=1.0)
    <SimulatedFlight: research cone, seed 4: lag planted>
    """
    if seed < 0:
        raise UsageError(f"got the seed {seed}, expected one that is not below zero")
    chosen = drawn(load_config(config, plant=plant, keywords=settings), seed)
    equations = replace(system(chosen), wind_profile=wind_profile(chosen))
    trajectory = flown(equations, report_to(progress))
    time = trajectory.nodes[trajectory.samples]
    states, rates = (each[trajectory.samples, :, 0].T for each in (trajectory.states, trajectory.rates))
    air = equations.air_data(time, states)
    sensed = sensed_channels(states, air, rates[RATES], chosen.vehicle.accelerometer_position)
    truth = _truth(equations, time, states, air, rates[RATES])
    return SimulatedFlight(recorded(time, sensed, chosen, seed), truth, chosen, seed)


def flown(equations: Equations, report: Report = silent) -> Trajectory:
    """The trajectory of a flight; refuses what has no sense as one."""
    state, instant = initial_state(equations), np.array([equations.config.start.time])
    motion = equations.motion(instant, state, equations.air_data(instant, state))
    for item in equations.planted:
        item.check_terms(replace(motion, history=lambda tau: replace(motion, time=instant - tau)))
    with np.errstate(over="ignore", invalid="ignore"):
        trajectory = integrate(equations, state, report)
    slow = np.all(np.abs(trajectory.states[:, RATES]) <= FASTEST_TURNING, axis=(1, 2))
    lost = ~(slow & np.all(np.isfinite(trajectory.states), axis=(1, 2)))
    if np.any(lost):
        raise UnanswerableError(
            f"the simulated motion diverges before {trajectory.nodes[np.argmax(lost)]:.3f} s. Likely cause: "
            "an unstable vehicle, a mechanism planted too strongly or too long, or too long a step. Remedy: "
            "check the sign of C_malpha (< 0 is stable), plant less, or reduce `step`."
        )
    _, altitude = equations.gravity_and_altitude(trajectory.states[:, :3, 0].T)
    if np.any(altitude < 0.0) or np.any(altitude > HIGHEST_ALTITUDE):
        raise UnanswerableError(
            f"the simulated flight spans {np.min(altitude):.0f} to {np.max(altitude):.0f} m, expected 0 to "
            f"{HIGHEST_ALTITUDE:.0f} m, where the atmosphere is known. Remedy: another start altitude or "
            "flight-path angle, or a shorter duration."
        )
    return trajectory


def _truth(equations: Equations, time: FloatArray, state: FloatArray, air: AirData, angular: FloatArray) -> Truth:
    """What was flown; what is planted is the moment less that without it."""
    config = equations.config
    bare = replace(equations, planted=planted(config, config.asymmetries))
    motion = bare.motion(time, state, air)
    without = bare.plane_moments(motion)
    _, pitch, yaw = equations.body_moments(state, angular, air)
    plane = motion.to_plane(pitch + 1j * yaw)
    return Truth(
        time=time,
        alpha=motion.alpha,
        windward_meridian=np.unwrap(motion.windward_meridian),
        C_m=pitch,
        C_n=yaw,
        C_N=plane.real,
        C_Z=plane.imag,
        planted_in_plane=plane.real - without[0],
        planted_out_of_plane=plane.imag - without[1],
        planted=tuple(dict.fromkeys(item.mechanism for item in config.mechanisms)),
        parameters=numbers(config),
    )
