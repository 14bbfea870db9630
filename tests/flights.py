"""Simulated flights that many tests share: each is flown once, and never changed."""

from __future__ import annotations

from functools import cache

from brv_hypo.simulation import SimulatedFlight, load_config, simulate

SAMPLE_RATE_HZ = 100.0  # half the usual: enough for all but what a finer one is needed to say
STEP_S = 0.01  # of its integration, whose error is below a tenth of the noise
USUAL_RATE_HZ = 200.0


def flown(vehicle: str, *plant: str, sample_rate: float = SAMPLE_RATE_HZ) -> SimulatedFlight:
    """The vehicle's own flight, with `plant` of what it can be planted with."""
    return _flown(vehicle, plant, sample_rate)


@cache
def _flown(vehicle: str, plant: tuple[str, ...], sample_rate: float) -> SimulatedFlight:
    config = load_config(vehicle).model_copy(
        update={"sample_rate": sample_rate, "step": min(STEP_S, 1.0 / sample_rate)}
    )
    return simulate(config, seed=1, plant=plant)


def nominal(sample_rate: float = SAMPLE_RATE_HZ) -> SimulatedFlight:
    """The research cone with nothing planted: for what holds on any flight."""
    return flown("research_cone", sample_rate=sample_rate)
