"""Eliminates the states of one segment from a Gauss-Newton step, at a cost linear in the samples.

Two ways to the same answer: the band (`band`), which any motion and process noise may have, for rows that reach
their neighbours only; and condensation (`condensation`) for exact dynamics that look far back, where the band
would be as wide as a delay, and for long segments, of which it keeps far less.
"""

from __future__ import annotations

from brv_hypo.likelihood.band import band_size, eliminate_by_band
from brv_hypo.likelihood.condensation import condense
from brv_hypo.likelihood.quadratic import Eliminated, Quadratic
from brv_hypo.likelihood.recursion import LENGTH

_FAR = 3
"""Samples that exact dynamics look back from which condensation is cheaper than the band."""
_LONG = 2 * LENGTH
"""Samples from which a segment without delays is condensed."""
_LARGEST_BAND = 1 << 27
"""Numbers that a band may hold (1 GB) where condensation finds no way."""


def eliminate(problem: Quadratic) -> Eliminated | None:
    """The states as affine functions of the parameter step; None where the outputs leave one undetermined."""
    n = problem.defect.shape[0]
    reach = max(-problem.defect_by_state.span(n)[0], *map(abs, problem.by_state.span(n)))
    if problem.exact and (reach > _FAR or n > _LONG):
        condensed = condense(problem)
        if condensed is not None or band_size(problem) > _LARGEST_BAND:
            return condensed
    return eliminate_by_band(problem)
