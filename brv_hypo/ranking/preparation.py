"""From reconstructed flights to the problem that all hypotheses share, linearised where the data say."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.polynomial import Legendre

from brv_hypo.errors import UnanswerableError
from brv_hypo.mechanisms.carried import carried_effects, carried_mechanisms, without
from brv_hypo.model.baseline import PitchDamping, StaticMoment
from brv_hypo.model.columns import default_knots
from brv_hypo.model.reconstruction import reconstruct
from brv_hypo.motion import ReconstructionConfig
from brv_hypo.motion.reconstruction import Reconstruction
from brv_hypo.ranking.config import CompareConfig
from brv_hypo.ranking.constants import MOST_LINEARISATIONS, SETTLED_ERRORS, SLOPE_DEGREE, WAVERING_SPEED
from brv_hypo.regression.build import (
    LinearisationPoint,
    baseline_columns,
    baseline_point,
    build_problem,
    errors_found,
    farthest_off,
)
from brv_hypo.regression.frame import RateFrame, build_frame
from brv_hypo.regression.noise import settled_noise
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.response import linearisation_point

SMALLEST_RECORD = 60  # samples; rule of thumb: four for each of baseline and six terms


def prepare(reconstructions: Sequence[Reconstruction], config: CompareConfig) -> Problem:
    """Everything that the hypotheses share: frame, baseline with its drift, knots, noise, and what is carried.

    What errors of the record do is not small enough to be linear in them from the record as it stands: it is linearised
    again where what the data say of them is taken out, until they say the same.
    """
    samples = sum(reconstruction.flight.samples for reconstruction in reconstructions)
    if samples < SMALLEST_RECORD:
        raise UnanswerableError(
            f"the window holds {samples} samples, expected at least {SMALLEST_RECORD}: too few to tell "
            "mechanisms apart. Widen --start and --stop."
        )
    problem = _problem(reconstructions, config)
    found = errors_found(problem)
    for _ in range(MOST_LINEARISATIONS):
        problem = about(baseline_point(problem, found), reconstructions, config)
        found = errors_found(problem)
        if farthest_off(problem, found) < SETTLED_ERRORS:
            break
    return problem


def about(
    point: LinearisationPoint, reconstructions: Sequence[Reconstruction], config: CompareConfig
) -> Problem:
    """The problem of the records without the errors of a linearisation point, under the noise that they have."""
    cleaned = [
        reconstruct(without(rec.flight, errors), ReconstructionConfig(method=config.method))
        for rec, errors in zip(reconstructions, point.taken, strict=True)
    ]
    problem = _problem(cleaned, config, point)
    return problem.under(settled_noise(problem))


def _problem(
    reconstructions: Sequence[Reconstruction], config: CompareConfig, point: LinearisationPoint | None = None
) -> Problem:
    """The problem of the flights, linearised where what the reconstruction found of their errors is taken out."""
    offset = 1 if config.offset_degree is None else config.offset_degree
    slope = SLOPE_DEGREE if config.slope_degree is None else config.slope_degree
    settings = ReconstructionConfig(method=config.method)
    points = [linearisation_point(reconstruction, settings) for reconstruction in reconstructions]
    records = [record for record, _ in points]
    frame = _frame([point for _, point in points], offset, slope)
    span = frame.time
    knots = (
        default_knots(float(span.min()), float(span.max()), config.knot_count)
        if config.knots is None
        else np.asarray(config.knots, dtype=float)
    )
    return build_problem(
        frame,
        records,
        baseline_columns(frame),
        carried_effects(),
        carried_mechanisms(reconstructions[0].flight),
        knots,
        config.max_terms,
        config.exact_terms,
        config.refine,
        point,
    )


def _frame(reconstructions: Sequence[Reconstruction], offset_degree: int, slope_degree: int) -> RateFrame:
    times = [rec.flight.time for rec in reconstructions]
    static = StaticMoment(
        start=min(float(t[0]) for t in times),
        stop=max(float(t[-1]) for t in times),
        offset_degree=offset_degree,
        slope_degree=slope_degree,
        speeds=_wavering_speeds(reconstructions, slope_degree),
    )
    return build_frame(reconstructions, [static, PitchDamping()])


def _wavering_speeds(reconstructions: Sequence[Reconstruction], degree: int) -> tuple[float, float] | None:
    """The ends of the speeds (m/s), where they change otherwise than a polynomial in time can follow.

    Wind along the track, or drag that goes with the angle of attack: the slope of the moment follows Mach number.
    """
    wavers = False
    for reconstruction in reconstructions:
        time, speed = reconstruction.flight.time, reconstruction.motion.velocity
        left = speed - Legendre.fit(time, speed, degree)(time)
        wavers |= bool(np.std(left) > WAVERING_SPEED * np.mean(speed))
    if not wavers:
        return None
    speeds = np.concatenate([reconstruction.motion.velocity for reconstruction in reconstructions])
    return float(speeds.min()), float(speeds.max())
