"""Clocks of instruments on vehicles that turn fast while a record lasts few of their cycles."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo import compare, reconstruct
from brv_hypo.comparison import CompareConfig
from tests.studies.independent.mechanisms import LISTED
from tests.studies.independent.study import MIXED, drawn_flight

FIRST = 121000


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "truth"), [(121013, "damping"), (121041, "sticking")])
def test_the_ends_of_a_record_do_not_shift_the_clock(seed: int, truth: str) -> None:
    """A unit shifted as a whole differs from one that is not at its ends alone, where it has to be continued: they
    were fitted with 5 to 8 tolerances of gyros and accelerometers late together, and nothing was adequate.
    """
    made = drawn_flight(seed, seed - FIRST, MIXED, 1.0, 5, coloured=True, drawn=True)
    assert made.truth == truth
    verdict = compare(made.flight, CompareConfig(mechanisms=LISTED, maximum_likelihood="none")).verdict
    assert verdict.winner in (None, truth)
    assert truth in verdict.equivalent


@pytest.mark.parametrize(
    "seed", [160000, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (160003, 160010, 160022))]
)
def test_errors_of_angles_include_that_of_the_gyros_clock(seed: int) -> None:
    """Motion is on the gyros' clock: its true time is uncertain by the tolerance."""
    made = drawn_flight(seed, seed - 160000, MIXED, 1.0, 5, coloured=True)
    found, true = reconstruct(made.flight), made.true
    missed = {
        "alpha": found.motion.alpha - true.alpha,
        "windward_meridian": np.angle(np.exp(1j * (found.motion.windward_meridian - true.meridian))),
    }
    for name, sigma in (("alpha", found.alpha_sigma), ("windward_meridian", found.phi_w_sigma)):
        assert np.sqrt(np.mean(missed[name] ** 2)) < 2.0 * np.sqrt(np.mean(sigma**2)), name
    by_clock = found.motion.alpha_rate * made.flight.instruments.time_skew[0]
    # Besides, the velocity may have a random walk: a constant of the crossflow.
    rest = found.alpha_sigma**2 - found.alpha_sigma_on_clock**2 - by_clock**2
    walk = rest * np.cos(found.motion.alpha) ** 2
    np.testing.assert_allclose(walk, np.mean(walk), rtol=1e-6, atol=1e-12 * np.mean(found.alpha_sigma**2))
    assert np.mean(walk) >= -1e-12 * np.mean(found.alpha_sigma**2)
