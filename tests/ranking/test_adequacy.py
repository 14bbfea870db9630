"""Whether only noise is left, or something smooth beside the hypothesis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from brv_hypo.arrays import FloatArray
from brv_hypo.mechanisms import Mechanism, Term
from brv_hypo.model.term import Regressor, TimeBasis
from brv_hypo.motion.motion import Motion
from brv_hypo.ranking.adequacy import Misfit, misfit
from tests.ranking.pulse import fitted, problem


class Swell(Mechanism):
    """A moment of no mechanism's form: it swells and goes, turning from plane to plane."""

    name = "swell"
    title = claims = source = "a moment for this test"

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        size = np.exp(-((motion.time - motion.time.mean()) ** 2))
        return (Term("C", size * np.cos(motion.time), size * np.sin(motion.time)),)


@cache
def swell() -> FloatArray:
    """What the moment leaves beside the baseline, of unit length (rows,)."""
    fit = fitted("none")
    column = Regressor(Swell.name, "C", (), TimeBasis("constant"), "1")
    rows = problem().design(fit.frame.with_mechanisms([Swell()]), (*fit.columns, column))
    basis = np.linalg.qr(rows[:, :-1] / np.linalg.norm(rows[:, :-1], axis=0))[0]
    left = rows[:, -1] - basis @ (basis.T @ rows[:, -1])
    return np.asarray(left / np.linalg.norm(left), dtype=float)


def left_by(seed: int, amplitude: float) -> Misfit:
    """What is said of white noise with the moment at `amplitude` standard errors in it."""
    noise = np.random.default_rng(seed).standard_normal(problem().rows.size)
    fit = replace(fitted("none"), residual=noise + amplitude * swell())
    return misfit(replace(problem(), efficiency=1.0), fit, fit)


@pytest.mark.parametrize("seed", range(5))
def test_white_noise_leaves_no_room_for_something_else(seed: int) -> None:
    found = left_by(seed, 0.0)
    assert found.gain < 0.0
    assert found.p_value > 1e-3
    assert found.ratio == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("seed", range(5))
def test_a_smooth_moment_outside_the_list_is_something_else(seed: int) -> None:
    found = left_by(seed, 20.0)
    assert found.gain > 50.0
    assert found.p_value < 1e-6


@pytest.mark.parametrize(("level", "louder"), [(1.0, False), (1.1, False), (2.0, True)])
def test_rates_that_are_louder_than_their_noise_hold_something_else(level: float, louder: bool) -> None:
    """Smooth or not; but the level of the noise itself is not known to the last tenth."""
    noise = level * np.random.default_rng(3).standard_normal(problem().rows.size)
    fit = replace(fitted("none"), residual=noise)
    assert (misfit(replace(problem(), efficiency=1.0), fit, fit).gain > 0.0) == louder


def test_the_larger_the_moment_the_larger_the_gain() -> None:
    gains = [left_by(0, amplitude).gain for amplitude in (10.0, 20.0, 40.0, 80.0)]
    assert gains == sorted(gains)


def test_what_was_planted_is_missed_by_the_null_and_by_nothing_else() -> None:
    null, own = fitted("none"), fitted("bodyfixed")
    assert misfit(problem(), null, null).gain > 100.0
    found = misfit(problem(), own, null)
    assert found.gain < 0.0
    assert found.p_value > 1e-3
