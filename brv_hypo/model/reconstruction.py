"""`reconstruct` as users call it: `motion.pipeline.reconstruct` with the errors that the tolerances allow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from threadpoolctl import threadpool_limits

from brv_hypo.flight import FlightSource, one_flight
from brv_hypo.mechanisms.registry import nuisance_mechanisms, perturbations
from brv_hypo.motion import Reconstruction, ReconstructionConfig
from brv_hypo.motion import reconstruct as reconstruct_with
from brv_hypo.motion.methods import ReconstructionSettings
from brv_hypo.progress import Progress, report_to
from brv_hypo.settings import settings_of, takes_settings


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
    return replace(found, moments=replace(found.moments, sigma=sigma))
