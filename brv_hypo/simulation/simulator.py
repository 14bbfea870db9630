"""From a configuration to simulated flights: integrate a batch, read the instruments, note the truth.

`SimulatedFlight` holds what the instruments say and, apart from it, what is true. `simulate` and `simulate_batch` are
the entrances.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import ArrayLike

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UnanswerableError, UsageError
from brv_hypo.flight.format import Quantity, assemble, save_flight
from brv_hypo.flight.record import Flight, Record
from brv_hypo.results import Histories
from brv_hypo.simulation.config import ConfigSource, SimulationConfig, load_config, numbers, varied
from brv_hypo.simulation.instruments import Signals, drawn, recorded, true_channels, wind_profile
from brv_hypo.simulation.integration import Progress, Trajectory, break_times, grid, integrate
from brv_hypo.simulation.vehicle import HIGHEST, RATES, AirData, System, check_terms, initial_state, planted, system

# ---- A simulated flight: what the instruments say, and what is true ----


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
        return (
            float(np.sqrt(np.mean(self.planted_in_plane**2))) / whole,
            float(np.sqrt(np.mean(self.planted_out_of_plane**2))) / whole,
        )

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


# ---- From a configuration to simulated flights ----


# A batch is integrated at once up to here; beyond, memory grows for no gain in speed.
LARGEST_BATCH = 250


def simulate(
    config: ConfigSource, *, seed: int, plant: Sequence[str] = (), progress: Progress | None = None
) -> SimulatedFlight:
    """One flight; `plant` names sets of the configuration's `plantable` block.

    `config` is a file, the name of one that comes along, a mapping or a `SimulationConfig`. `progress` is
    called with the fraction done. Raises UsageError for a bad configuration, and UnanswerableError where no
    flight comes of it: the motion diverges, or meets the ground.
    """
    return simulate_batch(config, seeds=(seed,), plant=plant, progress=progress)[0]


def simulate_batch(
    config: ConfigSource,
    *,
    seeds: Sequence[int],
    variations: Mapping[str, ArrayLike] | None = None,
    plant: Sequence[str] = (),
    progress: Progress | None = None,
) -> tuple[SimulatedFlight, ...]:
    """One flight per seed, integrated together: each is, to the order of the integration, what it is alone.

    `variations` maps dotted paths of the configuration to (flights,) values, such as
    'mechanisms.0.terms.eps'; a planted set is appended to `mechanisms`. Raises as `simulate` does.
    """
    if not seeds or min(seeds) < 0:
        raise UsageError(f"got the seeds {list(seeds)[:5]}, expected at least one and none below zero")
    nominal = varied(load_config(config, plant=plant), len(seeds), variations)
    configs = tuple(drawn(one, seed) for one, seed in zip(nominal, seeds, strict=True))
    found: list[SimulatedFlight] = []
    for first in range(0, len(seeds), LARGEST_BATCH):
        part = slice(first, first + LARGEST_BATCH)

        def overall(fraction: float, first: int = first, size: int = len(configs[part])) -> None:
            if progress is not None:
                progress((first + fraction * size) / len(seeds))

        found += _together(configs[part], seeds[part], overall)
    return tuple(found)


def _together(configs: Sequence[SimulationConfig], seeds: Sequence[int], progress: Progress) -> list[SimulatedFlight]:
    equations = replace(system(configs), wind_profile=wind_profile(configs))
    trajectory = flown(configs, equations, progress)
    states = np.moveaxis(trajectory.states, 1, 0)
    time = trajectory.nodes[:, None] * np.ones(len(configs))
    air = equations.air_data(time, states)
    angular = np.moveaxis(trajectory.rates[:, RATES], 1, 0)
    truths = _truths(configs, equations, trajectory, air, angular)
    channels = true_channels(states, air)
    flights = []
    for i, (config, seed, truth) in enumerate(zip(configs, seeds, truths, strict=True)):
        own = {name: values[:, i] for name, values in channels.items()}
        record = recorded(Signals(trajectory.nodes, own, angular[..., i]), config, truth.time, seed)
        flights.append(SimulatedFlight(record=record, truth=truth, config=config, seed=seed))
    return flights


def flown(configs: Sequence[SimulationConfig], equations: System, progress: Progress) -> Trajectory:
    """The trajectory of a batch; refuses what has no sense as a flight."""
    first = configs[0]
    begin = first.start.time
    state = initial_state(configs, equations)
    instant = np.full(len(configs), begin)
    motion = equations.motion(instant, state, equations.air_data(instant, state))
    check_terms(equations.planted, replace(motion, history=lambda tau: replace(motion, time=instant - tau)))
    on = grid(begin, first.step, first.samples, first.steps_per_sample, break_times(equations, begin))
    with np.errstate(over="ignore", invalid="ignore"):
        trajectory = integrate(equations, state, on, progress)
    lost = ~np.all(np.isfinite(trajectory.states), axis=(1, 2))
    if np.any(lost):
        raise UnanswerableError(
            f"the simulated motion diverges before {trajectory.nodes[np.argmax(lost)]:.3f} s. Likely cause: "
            "an unstable vehicle, a mechanism planted too strongly or too long, or too long a step. Remedy: "
            "check the sign of C_malpha (< 0 is stable), plant less, or reduce `step`."
        )
    _, altitude = equations.gravity_and_altitude(np.moveaxis(trajectory.states[:, :3], 1, 0))
    if np.any(altitude < 0.0) or np.any(altitude > HIGHEST):
        raise UnanswerableError(
            f"the simulated flight spans {np.min(altitude):.0f} to {np.max(altitude):.0f} m, expected 0 to "
            f"{HIGHEST:.0f} m, where the atmosphere is known. Remedy: another start altitude or "
            "flight-path angle, or a shorter duration."
        )
    return trajectory


def _truths(
    configs: Sequence[SimulationConfig], equations: System, trajectory: Trajectory, air: AirData, angular: FloatArray
) -> list[Truth]:
    """The truth of every flight at its samples; what is planted is the moment less that without it."""
    chosen = trajectory.samples
    time = trajectory.nodes[chosen]
    here = AirData(**{name: value[..., chosen, :] for name, value in vars(air).items()})
    states = np.moveaxis(trajectory.states[chosen], 1, 0)
    bare = replace(equations, planted=planted(configs, "asymmetries"))
    motion = bare.motion(time[:, None] * np.ones(len(configs)), states, here)
    without = bare.plane_moments(motion)
    body = equations.body_moments(states, angular[:, chosen], here)
    plane = motion.to_plane(body[1] + 1j * body[2])
    meridian = np.unwrap(motion.windward_meridian, axis=0)
    added = (plane.real - without[0], plane.imag - without[1])
    return [
        Truth(
            time=time,
            alpha=motion.alpha[:, i],
            windward_meridian=meridian[:, i],
            C_m=body[1, :, i],
            C_n=body[2, :, i],
            C_N=plane.real[:, i],
            C_Z=plane.imag[:, i],
            planted_in_plane=added[0][:, i],
            planted_out_of_plane=added[1][:, i],
            planted=tuple(dict.fromkeys(item.mechanism for item in config.mechanisms)),
            parameters=numbers(config),
        )
        for i, config in enumerate(configs)
    ]
