"""`compare`: from flight records to ranked mechanisms."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import replace

from threadpoolctl import threadpool_limits

from brv_hypo.errors import MechanismError
from brv_hypo.flight import FlightSource, flights_of
from brv_hypo.flight.averaging import averaged
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.mechanisms.isolation import checked_terms, without_faulty
from brv_hypo.mechanisms.registry import mechanisms as installed_mechanisms
from brv_hypo.mechanisms.registry import parse_hypothesis
from brv_hypo.model.columns import theta_grid
from brv_hypo.model.reconstruction import reconstruct
from brv_hypo.motion import ReconstructionConfig, try_record
from brv_hypo.motion.reconstruction import Reconstruction
from brv_hypo.ranking.adequacy import Misfit, misfit
from brv_hypo.ranking.alternative import alternatives
from brv_hypo.ranking.config import CompareConfig
from brv_hypo.ranking.constants import (
    BOUND_SIGMAS,
    LINEARISATIONS,
    LINEARISED_AGAIN,
    REPETITIONS,
    SETTLED,
    SETTLED_ERRORS,
    STANDING_PROBABILITY,
)
from brv_hypo.ranking.criteria import criteria_of
from brv_hypo.ranking.histories import coefficient_series
from brv_hypo.ranking.intervals import out_of_bounds, within_bounds
from brv_hypo.ranking.likelihood import identify_standing
from brv_hypo.ranking.limits import limits
from brv_hypo.ranking.preparation import Settings, about, settled
from brv_hypo.ranking.result import Comparison, Seconds, Verdict
from brv_hypo.ranking.sizes import size_series
from brv_hypo.ranking.stability import stability
from brv_hypo.ranking.summary import flight_summary, record_summary, refused, summarise
from brv_hypo.ranking.verdict import OTHER, Score, judge, probabilities
from brv_hypo.regression.build import LinearisationPoint, farthest_apart, point_of
from brv_hypo.regression.fit import (
    HypothesisFit,
    fit_hypothesis,
    likeliest,
    renewed,
    scanned_finely,
    with_errors,
)
from brv_hypo.regression.held_out import FitsWithout, HeldOut, LeavingOut, held_out
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.search import on_grid

Progress = Callable[[str], None]
Hypotheses = dict[str, tuple[Mechanism, ...]]


def compare(
    flights: FlightSource | Sequence[FlightSource],
    config: CompareConfig | None = None,
    *,
    progress: Progress | None = None,
) -> Comparison:
    """Rank competing mechanisms on one or several flights of a vehicle: paths, `Flight`s or simulated flights.

    A record that contradicts itself is not compared unless `config.accept_record`: the verdict says why. Raises
    UsageError for an unknown mechanism and UnanswerableError where the data cannot answer.
    """
    config, say = config or CompareConfig(), progress or (lambda message: None)
    _hypotheses(config)  # an unknown name is refused whatever the record is like
    say("trying the record")
    trials = [try_record(flight) for flight in flights_of(flights)]
    record = record_summary([trial for _, trial in trials])
    tried = [flight for flight, _ in trials]
    if not (record.sound or config.accept_record):
        return refused(tried, record, config.method)
    analysed = [averaged(flight) for flight in tried]
    with threadpool_limits(limits=1, user_api="blas"):  # the matrices are small: threads only cost
        found, reasons = without_faulty(lambda faulty: _compare(analysed, config, say, faulty))
    about_record = {
        "record": record,
        "flights": tuple(flight_summary(*each) for each in zip(tried, analysed, strict=True)),
        "warnings": (*found.warnings, *reasons),
    }
    return found.model_copy(update=about_record)


def _compare(
    flights: Sequence[Flight], config: CompareConfig, say: Progress, faulty: frozenset[str]
) -> Comparison:
    """The comparison without the mechanisms that broke their contract."""
    hypotheses = {
        name: mechanisms
        for name, mechanisms in _hypotheses(config).items()
        if faulty.isdisjoint(mechanism.name for mechanism in mechanisms)
    }
    begun = clock.perf_counter()
    say("reconstructing the motion")
    reconstructions = [reconstruct(flight, ReconstructionConfig(method=config.method)) for flight in flights]
    reconstructed = clock.perf_counter()
    hypotheses, warnings = answerable(reconstructions, hypotheses)
    say("linearising what the record may err by")
    problem, fits, left = _searched(reconstructions, config, hypotheses, say)
    criteria = criteria_of(problem, fits, config.held_out_blocks)
    say("predicting held-out blocks")
    leaving = LeavingOut(problem)
    without = [leaving.of(fit.frame, fit.columns) for fit in fits]
    errors = [held_out(problem, each, config.held_out_blocks) for each in without]
    say("judging")
    verdict = _judged(problem, hypotheses, fits, errors, without, left, config.other_prior)
    selected = clock.perf_counter()
    likelihoods = identify_standing(fits, config, say)
    finished = clock.perf_counter()
    seconds = Seconds(
        reconstruct=reconstructed - begun,
        select=selected - reconstructed,
        ml=finished - selected,
        total=finished - begun,
    )
    comparison = summarise(problem, fits, errors, criteria, seconds, likelihoods, verdict, warnings)
    histories = {"coefficients": coefficient_series(fits, likelihoods.found), "sizes": size_series(problem, fits)}
    return comparison.model_copy(update=histories)


def _searched(
    reconstructions: Sequence[Reconstruction], config: CompareConfig, hypotheses: Hypotheses, say: Progress
) -> tuple[Problem, list[HypothesisFit], Misfit]:
    """The problem linearised where the data say, every hypothesis fitted in it, and what the leader leaves."""
    problem, settings = settled(reconstructions, config)
    fits = _fitted(problem, hypotheses, say)
    moved, before = False, math.inf
    for _ in range(LINEARISATIONS):
        point = _about_leader(problem, fits, before, settings)
        if point is None:
            break
        say(f"linearising about {'+'.join(mechanism.name for mechanism in point.mechanisms) or 'the baseline'}")
        before = likeliest(fits).rss
        del problem  # large, and about to be replaced
        problem = about(point, reconstructions, settings, config)
        settings = replace(settings, taken=point.taken)
        fits, moved = _moved(problem, fits), True
    problem, fits = _with_errors(problem, fits)
    left = _left(problem, fits)
    if moved and _something_stands(fits, left, config.other_prior):
        say("searching again where the problem is linear now")
        anew = {fit.name: fit for fit in _fitted(problem, hypotheses, say)}
        best = [min(fit, anew[fit.name], key=lambda each: each.information) for fit in fits]
        problem, fits = _with_errors(problem, best)
        left = _left(problem, fits)
    return problem, fits, left


def _something_stands(fits: Sequence[HypothesisFit], left: Misfit, other_prior: float) -> bool:
    """Whether something outside the list stands beside the leader: a term that was chosen elsewhere may be amiss."""
    information = {fit.name: fit.information for fit in fits}
    chances = probabilities(information, [likeliest(fits).information - left.gain], other_prior)
    return chances[OTHER] >= STANDING_PROBABILITY


def _left(problem: Problem, fits: Sequence[HypothesisFit]) -> Misfit:
    """What the leader leaves."""
    return misfit(problem, likeliest(fits), next(fit for fit in fits if not fit.mechanisms))


def _judged(
    problem: Problem,
    hypotheses: Hypotheses,
    fits: Sequence[HypothesisFit],
    errors: Sequence[HeldOut],
    without: Sequence[FitsWithout],
    left: Misfit,
    other_prior: float,
) -> Verdict:
    """The verdict on fits with their held-out errors."""
    scores = [
        Score(fit.name, fit.information, error.mean_square, tuple(error.by_block), _impossible(fit))
        for fit, error in zip(fits, errors, strict=True)
    ]
    repeated = stability(fits, without, REPETITIONS)
    instead = alternatives(problem, hypotheses, fits)
    return judge(scores, left, repeated, limits(problem, hypotheses, fits), instead, other_prior)


def _impossible(fit: HypothesisFit) -> str | None:
    """The value that no body has, in words, where it lies beyond its error."""
    excess = out_of_bounds(fit)
    return None if excess is None or excess.sigmas <= BOUND_SIGMAS else excess.words


def _fitted(problem: Problem, hypotheses: Hypotheses, say: Progress) -> list[HypothesisFit]:
    """Every hypothesis searched; the likeliest of a rough search first, so that those without hope can end early."""
    say("searching on the grid of knots and delays")
    rough = replace(problem, refine=False, max_terms=problem.exact_terms)
    grids = {name: on_grid(problem, mechanisms) for name, mechanisms in hypotheses.items() if mechanisms}
    first = sorted(
        (fit_hypothesis(rough, *each, grid=grids.get(each[0])) for each in hypotheses.items()),
        key=lambda fit: fit.information,
    )
    problem = _with_efficiency(problem, renewed(problem, likeliest(first)))
    fits: list[HypothesisFit] = []
    for each in first:
        say(f"fitting {each.name}")
        rival = min((fit.information for fit in fits), default=math.inf)
        fits.append(fit_hypothesis(problem, each.name, each.mechanisms, rival, grids.get(each.name)))
    return fits


def _about_leader(
    problem: Problem, fits: Sequence[HypothesisFit], before: float, settings: Settings
) -> LinearisationPoint | None:
    """The leader's fit, where errors of second order about the last point may show: they would pose as something else.

    What a large moment does to the motion is not small, nor are errors of the record that differ from those about which
    the problem is linear. `before` is what the leader left about the last point but one: None where that has not become
    less.
    """
    leader = likeliest(fits)
    null = next(fit for fit in fits if not fit.mechanisms)
    if leader.rss > before - SETTLED:
        return None
    point = point_of(problem, leader.frame, leader.columns, leader.mechanisms)
    far = farthest_apart(problem, settings.taken, point.taken) >= SETTLED_ERRORS
    return point if far or null.rss - leader.rss > LINEARISED_AGAIN else None


def _moved(problem: Problem, fits: Sequence[HypothesisFit]) -> list[HypothesisFit]:
    """The fits about another point: knots and delays come from where they lie."""
    at = [replace(fit, frame=problem.frame.with_mechanisms(fit.mechanisms)) for fit in fits]
    return [scanned_finely(problem, renewed(problem, fit)) for fit in at]


def _with_errors(
    problem: Problem, fits: Sequence[HypothesisFit]
) -> tuple[Problem, list[HypothesisFit]]:
    """The fits with the uncertainty of their coefficients, and the problem at the sample size that goes with it."""
    leader = likeliest(fits)
    anew = {fit.name: renewed(problem, fit) for fit in fits}
    problem = _with_efficiency(problem, anew[leader.name])
    return problem, [within_bounds(with_errors(problem, fit)) for fit in anew.values()]


def _with_efficiency(problem: Problem, leader: HypothesisFit) -> Problem:
    """The problem with the effective share of samples that the leader's residual shows."""
    return replace(problem, efficiency=problem.efficiency_of(leader.residual))


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
                    for theta in theta_grid(mechanism):
                        checked_terms(mechanism, reconstruction.motion, dict(theta))
            kept[name] = mechanisms
        except MechanismError as error:
            warnings.append(f"{name} is left out: {error}")
    return kept, tuple(warnings)


def _hypotheses(config: CompareConfig) -> Hypotheses:
    names = config.mechanisms or tuple(mechanism.name for mechanism in installed_mechanisms())
    return {name: parse_hypothesis(name, config.options) for name in dict.fromkeys(["none", *names])}
