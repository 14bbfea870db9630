"""From a configuration to a simulated flight: integrate, read the instruments, note the truth.

`SimulatedFlight` holds what the instruments say and, apart from it, what is true. `simulate` is the entrance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Unpack

import numpy as np
import yaml

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UnanswerableError, UsageError
from brv_hypo.flight.derived import HIGHEST_ALTITUDE
from brv_hypo.flight.format import Quantity, assemble, save_flight
from brv_hypo.flight.record import Flight, Record
from brv_hypo.motion.signals import rms
from brv_hypo.progress import Progress, Report, report_to, silent
from brv_hypo.results import Histories
from brv_hypo.settings import takes_settings
from brv_hypo.simulation.config import ConfigSource, SimulationConfig, SimulationSettings, load_config, numbers
from brv_hypo.simulation.instruments import Signals, drawn, recorded, true_channels, wind_profile
from brv_hypo.simulation.integration import Trajectory, break_times, grid, integrate
from brv_hypo.simulation.vehicle import RATES, AirData, System, initial_state, planted, system


@dataclass(frozen=True)
class Truth:
    """What was flown, at the record's samples (m,)."""

    time: FloatArray
    """s."""
    alpha: FloatArray
    """Total angle of attack, rad."""
    windward_meridian: FloatArray
    """rad, unwrapped."""
    C_m: FloatArray
    """Total pitching moment."""
    C_n: FloatArray
    """Total yawing moment."""
    C_N: FloatArray
    """C_N', the total moment in plane."""
    C_Z: FloatArray
    """C_Z', the total moment out of plane."""
    planted_in_plane: FloatArray
    """What the planted mechanisms add to C_N'."""
    planted_out_of_plane: FloatArray
    """What they add to C_Z'."""
    planted: tuple[str, ...]
    """Their names."""
    parameters: Mapping[str, float]
    """Every number of the configuration by its dotted path, errors and asymmetries as they were drawn."""

    def __repr__(self) -> str:
        """Short: the arrays are long."""
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
            "parameters": {name.replace("/", " per "): value for name, value in self.parameters.items()},
        }


@dataclass(frozen=True)
class SimulatedFlight(Histories):
    """`record` as recorded, with gaps (NaN) and spikes; `flight` as an analysis loads it; `truth` apart."""

    record: Record
    truth: Truth
    config: SimulationConfig
    seed: int

    __repr__ = Histories.__repr__
    __eq__ = Histories.__eq__

    def headline(self) -> str:
        """What was flown, with which seed, and what is planted."""
        return f"{self.config.title}, seed {self.seed}: {', '.join(self.truth.planted) or 'nothing'} planted"

    def columns(self) -> Mapping[str, Any]:
        """The channels of the flight (SI) with the true angles (rad) beside them."""
        true = {"true_alpha": self.truth.alpha, "true_windward_meridian": self.truth.windward_meridian}
        time = self.flight.time
        return {
            **self.flight.columns(),
            **{name: np.interp(time, self.truth.time, values) for name, values in true.items()},
        }

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
    seed="int\n    Of every random draw, 0 or more.",
    plant="sequence of str\n    Sets of the configuration's `plantable` block.",
)
def simulate(
    config: ConfigSource,
    *,
    seed: int,
    plant: Sequence[str] = (),
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
    states, rates = trajectory.states[..., 0].T, trajectory.rates[..., 0].T
    air = equations.air_data(trajectory.nodes, states)
    truth = _truth(equations, trajectory, states, air, rates[RATES])
    signals = Signals(trajectory.nodes, true_channels(states, air), rates[RATES])
    return SimulatedFlight(recorded(signals, chosen, truth.time, seed), truth, chosen, seed)


def flown(equations: System, report: Report = silent) -> Trajectory:
    """The trajectory of a flight; refuses what has no sense as one."""
    config, state = equations.config, initial_state(equations)
    begin = config.start.time
    instant = np.array([begin])
    motion = equations.motion(instant, state, equations.air_data(instant, state))
    for item in equations.planted:
        item.check_terms(replace(motion, history=lambda tau: replace(motion, time=instant - tau)))
    on = grid(begin, config.step, config.samples, config.steps_per_sample, break_times(equations, begin))
    with np.errstate(over="ignore", invalid="ignore"):
        trajectory = integrate(equations, state, on, report)
    lost = ~np.all(np.isfinite(trajectory.states), axis=(1, 2))
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


def _truth(equations: System, trajectory: Trajectory, states: FloatArray, air: AirData, angular: FloatArray) -> Truth:
    """What was flown, at the samples; what is planted is the moment less that without it."""
    config, chosen = equations.config, trajectory.samples
    time, state = trajectory.nodes[chosen], states[:, chosen]
    here = AirData(**{name: value[..., chosen] for name, value in vars(air).items()})
    bare = replace(equations, planted=planted(config, config.asymmetries))
    motion = bare.motion(time, state, here)
    without = bare.plane_moments(motion)
    _, pitch, yaw = equations.body_moments(state, angular[:, chosen], here)
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
