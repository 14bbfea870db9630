"""Reconstruction with the errors that the record's tolerances allow."""

from __future__ import annotations

from brv_hypo.flight import FlightSource, one_flight
from brv_hypo.mechanisms.carried import perturbations
from brv_hypo.motion import Reconstruction, ReconstructionConfig
from brv_hypo.motion import reconstruct as reconstruct_with


def reconstruct(
    flight: FlightSource, config: ReconstructionConfig | None = None, like: Reconstruction | None = None
) -> Reconstruction:
    """Wind-relative motion and moments, with standard deviations, of a path, a `Flight` or a simulated flight.

    Instruments, vehicle and air are taken as known to the record's tolerances (`flight.instruments`) and no
    better. `like` is what the same options made of nearly the same record, where that is known. Raises
    UnanswerableError where the record is too short, or the vehicle is not in the air.
    """
    record = one_flight(flight)
    return reconstruct_with(record, config, perturbations(record), like)
