"""`reconstruct` as users call it: `motion.pipeline.reconstruct` with the errors that the tolerances allow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from threadpoolctl import threadpool_limits

from brv_hypo.flight import FlightSource, one_flight
from brv_hypo.io.text import number
from brv_hypo.mechanisms.registry import nuisance_mechanisms, perturbations
from brv_hypo.motion import Reconstruction, ReconstructionConfig
from brv_hypo.motion import reconstruct as reconstruct_with
from brv_hypo.motion.methods import ReconstructionSettings
from brv_hypo.motion.reconstruction import EffectEstimate
from brv_hypo.progress import Progress, report_to
from brv_hypo.settings import settings_of, takes_settings
from brv_hypo.thresholds import FAR_TOLERANCES

_PLACE = "accel_position"


@takes_settings(ReconstructionConfig)
def reconstruct(
    flight: FlightSource,
    config: ReconstructionConfig | Mapping[str, Any] | str | Path | None = None,
    *,
    progress: Progress | None = None,
    **settings: Unpack[ReconstructionSettings],
) -> Reconstruction:
    """Wind-relative motion and moments, with standard deviations.

    Instruments, vehicle and air are taken as known to the record's tolerances (`flight.instruments`) and no better.

    Returns
    -------
    Reconstruction
        Histories (n,) over the record's time; SI, angles in rad.

    Examples
    --------
    >>> import brv_hypo
    >>> flown = brv_hypo.simulate("research_cone", seed=1, duration=1.0)
    >>> brv_hypo.reconstruct(flown, method="rates").method
    'rates'
    """
    chosen, record = settings_of(ReconstructionConfig, config, settings), one_flight(flight)
    if progress is not None:
        report_to(progress)(0.0, "reconstructing the motion")
    with threadpool_limits(limits=1, user_api="blas"):  # the matrices are small: threads only cost
        found = reconstruct_with(record, chosen, perturbations(record))
    # Moments are about the stated c.g. and axes: what turns about others is not the aerodynamics'.
    variance = np.zeros(found.flight.samples)
    for mechanism in nuisance_mechanisms(found.flight):
        sizes = mechanism.tolerance(found.flight) or ()
        for term, size in zip(mechanism.terms(found.motion, {}), sizes, strict=True):
            variance += 0.5 * size**2 * (term.in_plane**2 + term.out_of_plane**2)
    sigma = np.hypot(found.moments.sigma, np.sqrt(variance))
    found = replace(found, moments=replace(found.moments, sigma=sigma))
    if not (misplaced := _misplaced(found, chosen)):
        return found
    return replace(found, status="degraded", warnings=(misplaced, *found.warnings))


def _misplaced(found: Reconstruction, config: ReconstructionConfig) -> str:
    """Where the accelerometers would have to be for the largest error of the record that a motion needs to be less than
    half as large, in a sentence; empty where that is ordinary, or another place makes it no smaller.
    """
    worst = _largest(found.effects)
    if worst is None or abs(worst.value) < FAR_TOLERANCES * worst.size:
        return ""
    flight, reach = found.flight, found.flight.vehicle.reference_length
    free = replace(flight, instruments=replace(flight.instruments, accel_position=(reach, reach, reach)))
    other = reconstruct_with(free, config, perturbations(free))
    place = {each.component: each for each in other.effects if each.effect == _PLACE}
    rest = _largest([each for each in other.effects if each.effect != _PLACE])
    if not place or rest is None or 2.0 * abs(rest.value) * worst.size > abs(worst.value) * rest.size:
        return ""
    stated = flight.vehicle.accelerometer_position
    implied = [at + each.value for at, each in zip(stated, place.values(), strict=True)]
    ends = (", ".join(number(each) for each in ends) for ends in (stated, implied))
    return (
        f"the accelerometers are stated at ({next(ends)}) m from the c.g., where the motion needs {worst.effect} "
        f"{worst.component} at {abs(worst.value / worst.size):.2g} times its tolerance; at ({next(ends)}) m the "
        f"largest error is {abs(rest.value / rest.size):.2g} times: check signs and units of accelerometer_position"
    )


def _largest(effects: Sequence[EffectEstimate]) -> EffectEstimate | None:
    """The error that is most of its tolerance."""
    return max(effects, key=lambda each: abs(each.value / each.size), default=None)
