"""How often the same hypothesis leads when a part of the record is left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from brv_hypo.regression.fit import HypothesisFit
from brv_hypo.regression.held_out import left_out, nothing_left_out
from brv_hypo.regression.problem import Problem


def stability(problem: Problem, fits: Sequence[HypothesisFit], blocks: Sequence[int]) -> float:
    """Share of repetitions, each without one of `blocks` blocks, that have the same leader as the whole record.

    Coefficients and nuisances are fitted anew; knots and delays stay. The whole record's leader is that of the same
    likelihood, in which rows may be left out (`Problem.untied`).
    """
    leader = min(fits, key=lambda fit: _of_rest(fit, nothing_left_out(problem, fit.frame, fit.columns))).name
    same, count = 0, 0
    for number in blocks:
        rss = [list(left_out(problem, fit.frame, fit.columns, number)) for fit in fits]
        for repetition in zip(*rss, strict=True):
            criteria = {
                fit.name: _of_rest(fit, each.rest) for fit, each in zip(fits, repetition, strict=True)
            }
            same += min(criteria, key=lambda name: criteria[name]) == leader
            count += 1
    return same / max(count, 1)


def _of_rest(fit: HypothesisFit, rss: float) -> float:
    """The criterion of a fit with this residual sum of squares."""
    return replace(fit, residual=np.array([np.sqrt(rss)])).information
