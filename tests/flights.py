"""Simulated flights that many tests share: each is flown once, and changed by nobody."""

from __future__ import annotations

from functools import cache

from brv_hypo.simulation import SimulatedFlight, simulate


@cache
def flown(vehicle: str, *plant: str) -> SimulatedFlight:
    """The vehicle's own flight, with `plant` of what it can be planted with."""
    return simulate(vehicle, seed=1, plant=plant)


def nominal() -> SimulatedFlight:
    """The research cone with nothing planted: for what holds on any flight."""
    return flown("research_cone")
