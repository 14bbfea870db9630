"""Instruments whose noise is correlated in neighbouring samples, and larger at the motion's frequency than beyond."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo import compare, reconstruct
from brv_hypo.comparison import CompareConfig
from tests.studies.independent.drawn_vehicles import draw_craft
from tests.studies.independent.flights import Made, draw_flight
from tests.studies.independent.instruments import Noise
from tests.studies.independent.mechanisms import LISTED

COLOUR = 0.9  # correlation of neighbouring samples


def flight(seed: int, truth: str) -> Made:
    """A drawn vehicle with industrial instruments."""
    craft = draw_craft(np.random.default_rng([seed, 5]))
    return draw_flight(seed, truth=truth, grade="industrial", noise=Noise(colour=COLOUR), vehicle=craft)


@pytest.mark.parametrize(
    ("seed", "share"),
    [
        pytest.param(232, 0.06, marks=pytest.mark.thorough),
        (204, 0.15),
        *(pytest.param(seed, 0.15, marks=pytest.mark.slow) for seed in (215, 230)),
    ],
)
def test_the_record_is_not_fitted_with_errors_of_many_tolerances(seed: int, share: float) -> None:
    """Weighted by the noise of neighbouring samples, the force led to alpha off by 11 to 60 % of its rms."""
    made = flight(seed, "none")
    found = reconstruct(made.flight)
    error = np.sqrt(np.mean((found.motion.alpha - made.true.alpha) ** 2))
    assert error < share * np.sqrt(np.mean(made.true.alpha**2))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "truth", "listed"),
    [
        (238, "none", ("damping", "bodyfixed")),
        *((*each, LISTED) for each in ((238, "none"), (276, "none"), (278, "damping"), (279, "bodyfixed"))),
    ],
)
def test_the_walk_that_such_noise_makes_is_no_mechanism(seed: int, truth: str, listed: tuple[str, ...]) -> None:
    verdict = compare(flight(seed, truth).flight, CompareConfig(mechanisms=listed, maximum_likelihood="none")).verdict
    assert verdict.winner in (None, "none", truth)
