"""Planted mechanisms: the installed definitions, evaluated at the running state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.mechanisms import find
from brv_hypo.mechanisms.contract import Mechanism, MomentProcess
from brv_hypo.model.term import TimeBasis, delays_among, summed
from brv_hypo.motion.motion import Motion
from brv_hypo.simulation.config import PlantedConfig, SimulationConfig, per_flight


@dataclass(frozen=True)
class Planted:
    """One mechanism in all flights of a batch: theta and coefficients (flights,), or one number."""

    mechanism: Mechanism
    theta: Mapping[str, float]
    coefficients: Mapping[str, FloatArray]
    time_basis: TimeBasis

    def contribution(self, motion: Motion) -> tuple[FloatArray, FloatArray]:
        """C_N' and C_Z' that the mechanism adds, on the motion's shape."""
        time_basis = self.time_basis(motion.time)
        terms = [term for term in self.mechanism.terms(motion, self.theta) if term.name in self.coefficients]
        weights = [self.coefficients[term.name] * time_basis for term in terms]
        return (
            summed((term.in_plane for term in terms), weights, motion.alpha),
            summed((term.out_of_plane for term in terms), weights, motion.alpha),
        )

    def edges(self) -> FloatArray:
        """Times (s) at which the time basis has a jump or a kink."""
        found = np.concatenate([np.ravel(self.time_basis.start), np.ravel(self.time_basis.stop)])
        return np.asarray(found[np.isfinite(found)], dtype=float)

    def delays(self) -> FloatArray:
        """The delays (s) among theta, every flight's."""
        late_by = delays_among(self.mechanism.parameters())
        found = [np.ravel(self.theta[parameter.name]) * parameter.seconds for parameter in late_by]
        return np.unique(np.concatenate([np.zeros(0), *found]))


def planted(configs: Sequence[SimulationConfig], place: Literal["mechanisms", "asymmetries"]) -> tuple[Planted, ...]:
    """The mechanisms, or the vehicle's asymmetries, of a batch: all its configurations have the same, in one order."""
    return tuple(_planted(configs, place, index) for index in range(len(getattr(configs[0], place))))


def check_terms(items: Sequence[Planted], motion: Motion) -> None:
    """Raise UsageError for a coefficient of a term that its mechanism does not have."""
    for item in items:
        known = [term.name for term in item.mechanism.terms(motion, item.theta)]
        unknown = [name for name in item.coefficients if name not in known]
        if unknown:
            raise UsageError(
                f"mechanism '{item.mechanism.name}' has no term '{unknown[0]}'; its terms are "
                f"{', '.join(known)}. Correct the key under `terms`."
            )


def _planted(configs: Sequence[SimulationConfig], place: str, index: int) -> Planted:
    entry: PlantedConfig = getattr(configs[0], place)[index]
    mechanism = find(entry.mechanism, entry.options)
    if isinstance(mechanism, MomentProcess):  # its splines lie over the flight
        start = configs[0].start.time
        span = {"start": start, "stop": start + configs[0].duration}
        mechanism = find(entry.mechanism, {**span, **entry.options})
    _check_theta(mechanism, entry)

    def column(*path: str, missing: float = np.nan) -> Any:
        values = per_flight(configs, place, index, *path, missing=missing)
        # One number where flights agree: mechanisms are written for scalar theta.
        return float(values[0]) if np.all(values == values[0]) else values

    return Planted(
        mechanism,
        {name: column("theta", name) for name in entry.theta},
        {name: column("terms", name) for name in entry.terms},
        TimeBasis(entry.kind, column("start", missing=-np.inf), column("stop", missing=np.inf)),
    )


def _check_theta(mechanism: Mechanism, entry: PlantedConfig) -> None:
    expected = {parameter.name for parameter in mechanism.parameters()}
    if expected != set(entry.theta):
        raise UsageError(
            f"planted mechanism '{mechanism.name}': got theta {sorted(entry.theta)}, expected "
            f"{sorted(expected)}. Give each parameter of the mechanism one value under `theta`."
        )
    if entry.kind == "ramp" and entry.start is None:
        raise UsageError(f"planted mechanism '{mechanism.name}': a ramp needs a `start` (s) to rise from.")
