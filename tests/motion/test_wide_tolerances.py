"""What the reconstruction makes of flights of the independent program whose tolerances are wide."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from brv_hypo import reconstruct
from brv_hypo.motion.reconstruction import Reconstruction
from tests.studies.independent.flights import Made, make_flight

pytestmark = pytest.mark.thorough


@cache
def flown(truth: str, factor: float) -> tuple[Made, Reconstruction]:
    made = make_flight("biconic", truth, 0.7, seed=35004, grade="industrial", factor=factor)
    return made, reconstruct(made.flight)


def test_instruments_are_late_against_the_gyros() -> None:
    """All of them late by the same time are a motion that much later, which nothing shows: no unknown."""
    _, found = flown("none", 0.0)
    assert {e.component for e in found.effects if e.effect == "time_skew"} == {"accelerometers", "air data"}


@pytest.mark.parametrize("factor", [0.0, 1.0])
def test_a_large_mechanism_is_not_mistaken_for_errors_of_the_record(factor: float) -> None:
    made, found = flown("lag", factor)
    squares = sum((each.value / each.size) ** 2 for each in found.effects)
    assert squares < 3.0 * len(found.effects)
    assert np.sqrt(np.mean((found.motion.alpha - made.true.alpha) ** 2)) < np.radians(0.2)


def test_a_scale_of_the_pressure_is_the_slope_of_the_normal_force() -> None:
    _, found = flown("lag", 1.0)
    scale = next(each for each in found.effects if each.effect == "dynamic_pressure_scale")
    assert scale.std_error == pytest.approx(scale.size, rel=0.02)
