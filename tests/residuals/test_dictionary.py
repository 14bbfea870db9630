"""Generic terms have names of their own, however near they are to each other."""

from __future__ import annotations

import numpy as np

from brv_hypo.mechanisms.conformance import sample_motion
from brv_hypo.residuals.dictionary import entries


def test_moments_that_turn_at_nearly_the_same_rate_have_names_of_their_own() -> None:
    turning = next(e for e in entries([sample_motion(np.linspace(0.0, 6.0, 600))]) if e.terms[0].turn is not None)
    assert turning.at is not None
    names = [term.name for rate in (-14.171, -14.174, -14.1741) for term in turning.at(rate).terms]
    assert len(set(names)) == len(names)
