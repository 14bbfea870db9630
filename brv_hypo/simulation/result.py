"""A simulated flight: what the instruments say, and what is true."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from brv_hypo.arrays import FloatArray
from brv_hypo.flight.format import Quantity, assemble, save_flight
from brv_hypo.flight.record import Flight, Record
from brv_hypo.results import Histories
from brv_hypo.simulation.config import SimulationConfig


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
        record = self.record
        channels: dict[str, Any] = dict(record.channels)
        raw = Flight(
            time=record.time,
            **channels,
            vehicle=record.vehicle.vehicle(),
            instruments=record.instruments,
            planet=record.planet,
            title=record.title,
            source=record.source,
        )
        configuration = yaml.safe_dump(self.config.model_dump(mode="json"), sort_keys=False)
        truth = {**self.truth.tree(), "seed": self.seed, "configuration": configuration}
        save_flight(raw, path, truth=truth, overwrite=overwrite)
