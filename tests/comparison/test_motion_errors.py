"""What a comparison states of its motion: flights of another simulator, with what its model lacks."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.comparison import CompareConfig, compare
from tests.studies.independent.flights import make_flight


@pytest.mark.thorough
@pytest.mark.parametrize(("lacks", "most"), [("side_moment", 0.2), pytest.param(None, 0.02, marks=pytest.mark.slow)])
def test_alpha_is_known_as_well_as_stated(lacks: str | None, most: float) -> None:
    """A side moment moves the motion by 8 times what instruments alone allow; without it little is added to that."""
    made = make_flight("slender", "none", 1.0, 951015, "tactical", imperfect=() if lacks is None else (lacks,))
    series = compare(made.flight, CompareConfig(mechanisms=["lag"], maximum_likelihood="none")).series[0]
    true = np.interp(series.time_s, made.flight.time, made.true.alpha)
    off, stated = (float(np.sqrt(np.mean(np.square(e)))) for e in (series.alpha_rad - true, series.alpha_sigma_rad))
    assert off < 2.0 * stated
    assert np.degrees(stated) < most
