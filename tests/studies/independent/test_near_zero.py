"""Alpha near zero is an ordinary point of the analysis."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo import compare
from brv_hypo.comparison import CompareConfig
from tests.studies.independent.mechanisms import LISTED
from tests.studies.independent.near_zero import make_through_zero


@pytest.mark.slow
@pytest.mark.parametrize("listed", [("damping", "bodyfixed"), LISTED])
@pytest.mark.parametrize("truth", ["damping", "none"])
@pytest.mark.parametrize("vehicle", ["cone", "slender"])
def test_through_zero(vehicle: str, truth: str, listed: tuple[str, ...]) -> None:
    """Strong damping is named, and nothing is where nothing is: there none may be as large as the moment."""
    made = make_through_zero(vehicle, truth, seed=48000)
    assert np.degrees(made.true.alpha.min()) < 0.02
    assert np.abs(made.true.meridian_rate).max() > 300.0
    verdict = compare(made.flight, CompareConfig(mechanisms=listed, maximum_likelihood="none")).verdict
    assert verdict.winner == truth
    assert truth != "none" or max(limit.share_of_moment_95 for limit in verdict.limits) < 1.0
