"""`compare`: from flight records to ranked mechanisms.

Beside it: the seven criteria of Section 3.3.2 of the report, for every hypothesis on the same rows; and the model
confidence set, the hypotheses that held-out blocks cannot tell from the best. It rests on prediction alone and needs
no prior: a hypothesis outside it predicts worse than another by more than blocks differ among themselves.
"""

from __future__ import annotations

import time as clock
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import qr
from threadpoolctl import threadpool_limits

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.constants import (
    BOUND_SIGMAS,
    CONFIDENCE_BLOCKS,
    CONFIDENCE_DRAWS,
    CONFIDENCE_SEED,
    CONFIDENCE_SIZE,
    CONFIDENCE_TIE,
    REPETITIONS,
)
from brv_hypo.errors import MechanismError
from brv_hypo.flight import FlightSource, flights_of
from brv_hypo.flight.derived import averaged
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.checked import checked_terms, without_faulty
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect
from brv_hypo.mechanisms.registry import installed, parse_hypothesis, requested
from brv_hypo.mechanisms.registry import mechanisms as installed_mechanisms
from brv_hypo.model.reconstruction import reconstruct
from brv_hypo.model.term import theta_grid
from brv_hypo.motion import ReconstructionConfig, try_record
from brv_hypo.motion.reconstruction import Reconstruction
from brv_hypo.ranking.adequacy import alternatives
from brv_hypo.ranking.config import CompareConfig
from brv_hypo.ranking.fitting import Fitted, Hypotheses, Progress, searched
from brv_hypo.ranking.histories import coefficient_series, size_series
from brv_hypo.ranking.intervals import out_of_bounds
from brv_hypo.ranking.limits import limits
from brv_hypo.ranking.maximum_likelihood import identify_standing, tolerance_warnings
from brv_hypo.ranking.preparation import sharing_warnings
from brv_hypo.ranking.result import Comparison, Seconds, Verdict
from brv_hypo.ranking.stability import repetitions, stability
from brv_hypo.ranking.summary import flight_summary, record_summary, refused, summarise
from brv_hypo.ranking.verdict import Contest, Score, judge
from brv_hypo.regression.fit import HypothesisFit
from brv_hypo.regression.held_out import FitsWithout, HeldOut, LeavingOut, block_of_whitened_row, held_out
from brv_hypo.regression.linear import lengths
from brv_hypo.regression.problem import Problem
from brv_hypo.settings import settings_of
from brv_hypo.subset.criteria import Criteria, Reference, evaluate, least_squares

# ---- The hypotheses that held-out blocks cannot tell from the best: a model confidence set ----


def confidence_p_values(losses: FloatArray) -> FloatArray:
    """p-value of each hypothesis (hypotheses,), of `losses` (blocks, hypotheses): the least size of test that drops it.

    Range statistic, blocks drawn with replacement (Hansen, Lunde and Nason, Econometrica 79, 2011, 453-497). Blocks are
    far longer than the noise is correlated, and may come in any order. Hypotheses of equal losses have one p-value.
    """
    apart = np.max(np.abs(losses[:, :, np.newaxis] - losses[:, np.newaxis, :]), axis=0)
    distinct, which = np.unique(np.argmax(apart < CONFIDENCE_TIE, axis=1), return_inverse=True)
    ordered = losses[np.ix_(np.lexsort(losses.T), distinct)]
    count, rng = len(ordered), np.random.default_rng(CONFIDENCE_SEED)
    # A stationary bootstrap also draws where blocks end, here after one: with it these are the draws of `arch`'s MCS.
    drawn = np.array([(rng.integers(count, size=count), rng.random(count))[0] for _ in range(CONFIDENCE_DRAWS)])
    means, drawn_means = ordered.mean(axis=0), ordered[drawn].mean(axis=1)
    observed = means[:, np.newaxis] - means
    chance = drawn_means[:, :, np.newaxis] - drawn_means[:, np.newaxis, :] - observed
    spread = np.sqrt(np.mean(chance**2, axis=0) + np.eye(distinct.size))  # the diagonal is 0 / 1
    statistics, by_chance = observed / spread, chance / spread
    p_value, p_values, kept = 0.0, np.ones(distinct.size), list(range(distinct.size))
    while len(kept) > 1:
        worse = statistics[np.ix_(kept, kept)].max(axis=1)
        largest = by_chance[:, kept][:, :, kept].max(axis=(1, 2))
        p_value = max(p_value, float(np.mean(worse.max() < largest)))
        p_values[kept.pop(int(worse.argmax()))] = p_value
    return p_values[which]


def confidence_set(names: Sequence[str], p_values: FloatArray) -> tuple[str, ...]:
    """Those that are not dropped, likeliest of the best first."""
    order = np.argsort(-p_values, kind="stable")
    return tuple(names[k] for k in order if p_values[k] > CONFIDENCE_SIZE)


# ---- The seven criteria of Section 3.3.2 of the report, for every hypothesis on the same rows ----


def criteria_of(problem: Problem, fits: Sequence[HypothesisFit], block_count: int) -> tuple[Criteria, ...]:
    """Criteria of each fit; the complete model of C_p holds the terms of all hypotheses together."""
    designs = [problem.design(fit.frame, fit.columns) for fit in fits]
    size = len(problem.baseline)
    complete = _independent(np.column_stack([designs[0][:, :size], *(design[:, size:] for design in designs)]))
    null = least_squares(_independent(designs[0][:, :size]), problem.response)
    reference = Reference(
        rss_forced=null.rss,
        n_forced=size,
        complete=least_squares(complete, problem.response),
        blocks=_blocks(problem, block_count),
    )
    return tuple(evaluate(least_squares(_independent(d), problem.response), reference) for d in designs)


def _independent(design: FloatArray) -> FloatArray:
    """The columns without those that depend on the ones before, by pivoted QR."""
    triangle, order = qr(design / lengths(design), mode="r", pivoting=True)
    diagonal = np.abs(np.diag(triangle))
    kept = np.sort(order[: diagonal.size][diagonal > 1e-9 * diagonal[0]])
    return np.asarray(design[:, kept], dtype=float)


def _blocks(problem: Problem, count: int) -> IntArray:
    """Block of each whitened row (rows,); rows of the priors belong to the last one."""
    block = block_of_whitened_row(problem, count)
    return np.where(block < 0, block.max(), block)


# ---- `compare`: from flight records to ranked mechanisms ----


def compare(
    flights: FlightSource | Sequence[FlightSource],
    config: CompareConfig | Mapping[str, Any] | str | Path | None = None,
    *,
    progress: Progress | None = None,
) -> Comparison:
    """Rank competing mechanisms on one or several flights of a vehicle: paths, `Flight`s or simulated flights.

    `config`: settings, a mapping of them, or the YAML file that holds them.
    A record that contradicts itself is not compared unless `config.accept_record`: the verdict says why. Raises
    UsageError for an unknown mechanism and UnanswerableError where the data cannot answer.
    """
    config, say = settings_of(CompareConfig, config), progress or (lambda message: None)
    _hypotheses(config)  # an unknown name is refused whatever the record is like
    say("checking the record")
    trials = [try_record(flight) for flight in flights_of(flights)]
    record = record_summary([trial for _, trial in trials])
    tried = [flight for flight, _ in trials]
    if not (record.sound or config.accept_record):
        return refused(tried, [trial for _, trial in trials], config.method)
    analysed = [averaged(flight) for flight in tried]
    with threadpool_limits(limits=1, user_api="blas"):  # the matrices are small: threads only cost
        found, reasons = without_faulty(partial(_compare_without, analysed, config, say))
    about_record = {
        "record": record,
        "flights": tuple(flight_summary(*each) for each in zip(tried, analysed, strict=True)),
        "warnings": (*found.warnings, *reasons),
    }
    return found.model_copy(update=about_record)


def _compare_without(
    flights: Sequence[Flight], config: CompareConfig, say: Progress, faulty: frozenset[str]
) -> Comparison:
    """The comparison with those nuisances of other distributions that it names."""
    compared = {mechanism.name for mechanisms in _hypotheses(config).values() for mechanism in mechanisms}
    with requested({*compared, *(config.mechanisms or ())}, faulty):
        return _compare(flights, config, say, faulty)


def _compare(flights: Sequence[Flight], config: CompareConfig, say: Progress, faulty: frozenset[str]) -> Comparison:
    """The comparison without the mechanisms and effects that broke their contract."""
    hypotheses = {
        name: mechanisms
        for name, mechanisms in _hypotheses(config).items()
        if faulty.isdisjoint(mechanism.name for mechanism in mechanisms)
    }
    begun = clock.perf_counter()
    say("reconstructing the motion")
    reconstructions = [reconstruct(flight, ReconstructionConfig(method=config.method)) for flight in flights]
    reconstructed = clock.perf_counter()
    answered, warnings = answerable(reconstructions, hypotheses)
    warnings = (*warnings, *sharing_warnings(reconstructions))
    say("linearising the errors of the record")
    fitted = searched(reconstructions, config, answered, say)
    problem, fits = fitted.problem, fitted.fits
    criteria = criteria_of(problem, fits, config.held_out_blocks)
    say("predicting held-out blocks")
    leaving = LeavingOut(problem)
    without = [leaving.of(fit.frame, fit.columns) for fit in fits]
    errors = [held_out(problem, each, config.held_out_blocks) for each in without]
    say("judging")
    verdict = _judged(fitted, answered, errors, leaving, without, config.other_prior)
    selected = clock.perf_counter()
    likelihoods = identify_standing(problem, fits, verdict.outcome != "none adequate", config, say)
    finished = clock.perf_counter()
    seconds = Seconds(
        reconstruct=reconstructed - begun,
        select=selected - reconstructed,
        ml=finished - selected,
        total=finished - begun,
    )
    warnings = (*warnings, *tolerance_warnings(fitted, verdict))
    comparison = summarise(problem, fits, errors, criteria, seconds, likelihoods, verdict, warnings)
    histories = {"coefficients": coefficient_series(fits, likelihoods.found), "sizes": size_series(problem, fits)}
    return comparison.model_copy(update=histories)


def _judged(
    fitted: Fitted,
    hypotheses: Hypotheses,
    errors: Sequence[HeldOut],
    leaving: LeavingOut,
    without: Sequence[FitsWithout],
    other_prior: float,
) -> Verdict:
    """The verdict on fits with their held-out errors; what may be there instead takes part in the repetitions."""
    problem, fits = fitted.problem, fitted.fits
    scores = [
        Score(fit.name, fit.information, error.mean_square, tuple(error.by_block), _impossible(fit))
        for fit, error in zip(fits, errors, strict=True)
    ]
    instead = alternatives(problem, hypotheses, fits)
    contest = Contest(scores, fitted.left, instead, other_prior)
    listed = {fit.name for fit in fits}
    further = [each.fit for each in instead if each.fit.name not in listed]
    without = [*without, *(leaving.of(fit.frame, fit.columns) for fit in further)]
    repeated = stability(contest, repetitions(problem, [*fits, *further], without, REPETITIONS))
    verdict = judge(contest, repeated, limits(problem, hypotheses, fits))
    return verdict.model_copy(update=_confidence(fits, without[: len(fits)]))


def _confidence(fits: Sequence[HypothesisFit], without: Sequence[FitsWithout]) -> dict[str, Any]:
    """The model confidence set of the verdict, and its p-values."""
    names = [fit.name for fit in fits]
    losses = [[each.score for each in fitted.each(CONFIDENCE_BLOCKS)] for fitted in without]
    p_values = confidence_p_values(np.transpose(losses))
    return {
        "confidence_set": confidence_set(names, p_values),
        "confidence_p_values": dict(zip(names, p_values.tolist(), strict=True)),
    }


def _impossible(fit: HypothesisFit) -> str | None:
    """The value that no body has, in words, where it lies beyond its error."""
    excess = out_of_bounds(fit)
    return None if excess is None or excess.sigmas <= BOUND_SIGMAS else excess.words


def answerable(reconstructions: Sequence[Reconstruction], hypotheses: Hypotheses) -> tuple[Hypotheses, tuple[str, ...]]:
    """The hypotheses whose terms exist on these flights, and why the others are left out."""
    kept: dict[str, tuple[Mechanism, ...]] = {}
    warnings = []
    for name, mechanisms in hypotheses.items():
        try:
            for mechanism in mechanisms:
                for reconstruction in reconstructions:
                    for theta in theta_grid(mechanism):
                        checked_terms(mechanism, reconstruction.motion, dict(theta))
            kept[name] = mechanisms
        except MechanismError as error:
            warnings.append(f"{name} is left out: {error}")
    return kept, tuple(warnings)


def _hypotheses(config: CompareConfig) -> Hypotheses:
    """By name; that of a nuisance effect asks for it in every hypothesis, and makes none of its own."""
    known = {name: entry.item for name, entry in installed().items() if isinstance(entry.item, RecordEffect)}
    names = [name for name in config.mechanisms or () if not (name in known and known[name].carried)]
    names = names or [mechanism.name for mechanism in installed_mechanisms()]
    return {name: parse_hypothesis(name, config.options) for name in dict.fromkeys(["none", *names])}
