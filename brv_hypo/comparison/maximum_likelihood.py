"""After the verdict: maximum likelihood of the credible hypotheses; errors of the record beyond their tolerances."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from brv_hypo.comparison.config import CompareConfig
from brv_hypo.comparison.result import EXCEED, RecordError, Verdict
from brv_hypo.constants import BEYOND_TOLERANCE_NAMED, CREDIBLE_PROBABILITY, LIKELIHOOD_HYPOTHESES, LIKELIHOOD_STEPS
from brv_hypo.identification import Identification, identify
from brv_hypo.inference.fit import HypothesisFit, likeliest
from brv_hypo.inference.problem import Problem
from brv_hypo.inference.uncertainty import Regressed
from brv_hypo.io.text import hypothesis
from brv_hypo.linearisation.nuisance import beyond_tolerance


@dataclass(frozen=True)
class Likelihoods:
    """What the likelihood made of the standing hypotheses, by name, and which it left out to save time."""

    found: Mapping[str, Identification]
    left_out: frozenset[str]


def identify_credible(
    problem: Problem, fits: Sequence[HypothesisFit], verdict: Verdict, config: CompareConfig, say: Callable[[str], None]
) -> Likelihoods:
    """Maximum likelihood for the leader and its closest rival, where one stands; the others are out of reach.

    "quick" leaves out records with limits and fits of which none is `adequate`, where it takes several seconds, and
    does not begin anew from the data alone where the regression's fit leads nowhere.
    """
    if config.maximum_likelihood == "none":
        return Likelihoods({}, frozenset())
    chances, adequate = verdict.probability, verdict.outcome != "none adequate"
    fits = [fit for fit in fits if fit.name in chances]
    credible = [fit for fit in fits if fit is likeliest(fits) or chances[fit.name] >= CREDIBLE_PROBABILITY]
    credible.sort(key=lambda fit: -chances[fit.name])
    quick = config.maximum_likelihood == "quick"
    found: dict[str, Identification] = {}
    left_out: set[str] = set()
    for fit in credible[:LIKELIHOOD_HYPOTHESES]:
        if quick and (not adequate or any(each.status == "degraded" for each in fit.frame.reconstructions)):
            left_out.add(fit.name)
            continue
        say(f"maximum likelihood of {fit.name}")
        regressed = Regressed.of(problem, fit.frame, fit.columns, fit.values, fit.others)
        found[fit.name] = identify(
            fit.frame,
            fit.columns,
            fit.values,
            regressed=regressed,
            max_iterations=LIKELIHOOD_STEPS,
            begin_anew=not quick,
        )
    return Likelihoods(found, frozenset(left_out))


def tolerance_warnings(leader: str, errors: Sequence[RecordError], verdict: Verdict) -> tuple[str, ...]:
    """A sentence on those of the leader; none where it is not adequate, for what it lacks poses as errors."""
    beyond = [beyond_tolerance(each.name, each.value, each.tolerance, each.units) for each in errors]
    found = [text for text in beyond if text is not None]
    if verdict.outcome == "none adequate" or not found:
        return ()
    more = len(found) - BEYOND_TOLERANCE_NAMED
    listed = "; ".join(found[:BEYOND_TOLERANCE_NAMED]) + (f"; and {more} more" if more > 0 else "")
    return (f"with {hypothesis(leader)}, {EXCEED}: {listed} (see --instruments)",)
