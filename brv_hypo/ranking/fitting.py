"""Every hypothesis fitted in one problem, which is linear about the leader.

Hypotheses that stop in different minima lend each other the knots and delays that they found (`exchanged`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from brv_hypo.constants import SEARCH_HOPELESS, SEARCH_OUT_OF_REACH
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.regression.fit import (
    HypothesisFit,
    fit_hypothesis,
    fit_on_grid,
    likeliest,
    plainer,
    renewed,
    scanned,
    scanned_finely,
)
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.search import on_grid
from brv_hypo.regression.uncertainty import with_design

# ---- Every hypothesis fitted in one problem, which is linear about the leader ----


Progress = Callable[[str], None]
Hypotheses = Mapping[str, tuple[Mechanism, ...]]


def linearised(problem: Problem, fits: Sequence[HypothesisFit]) -> list[HypothesisFit]:
    """The fits in a problem linearised about the leader: knots and delays come from where they lie.

    Those that stay out of reach keep theirs. Two of the leader's knots that came to one place become one.
    """
    at = [replace(fit, frame=problem.frame.with_mechanisms(fit.mechanisms)) for fit in fits]
    there = [renewed(problem, fit, ()) for fit in at]
    first = likeliest(there)
    moved = [
        scanned_finely(problem, renewed(problem, fit)) if _in_reach(stays, first) else stays
        for fit, stays in zip(at, there, strict=True)
    ]
    leader = likeliest(moved)
    fits = [plainer(problem, fit) if fit is leader and fit.mechanisms else fit for fit in moved]
    return [with_design(problem, fit) for fit in fits]


def searched(
    problem: Problem, hypotheses: Hypotheses, say: Progress, hopeless: float = SEARCH_HOPELESS
) -> list[HypothesisFit]:
    """Every hypothesis searched; the likeliest on the grid first, so that those so far behind can end early."""
    say("searching on the grid of knots and delays")
    grids = {name: on_grid(problem, mechanisms) for name, mechanisms in hypotheses.items() if mechanisms}
    first = sorted(
        (fit_on_grid(problem, *each, grids.get(each[0])) for each in hypotheses.items()),
        key=lambda fit: fit.information,
    )
    problem = _with_efficiency(problem, renewed(problem, likeliest(first)))
    fits: list[HypothesisFit] = []
    for each in first:
        say(f"fitting {each.name}")
        rival = min((fit.information for fit in fits), default=math.inf)
        fit = _without_hope(problem, each, rival + hopeless)
        fits.append(fit or fit_hypothesis(problem, each.name, each.mechanisms, rival, grids.get(each.name)))
    return fits


def _without_hope(problem: Problem, rough: HypothesisFit, most: float) -> HypothesisFit | None:
    """The rough fit, its knots and delays scanned, where even that leaves it beyond `most`; None elsewhere."""
    if not rough.mechanisms or rough.information <= most:
        return None
    fit = scanned(problem, rough)
    return replace(fit, ended_early=True) if fit.information > most else None


def _in_reach(fit: HypothesisFit, leader: HypothesisFit) -> bool:
    """Whether a fit may still come near the leader."""
    return fit.information <= leader.information + SEARCH_OUT_OF_REACH


def _with_efficiency(problem: Problem, leader: HypothesisFit) -> Problem:
    """The problem with the effective share of samples that the leader's residual shows."""
    return problem.at_efficiency(problem.efficiency_of(leader.residual))
