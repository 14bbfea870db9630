"""Every hypothesis fitted in one problem, which is linear about the leader.

Hypotheses that stop in different minima lend each other the knots and delays that they found (`exchanged`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from brv_hypo.constants import SEARCH_OUT_OF_REACH
from brv_hypo.io.text import hypothesis
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.regression.fit import HypothesisFit, fit_hypothesis, likeliest, plainer, renewed, scanned_finely
from brv_hypo.regression.problem import Problem
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


def searched(problem: Problem, hypotheses: Hypotheses, say: Progress) -> list[HypothesisFit]:
    """Every hypothesis searched on the grid of knots and delays, and refined."""
    fits: list[HypothesisFit] = []
    for name, mechanisms in hypotheses.items():
        say(f"fitting {hypothesis(name)}")
        rival = min((fit.information for fit in fits), default=math.inf)
        fits.append(fit_hypothesis(problem, name, mechanisms, rival))
    return fits


def _in_reach(fit: HypothesisFit, leader: HypothesisFit) -> bool:
    """Whether a fit may still come near the leader."""
    return fit.information <= leader.information + SEARCH_OUT_OF_REACH


def _with_efficiency(problem: Problem, leader: HypothesisFit) -> Problem:
    """The problem with the effective share of samples that the leader's residual shows."""
    return problem.at_efficiency(problem.efficiency_of(leader.residual))
