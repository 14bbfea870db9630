"""A simulated flight that many tests share: flown once, and changed by nobody."""

from __future__ import annotations

from functools import cache

from brv_hypo.simulation import SimulatedFlight, simulate


@cache
def nominal() -> SimulatedFlight:
    """The research cone's own flight, with nothing planted: for what holds on any flight."""
    return simulate("research_cone", seed=61)
