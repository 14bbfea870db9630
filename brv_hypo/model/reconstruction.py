"""Reconstruction with the errors that the record's tolerances allow."""

from __future__ import annotations

from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.carried import perturbations
from brv_hypo.motion import Reconstruction, ReconstructionConfig
from brv_hypo.motion import reconstruct as reconstruct_with


def reconstruct(flight: Flight, config: ReconstructionConfig | None = None) -> Reconstruction:
    """Wind-relative motion and moments of `flight`, with standard deviations.

    Instruments, vehicle and air are taken as known to the record's tolerances (`flight.instruments`) and no
    better. Raises UnanswerableError where the record is too short, or the vehicle is not in the air.
    """
    return reconstruct_with(flight, config, perturbations(flight))
