"""A simulated flight in words and as data."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from brv_hypo.report.style import share
from brv_hypo.simulation import SimulatedFlight


def simulation_text(flown: SimulatedFlight) -> str:
    """What was flown, what was planted, and how much of the moment that is."""
    flight = flown.flight
    inside, outside = flown.truth.planted_share
    planted = ", ".join(flown.truth.planted) or "nothing"
    if flown.truth.planted:
        planted += f" ({share(inside)} of the moment's rms in plane, {share(outside)} out of plane)"
    return (
        f"Simulated '{flight.title}', seed {flown.seed}: {flight.samples} samples at "
        f"{flight.sample_rate:.4g} Hz.\nPlanted: {planted}."
    )


def simulation_data(flown: SimulatedFlight, path: Path) -> dict[str, Any]:
    """The same as data for JSON."""
    inside, outside = flown.truth.planted_share
    return {
        "schema": "brv-hypo/simulate/1",
        "path": str(path),
        "seed": flown.seed,
        "samples": flown.flight.samples,
        "sample_rate_hz": flown.flight.sample_rate,
        "planted": list(flown.truth.planted),
        "planted_share": {"in_plane": inside, "out_of_plane": outside},
    }
