"""What a candidate leaves for another effect: where two act at once, a third may explain more than either alone.

Candidates that lead are judged by what they explain together with the best effect beside them, on the fitted part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from brv_hypo.constants import CONFOUNDED_NEAR, TWO_STEP, TWO_STEP_RIVAL
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.regression.fit import HypothesisFit, fit_hypothesis
from brv_hypo.regression.problem import Problem
from brv_hypo.residuals.candidates import Candidate, bounded, try_mechanism


def looked_ahead(
    problem: Problem, found: Sequence[Candidate], mechanisms: Sequence[Mechanism]
) -> list[Candidate]:
    """The candidates, the leading ones with what the best further effect gains, where one has anything to gain.

    A leader that leaves nothing needs no comparison.
    """
    leaders = [candidate for candidate in found if candidate.kind == "mechanism" and candidate.gain > CONFOUNDED_NEAR]
    leaders = sorted(leaders, key=lambda candidate: -candidate.gain)[:TWO_STEP]
    if not leaders or (first := _beside(problem, leaders[0], mechanisms)) <= 0.0:
        return list(found)
    ahead = {leaders[0].name: first}
    for rival in leaders[1:]:
        if rival.gain >= TWO_STEP_RIVAL * leaders[0].gain:
            ahead[rival.name] = _beside(problem, rival, mechanisms)
    return [replace(candidate, ahead=ahead.get(candidate.name)) for candidate in found]


def looked_ahead_like(
    problem: Problem, described: Candidate, found: Sequence[Candidate], mechanisms: Sequence[Mechanism]
) -> Candidate:
    """A description in generic terms, with what the best effect beside it gains where that is known of its rivals.

    One that takes up a little of two effects at once would explain more than the name of either.
    """
    rivals = [candidate for candidate in found if candidate.ahead is not None]
    if not any(described.gain > TWO_STEP_RIVAL * rival.gain for rival in rivals):
        return described
    return replace(described, ahead=_beside(problem, described, mechanisms))


def _beside(problem: Problem, candidate: Candidate, mechanisms: Sequence[Mechanism]) -> float:
    """Fall of the extended BIC by the best other mechanism beside the candidate; 0 where none gains."""
    beside = replace(problem, baseline=candidate.fit.columns, frame=candidate.fit.frame)
    null = fit_hypothesis(beside, "none", ())
    others = [mechanism for mechanism in mechanisms if mechanism.name != candidate.name]
    return max((0.0, *(_gain(beside, null, mechanism) for mechanism in others)))


def _gain(problem: Problem, null: HypothesisFit, mechanism: Mechanism) -> float:
    if mechanism.time_variation != ("constant",) and len(problem.records) == 1:
        fit = bounded(problem, fit_hypothesis(problem, mechanism.name, (mechanism,)))
        return null.information - fit.information
    found = try_mechanism(problem, null, mechanism)
    return found.gain if found is not None else 0.0
