"""Whether an effect keeps its name when its step is repeated with other blocks, knots, inertia and dynamic pressure.

The step's regression is linear in what is changed, so that nothing is reconstructed anew: an inertia or a dynamic
pressure that is off by its tolerance moves the middle of its prior.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from brv_hypo.constants import (
    LOOP_REPEATED_BLOCKS,
    LOOP_REPEATED_KNOTS,
    LOOP_RIVALS,
    LOOP_SHARED,
    REPEATED_ERRORS,
)
from brv_hypo.model.term import default_knots
from brv_hypo.regression.channels import split
from brv_hypo.regression.fit import HypothesisFit, fit_hypothesis
from brv_hypo.regression.problem import Problem
from brv_hypo.residuals.candidates import Candidate, fitted_again, try_mechanism
from brv_hypo.residuals.candidates_at_step import Look
from brv_hypo.residuals.choice import comes_first, is_schedule, told_once
from brv_hypo.residuals.config import TraceConfig


def named_in(
    here: Look, ranked: Sequence[Candidate], name: str, config: TraceConfig, scheduled: bool = True
) -> float:
    """Share of the repetitions in which the effect of that name is the best of all, among `ranked` (best first).

    `scheduled` says that the model has a schedule by Mach number: where it has none, one comes first.
    """
    own = next(candidate for candidate in ranked if candidate.name == name)
    rivals = [candidate for candidate in ranked if candidate is not own and candidate.gain > 0.0][:LOOP_RIVALS]
    again = [_best_name(problem, [own, *rivals], scheduled) == name for problem in _repetitions(here, config)]
    return float(np.mean(again))


def _repetitions(here: Look, config: TraceConfig) -> Iterator[Problem]:
    problem, seen = here.problem, here.seen
    for share in LOOP_REPEATED_BLOCKS:
        fitted, _ = split(seen.frame, seen.whole.seen, round(share * config.blocks))
        yield problem.on(fitted)
    start, stop = float(seen.frame.time.min()), float(seen.frame.time.max())
    for more in LOOP_REPEATED_KNOTS:
        yield replace(problem, knots=default_knots(start, stop, max(config.knot_count + more, 1)))
    nuisances = problem.rows.nuisances
    for effect in REPEATED_ERRORS:
        for side in (-1.0, 1.0):
            items = tuple(
                replace(item, present=item.present + side) if item.name == effect else item
                for item in nuisances.items
            )
            if items != nuisances.items:
                yield replace(problem, rows=replace(problem.rows, nuisances=replace(nuisances, items=items)))


def _best_name(problem: Problem, candidates: Sequence[Candidate], scheduled: bool) -> str:
    null = fit_hypothesis(problem, "none", ())
    gains = {
        each.name: null.information - _criterion(problem, null, each) + (each.ahead or 0.0) for each in candidates
    }
    most = max(gains.values())
    schedules = [each.name for each in candidates if is_schedule(each) and comes_first(gains[each.name], most)]
    offered = gains if scheduled or not schedules else schedules
    best = max((each for each in candidates if each.name in offered), key=lambda each: gains[each.name])
    once = [each for each in candidates if told_once(each, best) and gains[each.name] >= LOOP_SHARED * gains[best.name]]
    best = max(once, key=lambda each: gains[each.name], default=best)
    return best.name if gains[best.name] > 0.0 else "none"


def _criterion(problem: Problem, null: HypothesisFit, candidate: Candidate) -> float:
    """The least extended BIC of the effect: with its columns as they were found, or chosen anew on the grid."""
    found = [fitted_again(problem, null, candidate)]
    if candidate.kind == "mechanism":
        anew = try_mechanism(problem, null, candidate.fit.mechanisms[0])
        found += [anew] if anew is not None else []
    return min(each.fit.information for each in found)
