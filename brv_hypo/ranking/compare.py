"""`compare`: from flight records to ranked mechanisms."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from brv_hypo.errors import MechanismError, UnanswerableError
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.mechanisms.registry import mechanisms as installed_mechanisms
from brv_hypo.mechanisms.registry import parse_hypothesis
from brv_hypo.model.baseline import PitchDamping, StaticMoment
from brv_hypo.model.columns import default_knots, theta_grid
from brv_hypo.model.reconstruction import reconstruct
from brv_hypo.motion import ReconstructionConfig
from brv_hypo.motion.reconstruction import Reconstruction
from brv_hypo.ranking.config import CompareConfig
from brv_hypo.ranking.criteria import criteria_of
from brv_hypo.ranking.histories import coefficient_series
from brv_hypo.ranking.likelihood import Likelihoods, held_out_by_likelihood, identify_standing
from brv_hypo.ranking.result import Comparison, Seconds
from brv_hypo.ranking.summary import summarise
from brv_hypo.regression.fit import HypothesisFit, fit_hypothesis, refit
from brv_hypo.regression.frame import RateFrame, build_frame, checked_terms
from brv_hypo.regression.held_out import HeldOut, held_out
from brv_hypo.regression.noise import (
    baseline_columns,
    drift_degrees,
    efficiency_of,
    maximal_noise,
    residual_rates,
)
from brv_hypo.regression.problem import Task
from brv_hypo.regression.whitening import fit_noise

Progress = Callable[[str], None]
Hypotheses = dict[str, tuple[Mechanism, ...]]
SMALLEST_RECORD = 60
# How much larger the criterion of a rival may be for it to be searched as often as the leader.
WITHIN_REACH = 100.0


def compare(
    flights: Sequence[Flight], config: CompareConfig | None = None, *, progress: Progress | None = None
) -> Comparison:
    """Rank competing mechanisms on one or several flights of a vehicle.

    Raises UsageError for an unknown mechanism and UnanswerableError where the data cannot answer.
    """
    config = config or CompareConfig()
    with threadpool_limits(limits=1, user_api="blas"):  # the matrices are small: threads only cost
        return _compare(flights, config, progress or (lambda message: None))


def _compare(flights: Sequence[Flight], config: CompareConfig, say: Progress) -> Comparison:
    hypotheses = _hypotheses(config)
    begun = clock.perf_counter()
    say("reconstructing the motion")
    reconstructions = [reconstruct(flight, ReconstructionConfig(method=config.method)) for flight in flights]
    reconstructed = clock.perf_counter()
    hypotheses, warnings = answerable(reconstructions, hypotheses)
    task = prepare(reconstructions, hypotheses, config)
    say("estimating the noise")
    rough = replace(task, refine=False, max_terms=task.exact_terms)
    first = sorted(
        (fit_hypothesis(rough, *each) for each in hypotheses.items()), key=lambda fit: fit.information
    )
    task = settle_noise(task, first)
    likeliest = first[0]
    task = settle_noise(task, [fit_hypothesis(task, likeliest.name, likeliest.mechanisms)])
    fits: list[HypothesisFit] = []
    for each in first:  # the likeliest first, so that searches without hope can end early
        say(f"fitting {each.name}")
        rival = min((fit.information for fit in fits), default=math.inf)
        fits.append(fit_hypothesis(task, each.name, each.mechanisms, rival))
    task, fits = settled(task, fits, likeliest.name)
    criteria = criteria_of(task, fits, config.held_out_blocks)
    selected = clock.perf_counter()
    likelihoods = identify_standing(fits, config, say)
    say("predicting held-out blocks")
    errors = [_held_out(task, fit, likelihoods, config.held_out_blocks) for fit in fits]
    finished = clock.perf_counter()
    seconds = Seconds(
        reconstruct=reconstructed - begun,
        select=selected - reconstructed,
        ml=finished - selected,
        total=finished - begun,
    )
    comparison = summarise(task, fits, errors, criteria, seconds, likelihoods, warnings)
    return comparison.model_copy(update={"coefficients": coefficient_series(fits, likelihoods.found)})


def _held_out(task: Task, fit: HypothesisFit, likelihoods: Likelihoods, blocks: int) -> HeldOut:
    """By the likelihood where it converged, by regression where it did not."""
    found = likelihoods.converged.get(fit.name)
    return held_out(task, fit, blocks) if found is None else held_out_by_likelihood(task, found, blocks)


def answerable(
    reconstructions: Sequence[Reconstruction], hypotheses: Hypotheses
) -> tuple[Hypotheses, tuple[str, ...]]:
    """The hypotheses whose terms exist on these flights, and why the others are left out."""
    kept: Hypotheses = {}
    warnings = []
    for name, mechanisms in hypotheses.items():
        try:
            for mechanism in mechanisms:
                for reconstruction in reconstructions:
                    checked_terms(mechanism, reconstruction.motion, theta_grid(mechanism)[0])
            kept[name] = mechanisms
        except MechanismError as error:
            warnings.append(f"{name} is left out: {error}")
    return kept, tuple(warnings)


def prepare(reconstructions: Sequence[Reconstruction], hypotheses: Hypotheses, config: CompareConfig) -> Task:
    """Everything that the hypotheses share: frame, baseline with its drift, knots and noise model."""
    samples = sum(reconstruction.flight.samples for reconstruction in reconstructions)
    if samples < SMALLEST_RECORD:
        raise UnanswerableError(
            f"the window holds {samples} samples, expected at least {SMALLEST_RECORD}: too few to tell "
            "mechanisms apart. Widen --start and --stop."
        )
    mechanisms = list({m.name: m for group in hypotheses.values() for m in group}.values())
    frame = _frame(reconstructions, config.offset_degree or 1, config.slope_degree or 2)
    noise = maximal_noise(frame, baseline_columns(frame), mechanisms)
    degrees = drift_degrees(frame, noise, config.offset_degree, config.slope_degree)
    frame = _frame(reconstructions, *degrees)
    baseline = baseline_columns(frame)
    noise = maximal_noise(frame, baseline, mechanisms)
    span = frame.time
    knots = (
        default_knots(float(span.min()), float(span.max()), config.knot_count)
        if config.knots is None
        else np.asarray(config.knots, dtype=float)
    )
    return Task(frame, baseline, knots, noise, 1.0, config.max_terms, config.exact_terms, config.refine)


def settled(task: Task, fits: Sequence[HypothesisFit], expected: str) -> tuple[Task, list[HypothesisFit]]:
    """All hypotheses fitted under the noise that the leader leaves.

    Where the leader is not the `expected` one, whose noise the search went by, the two leading mechanisms are searched
    again: a noise model that took up part of a mechanism hides its best knots and delays.
    """
    leader = min(fits, key=lambda fit: fit.information)
    task = settle_noise(task, fits)
    known = [refit(task, fit) for fit in fits]
    if leader.name == expected:
        return task, known
    ordered = sorted((fit.information, fit.name) for fit in known if fit.mechanisms)[:2]
    close = {name for information, name in ordered if information <= ordered[0][0] + WITHIN_REACH}
    found = [
        min(fit, fit_hypothesis(task, fit.name, fit.mechanisms), key=lambda each: each.information)
        if fit.name in close
        else fit
        for fit in known
    ]
    task = settle_noise(task, found)
    return task, [refit(task, fit) for fit in found]


def settle_noise(task: Task, fits: Sequence[HypothesisFit]) -> Task:
    """The task with noise model and effective sample size from what the refined leader leaves."""
    leader = refit(task, min(fits, key=lambda fit: fit.information))
    noise = fit_noise(residual_rates(leader.frame, leader.frame.columns(leader.columns), task.noise))
    task = replace(task, noise=noise)
    leader = refit(task, leader)
    return replace(task, efficiency=efficiency_of(leader.residual, leader.frame))


def _frame(reconstructions: Sequence[Reconstruction], offset_degree: int, slope_degree: int) -> RateFrame:
    times = [rec.flight.time for rec in reconstructions]
    static = StaticMoment(
        start=min(float(t[0]) for t in times),
        stop=max(float(t[-1]) for t in times),
        offset_degree=offset_degree,
        slope_degree=slope_degree,
    )
    return build_frame(reconstructions, [static, PitchDamping()])


def _hypotheses(config: CompareConfig) -> Hypotheses:
    names = config.mechanisms or tuple(mechanism.name for mechanism in installed_mechanisms())
    return {name: parse_hypothesis(name, config.options) for name in dict.fromkeys(["none", *names])}
