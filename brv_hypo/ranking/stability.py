"""How often the same hypothesis leads when a part of the record is left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from brv_hypo.regression.fit import HypothesisFit
from brv_hypo.regression.held_out import FitsWithout


def stability(
    fits: Sequence[HypothesisFit], without: Sequence[FitsWithout], blocks: Sequence[int]
) -> float:
    """Share of repetitions, each without one of `blocks` blocks, that have the same leader as the whole record.

    `without` are the fits of the same columns without blocks, one for each of `fits`.

    Coefficients and nuisances are fitted anew; knots and delays stay. The whole record's leader is that of the same
    likelihood, in which rows may be left out (`Problem.untied`).
    """
    whole = {fit.name: _of_rest(fit, each.nothing) for fit, each in zip(fits, without, strict=True)}
    leader = min(whole, key=lambda name: whole[name])
    same, count = 0, 0
    for number in blocks:
        for repetition in zip(*(each.each(number) for each in without), strict=True):
            criteria = {
                fit.name: _of_rest(fit, each.rest) for fit, each in zip(fits, repetition, strict=True)
            }
            same += min(criteria, key=lambda name: criteria[name]) == leader
            count += 1
    return same / max(count, 1)


def _of_rest(fit: HypothesisFit, rss: float) -> float:
    """The criterion of a fit with this residual sum of squares."""
    return replace(fit, residual=np.array([np.sqrt(rss)])).information
