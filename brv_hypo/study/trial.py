"""One flight of a study: simulated, compared, noted."""

from __future__ import annotations

import time as clock
from typing import Any

from brv_hypo.errors import BrvHypoError
from brv_hypo.flight.assemble import assemble
from brv_hypo.ranking import Comparison, compare
from brv_hypo.simulation import SimulatedFlight, simulate
from brv_hypo.study.config import StudyConfig
from brv_hypo.study.draws import Draw, flight_config, spoilt
from brv_hypo.study.effect import effect_size
from brv_hypo.study.outcome import Outcome
from brv_hypo.study.parameters import estimates
from brv_hypo.study.planted_faults import fault_called


def fly(study: StudyConfig, draw: Draw) -> Outcome:
    """Simulate the flight and compare on it; what goes wrong is the outcome's reason."""
    begun = clock.perf_counter()
    try:
        flown = simulate(flight_config(study, draw), seed=draw.seed)
    except Exception as error:
        return Outcome(draw=draw, status="not simulated", reason=_reason(error))
    in_plane, out_of_plane = effect_size(flown.truth)
    known: dict[str, Any] = {
        "draw": draw,
        "effect_in_plane": in_plane,
        "effect_out_of_plane": out_of_plane,
    }
    try:
        flight = assemble(spoilt(flown.record, draw)) if draw.fault else flown.flight
        comparison = compare([flight], study.compare)
    except Exception as error:
        return Outcome(**known, status="not compared", reason=_reason(error))
    return Outcome(**known, **_judged(flown, comparison, draw), seconds=clock.perf_counter() - begun)


def _judged(flown: SimulatedFlight, comparison: Comparison, draw: Draw) -> dict[str, Any]:
    verdict, ranking = comparison.verdict, comparison.ranking
    trial = {
        "outcome": verdict.outcome,
        "faults": tuple(f"{fault.channel}: {fault.fault}" for fault in comparison.record.faults),
        "fault_named": _named(draw, comparison),
    }
    if not ranking:
        return {"status": "refused", "reason": verdict.reason, **trial}
    own = next((row for row in ranking if row.mechanism == draw.planted), None)
    return {
        "status": "compared",
        **trial,
        "first": ranking[0].mechanism,
        "winner": verdict.winner,
        "equivalent": verdict.equivalent,
        "probability": verdict.probability,
        "information": {row.mechanism: row.bic for row in ranking},
        "prediction_error": {row.mechanism: row.prediction_error for row in ranking},
        "verdict": verdict.reason,
        "estimates": () if own is None else estimates(flown.config.mechanisms, own),
        "alpha_sigma_rad": comparison.reconstruction.alpha_rms_sigma_rad,
        "phi_w_sigma_rad": comparison.reconstruction.phi_w_rms_sigma_rad,
        "warnings": (*comparison.reconstruction.warnings, *comparison.warnings),
    }


def _named(draw: Draw, comparison: Comparison) -> bool | None:
    """Whether the fault that was planted is named, kind and channels; None for a sound record."""
    if not draw.fault:
        return None
    return fault_called(draw.fault).named_by(comparison.record.faults)


def _reason(error: Exception) -> str:
    """A refusal in its own words; a fault with its kind, for it is the program's."""
    return str(error) if isinstance(error, BrvHypoError) else f"fault, {type(error).__name__}: {error}"
