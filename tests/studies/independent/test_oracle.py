"""The ideal observer's columns account for the independent records, and its figures behave."""

from __future__ import annotations

import numpy as np
import pytest

from tests.studies.independent.flights import Made, draw_flight, make_flight
from tests.studies.independent.oracle import DETECTED, Ground, best_rival, judge


def _misfit(made: Made, ground: Ground, planted: float) -> float:
    """Mean square of the record's de-rolled rates, in noise, less what baseline, effects and truth explain."""
    flight = made.flight
    rates = (flight.q + 1j * flight.r) * np.exp(1j * ground.phase(flight.p))
    residual = ground.project(ground.whitened(rates - planted * ground.planted())[:, None])
    return float(np.sum(residual**2)) / (2.0 * flight.samples)


@pytest.mark.parametrize("seed", [5, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 4, 7, 18))])
def test_columns_account_for_the_record(seed: int) -> None:
    made = draw_flight(seed)
    ground = Ground(made)
    assert _misfit(made, ground, 1.0) < 1.12
    assert _misfit(made, ground, 0.0) > 3.0


@pytest.mark.thorough
def test_limit_is_where_the_effect_has_that_f() -> None:
    strong = make_flight("capsule", "bodyfixed", 0.05, seed=3)
    known = judge(strong, rivals=())
    at_limit = judge(make_flight("capsule", "bodyfixed", known.limit_amplitude, seed=3), rivals=())
    assert at_limit.f_ratio == pytest.approx(DETECTED, rel=0.1)
    assert at_limit.limit_share == pytest.approx(known.limit_share, rel=0.1)


@pytest.mark.thorough
def test_worse_gyros_hide_more() -> None:
    limits = [
        judge(make_flight("cone", "inplane", 0.1, seed=3, noise_factor=factor), rivals=()).limit_share
        for factor in (1.0, 3.0)
    ]
    assert limits[1] == pytest.approx(3.0 * limits[0], rel=0.3)


@pytest.mark.parametrize(
    "truth",
    ["bodyfixed", *(pytest.param(t, marks=pytest.mark.slow) for t in ("damping", "inplane", "lag", "sticking"))],
)
def test_mechanism_reproduces_itself_better_than_rivals_do(truth: str) -> None:
    made = make_flight("slender", truth, 0.05, seed=8)
    ground = Ground(made)
    target = ground.project(ground.whitened(ground.planted())[:, None])[:, 0]
    own = best_rival(ground, target, truth)
    known = judge(made)
    assert own.two_ln_l < 0.01 * known.f_ratio
    assert own.two_ln_l < 0.5 * known.against[known.nearest].two_ln_l
    assert own.start == pytest.approx(made.true.planted.start, abs=0.25)
    assert truth not in known.against


@pytest.mark.thorough
def test_no_rival_does_worse_than_nothing() -> None:
    for seed in (0, 9):
        known = judge(draw_flight(seed))
        assert all(0.0 <= rival.two_ln_l <= known.f_ratio * (1.0 + 1e-9) for rival in known.against.values())


@pytest.mark.thorough
def test_gyros_without_noise_are_refused() -> None:
    with pytest.raises(ValueError, match="without noise"):
        judge(make_flight("cone", "inplane", seed=1, noise_factor=0.0))


@pytest.mark.thorough
def test_with_nothing_planted_there_is_nothing_to_find() -> None:
    known = judge(make_flight("cone", "none", seed=1), rivals=("bodyfixed",))
    assert known.f_ratio == 0.0
    assert known.limit_amplitude == np.inf
