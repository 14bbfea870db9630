"""`compare`: from flight records to ranked mechanisms; `brv_hypo/comparison/__init__.py` says how a name comes about.

Beside it: the seven criteria of Section 3.3.2 of the report, for every hypothesis on the same rows.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from scipy.linalg import qr
from threadpoolctl import threadpool_limits

from brv_hypo.arrays import FloatArray
from brv_hypo.comparison import diagnostics, judgement
from brv_hypo.comparison import verdict as rules
from brv_hypo.comparison.config import CompareConfig, CompareSettings
from brv_hypo.comparison.intervals import out_of_bounds
from brv_hypo.comparison.judgement import Hypotheses, Judged, Say
from brv_hypo.comparison.limits import acting_beside, limits
from brv_hypo.comparison.preparation import filter_warnings, sharing_warnings, short_warnings
from brv_hypo.comparison.result import Comparison, MechanismLimit, Seconds, Verdict, beyond_text
from brv_hypo.comparison.summary import flight_summary, motion_summary, record_summary, refused, summarise
from brv_hypo.comparison.with_processes import FURTHER_SQUARES, beside_leader, squares_of
from brv_hypo.errors import MechanismError, UsageError
from brv_hypo.flight import FlightSource, flights_of
from brv_hypo.flight.derived import averaged
from brv_hypo.flight.record import Flight
from brv_hypo.identification import Identification, identify
from brv_hypo.inference.fit import HypothesisFit, Regressed, likeliest
from brv_hypo.inference.held_out import held_out
from brv_hypo.inference.problem import Problem
from brv_hypo.io.text import hypothesis, meant
from brv_hypo.linearisation.linear import lengths
from brv_hypo.mechanisms.checked import checked, without_faulty
from brv_hypo.mechanisms.contract import Mechanism, Process
from brv_hypo.mechanisms.registry import compared, installed, nuisances, parse_hypothesis, requested, stated_processes
from brv_hypo.model.common_time import at
from brv_hypo.model.reconstruction import reconstruct
from brv_hypo.model.term import delays_among, theta_grid
from brv_hypo.motion import ReconstructionConfig, try_record
from brv_hypo.motion.reconstruction import Reconstruction
from brv_hypo.progress import Progress, report_to, stages
from brv_hypo.settings import settings_of, takes_settings
from brv_hypo.subset.criteria import Criteria, Reference, evaluate, least_squares
from brv_hypo.thresholds import BOUND_COSTS, CREDIBLE_PROBABILITY, NORMAL_95

# Held by `tests.studies.identification.study`: how many converge, and how many intervals hold the truth.
LIKELIHOOD_STEPS = 8  # from a good regression 5 or 6 are enough, the record effects among its parameters, or none are
LIKELIHOOD_HYPOTHESES = 2  # the leader and its closest rival: a verdict compares no more
LATER_STAGES = {"linearising": 0.6, "predicting held-out": 0.75, "maximum likelihood": 0.8}
"""Fraction of a comparison that is done before each."""


@takes_settings(CompareConfig)
def compare(
    flights: FlightSource | Sequence[FlightSource],
    config: CompareConfig | Mapping[str, Any] | str | Path | None = None,
    *,
    progress: Progress | None = None,
    **settings: Unpack[CompareSettings],
) -> Comparison:
    """Rank competing mechanisms on one or several flights of a vehicle.

    A record that contradicts itself is not compared unless `accept_record` is set: the verdict says why.

    Returns
    -------
    Comparison
        The hypotheses by rank, and the verdict.

    Examples
    --------
    >>> import brv_hypo
    >>> flown = brv_hypo.simulate("research_cone", seed=1, plant=["sticking"])
    >>> result = brv_hypo.compare(flown, mechanisms=["sticking"], maximum_likelihood="none")
    >>> result.verdict.winner
    'sticking'
    """
    config = settings_of(CompareConfig, config, settings)
    wanted = _hypotheses(config)  # an unknown name is refused whatever the record is like
    fits = {f"fitting {hypothesis(name)}": 0.1 + 0.5 * k / len(wanted) for k, name in enumerate(wanted)}
    report = report_to(progress)
    say = stages(report, {"reconstructing": 0.02, **fits, **LATER_STAGES})
    say("checking the record")
    trials = [try_record(flight) for flight in flights_of(flights)]
    record = record_summary([trial for _, trial in trials])
    tried = [flight for flight, _ in trials]
    if not (record.sound or config.accept_record):
        return refused(tried, [trial for _, trial in trials], config.method)
    analysed = [averaged(flight) for flight in tried]
    check_delays(wanted, config.options, max(float(np.ptp(flight.time)) for flight in analysed))
    names = {mechanism.name for mechanisms in wanted.values() for mechanism in mechanisms}

    def compared_without(faulty: frozenset[str]) -> Comparison:
        with requested({*names, *(config.mechanisms or ())}, faulty, config.options):
            answered = {name: own for name, own in wanted.items() if faulty.isdisjoint(each.name for each in own)}
            return _compare(analysed, config, answered, say)

    with threadpool_limits(limits=1, user_api="blas"):  # the matrices are small: threads only cost
        found, reasons = without_faulty(compared_without)
    if not record.sound:
        reason = f"{found.verdict.reason} But the record contradicts itself: what it seems to say may be that."
        found = found.model_copy(update={"verdict": found.verdict.model_copy(update={"reason": reason})})
    about_record = {
        "record": record,
        "settings": config.model_dump(mode="json", exclude_defaults=True),
        "flights": tuple(flight_summary(*each) for each in zip(tried, analysed, strict=True)),
        "warnings": (*found.warnings, *reasons, *filter_warnings(tried)),
    }
    report(1.0, "compared")
    return found.model_copy(update=about_record)


def _compare(flights: Sequence[Flight], config: CompareConfig, hypotheses: Hypotheses, say: Say) -> Comparison:
    """The comparison of these hypotheses: motion, search, evidences, verdict, likelihoods, and the verdict's checks."""
    begun = clock.perf_counter()
    say("reconstructing the motion")
    reconstructions = [reconstruct(flight, ReconstructionConfig(method=config.method)) for flight in flights]
    reconstructed = clock.perf_counter()
    answered, warnings = answerable(reconstructions, hypotheses)
    warnings = (*warnings, *sharing_warnings(reconstructions), *short_warnings(reconstructions))
    found = judgement.searched(reconstructions, config, answered, say)
    beside = found.judged()
    verdict = _verdict(beside, answered, config.other_prior)
    if verdict.winner is None and (other := found.about_another(beside)) is not None:
        beside, verdict = other, _verdict(other, answered, config.other_prior)
    problem, fits = beside.problem, beside.fits
    criteria = criteria_of(problem, fits)
    say("predicting held-out blocks")
    errors = held_out(fits, beside.evidences, config.held_out_blocks)
    leading, second = fits[beside.leader], _second(beside, answered)
    selected = clock.perf_counter()
    alone = identify_credible(problem, fits, verdict, config, say)
    pairs = {pair.fit.name: pair for pair in beside.pairs}
    wider = diagnostics.with_errors_of_processes
    likelihoods = {name: own and wider(own, *pairs[name]) for name, own in alone.items()}
    ended = clock.perf_counter()
    seconds = Seconds(
        reconstruct=reconstructed - begun, select=selected - reconstructed, ml=ended - selected, total=ended - begun
    )
    comparison = summarise(problem, fits, errors, criteria, seconds, likelihoods, verdict)
    motions, moved = diagnostics.motions_beside(problem.frame.reconstructions, reconstructions)
    known = {"reconstruction": motion_summary(motions, moved), **diagnostics.of_leader(beside, comparison, motions)}
    verdict = rules.after_checks(
        verdict,
        prediction_ratio=float(errors[beside.leader] / errors[beside.null]),
        stated_processes=stated_processes(),
        second=second,
        record_errors=known["record_errors"],
        converged=all(each.converged for each in reconstructions),
    )
    if len(flights) > 1 and verdict.outcome != "named":
        verdict = verdict.model_copy(update={"reason": f"{verdict.reason} {rules.ALONE}"})
    known["verdict"] = verdict
    if beyond := beyond_text(known["record_errors"], leading.name, verdict.outcome):
        warnings = (*warnings, beyond)
    elif instead := diagnostics.far_beside_small(beside, verdict.processes):
        warnings = (*warnings, instead)
    if np.isfinite(beside.of_static):
        slopes = zip(flights, known["functions"]["C_malpha"], strict=True)
        warnings = (*warnings, *dict.fromkeys(each for own in slopes for each in diagnostics.caveats_of(*own)))
    known["best_by_size"] = diagnostics.best_by_size(problem, fits, criteria[beside.null])
    events = (
        *diagnostics.events_unreached(comparison),
        *diagnostics.events_apart(beside),
        *diagnostics.delays_at_bounds(leading),
    )
    return comparison.model_copy(update={**known, "warnings": (*events, *warnings)})


def _verdict(beside: Judged, hypotheses: Hypotheses, other_prior: float) -> Verdict:
    """The verdict on hypotheses beside processes, with limits where anything is adequate."""
    null, weight, listed = beside.baseline, beside.weight, list[rules.Contender]()
    for fit, own in beside.pairs:
        fewer = [each for each in beside.fits if len(each.mechanisms) < len(fit.mechanisms)]
        if fit.mechanisms and (
            not fit.selected or any(judgement.acting_in(each) == judgement.acting_in(fit) for each in fewer)
        ):
            continue  # nothing is known of it, or the same mechanisms act as in one of the others
        # A value that no body has counts where without it most of the log evidence that the fit gains is lost.
        excess, gain = out_of_bounds(fit), weight * (own.level - null.level)
        possible = excess is None or 0.5 * excess.sigmas**2 <= BOUND_COSTS * max(gain, 0.0)
        impossible = None if possible or excess is None else excess.words
        listed.append(rules.Contender(fit.name, -0.5 * fit.information, weight * own.held_out, impossible))
    instead = [
        rules.Contender(pair.fit.name, judgement.weighed(pair, null, per), per * pair.evidence.held_out, words=words)
        for words, pair in judgement.outside(beside, hypotheses)
        for per in (beside.weight_of(pair),)
    ]
    leader, share = beside.leading.fit, judgement.explained(beside)
    processes = judgement.processes(beside.leading.evidence)
    squares = share.share * beside.squares * beside.rows.noise_ratio**2
    found = limits(leader, beside.leading.evidence, hypotheses, weight)
    # Of the residual, or of the moment: slow moments make more of the rates, and the baseline may take them up.
    of_processes = math.hypot(*(each.share_of_moment for each in processes if each.is_of_moment))
    of_leader = [each for each in found if each.mechanism == leader.name]
    more = share.share > share.processes and share.interval_95[0] > 0.0
    more |= any(each.share_of_moment > max(of_processes, NORMAL_95 * each.share_std_error) for each in of_leader)
    how = rules.Misfit(beside.misfit, beside.rows.size, squares, more, beside.regions)
    verdict = rules.judge(listed, instead, how, share, processes, other_prior)
    if verdict.outcome == "none adequate":
        found = tuple(MechanismLimit(mechanism=each.mechanism) for each in found)
    return verdict.model_copy(update={"limits": found})


def _second(beside: Judged, hypotheses: Hypotheses) -> tuple[str, str]:
    """The mechanism that acts beside the leader, and about when; empty unless their sum raises the evidence."""
    pair, null = beside.leading, beside.baseline
    second = acting_beside(*pair, hypotheses, beside.weight)
    if second is None or second.gain < rules.SECOND_ACTS:
        return "", ""
    both = beside_leader(beside.problem, pair, second.mechanism)
    weight = beside.weight * judgement.share_of(both) / judgement.share_of(pair)
    if judgement.weighed(both, null, weight) <= judgement.weighed(pair, null, weight):
        return "", ""
    parts = [[k for k, c in enumerate(both.fit.selected) if c.mechanism == each.name] for each in both.fit.mechanisms]
    if np.min(squares_of(both, parts)) < FURTHER_SQUARES:
        return "", ""
    return second.mechanism.name, " to ".join(at(beside.problem.frame.common, end) for end in second.shape.region)


def identify_credible(
    problem: Problem, fits: Sequence[HypothesisFit], verdict: Verdict, config: CompareConfig, say: Say
) -> dict[str, Identification | None]:
    """Maximum likelihood, by name, of the leader and its closest rival in the credible set; others are out of reach.
    "quick" leaves out (None) what is on records with limits or not adequate, where it takes several seconds, and does
    not begin anew from the data alone where the regression's fit leads nowhere.
    """
    if config.maximum_likelihood == "none":
        return {}
    chances, adequate = verdict.probability, verdict.outcome != "none adequate"
    fits = [fit for fit in fits if fit.name in chances]
    leader = likeliest(fits)
    credible = [fit for fit in fits if fit is leader or chances[fit.name] >= CREDIBLE_PROBABILITY]
    credible.sort(key=lambda fit: (fit is not leader, -chances[fit.name]))
    quick = config.maximum_likelihood == "quick"
    options: Any = {"max_iterations": LIKELIHOOD_STEPS, "begin_anew": not quick}
    found: dict[str, Identification | None] = {}
    for fit in credible[:LIKELIHOOD_HYPOTHESES]:
        if quick and (not adequate or any(each.status == "degraded" for each in fit.frame.reconstructions)):
            found[fit.name] = None
            continue
        say(f"maximum likelihood of {hypothesis(fit.name)}")
        regressed = Regressed.of(problem, fit)
        found[fit.name] = identify(fit.frame, fit.columns, fit.values, regressed=regressed, **options)
    return found


def answerable(reconstructions: Sequence[Reconstruction], hypotheses: Hypotheses) -> tuple[Hypotheses, tuple[str, ...]]:
    """The hypotheses whose terms exist on these flights and are not zero, and why the others are left out."""
    kept: dict[str, tuple[Mechanism, ...]] = {}
    warnings, motions = [], [reconstruction.motion for reconstruction in reconstructions]
    for name, mechanisms in hypotheses.items():
        try:
            for mechanism in mechanisms:
                shown = [checked(mechanism).terms(m, dict(theta)) for m in motions for theta in theta_grid(mechanism)]
                if not any(np.any(each.in_plane) or np.any(each.out_of_plane) for terms in shown for each in terms):
                    raise MechanismError(f"{mechanism.name} is zero throughout the record", mechanism.name)
            kept[name] = mechanisms
        except MechanismError as error:
            warnings.append(f"{name} is left out: {error}")
    return kept, tuple(warnings)


def _hypotheses(config: CompareConfig) -> Hypotheses:
    """By name, without nuisance effects and processes, which all have; UsageError where nothing else is named."""
    items = {name: entry.item for name, entry in installed().items()}
    beside = {name for name, item in items.items() if isinstance(item, Process) or getattr(item, "carried", False)}
    names = [name for name in config.mechanisms or () if name not in beside]
    if config.mechanisms and not names:
        raise UsageError(
            f"nothing to compare: every hypothesis has {', '.join(config.mechanisms)} beside its mechanism. Name "
            f"mechanisms too, as in lag,sticking,{config.mechanisms[0]}; none is the baseline only."
        )
    ordered = dict.fromkeys(["none", *sorted(compared(names))])  # what is worked out goes by what was before
    parsed = {name: parse_hypothesis(name, config.options) for name in ordered}
    # By the mechanisms' own names, also of those that are given as files.
    found = {"+".join(each.name for each in own) or name: own for name, own in parsed.items()}
    own = dict.fromkeys(mechanism.name for mechanisms in found.values() for mechanism in mechanisms)
    with requested(config.mechanisms or (), options=config.options):
        known = {*own, *(each.name for each in nuisances())}
    for name in config.options.keys() - known:
        hint = meant(name, known, f"compared: {', '.join(own)}.")
        raise UsageError(f"the settings have options of '{name}', which is not compared; {hint}")
    return found


def check_delays(hypotheses: Hypotheses, options: Mapping[str, Any], duration: float) -> None:
    """Raise UsageError for a delay, of a mechanism with options, that no record of this duration, s, can show."""
    found = {mechanism.name: mechanism for own in hypotheses.values() for mechanism in own}
    for name in found.keys() & options.keys():
        for each in delays_among(found[name].parameters()):
            if (longest := max(each.grid) * each.seconds) >= duration:
                got = f"got a {each.name} of {longest:.4g} s, expected less than the record, {duration:.4g} s"
                raise UsageError(f"bad options for '{name}': {got}. Leave out delays that are longer.")


# ---- The report's criteria ----


def criteria_of(problem: Problem, fits: Sequence[HypothesisFit]) -> tuple[Criteria, ...]:
    """Criteria of each fit; the complete model of C_p holds the terms of all hypotheses together."""
    designs = [problem.design(fit.frame, fit.columns) for fit in fits]
    size = len(problem.baseline)
    complete = _independent(np.column_stack([designs[0][:, :size], *(design[:, size:] for design in designs)]))
    null = least_squares(_independent(designs[0][:, :size]), problem.response)
    reference = Reference(rss_forced=null.rss, n_forced=size, complete=least_squares(complete, problem.response))
    return tuple(evaluate(least_squares(_independent(d), problem.response), reference) for d in designs)


def _independent(design: FloatArray) -> FloatArray:
    """The columns without those that depend on the ones before, by pivoted QR."""
    triangle, order = qr(design / lengths(design), mode="r", pivoting=True)
    diagonal = np.abs(np.diag(triangle))
    kept = np.sort(order[: diagonal.size][diagonal > 1e-9 * diagonal[0]])
    return np.asarray(design[:, kept], dtype=float)
