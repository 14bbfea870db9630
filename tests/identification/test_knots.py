"""Knots between nodes: collocation must give the states of the sharp course."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from brv_hypo.comparison import CompareConfig, compare
from brv_hypo.identification.identify import _HELD, _loose_knots, _stale
from brv_hypo.identification.parameters import averaged, kink, on_grid, placed
from brv_hypo.model.common_time import OwnTime
from brv_hypo.model.term import TimeBasis
from brv_hypo.simulation import SimulatedFlight, simulate
from tests.flights import SAMPLE_RATE_HZ, flown
from tests.harness.invariance.changes import shifted

STEP = 0.05
NODES = np.arange(0.0, 2.0 + STEP / 2, STEP)
MIDDLES = NODES[:-1] + STEP / 2


def moment(t):
    return np.cos(3.0 * t + 0.3)


def derivatives(t):
    return -3.0 * np.sin(3.0 * t + 0.3), -9.0 * np.cos(3.0 * t + 0.3)


def collocated(time_basis: TimeBasis, corrected: bool = True) -> tuple[float, float]:
    """Rate and position at the end, by Hermite-Simpson, of rate' = time basis x moment, position' = rate."""
    half = np.full_like(MIDDLES, STEP / 2)
    first, second = kink(time_basis, MIDDLES, half) if corrected else (np.zeros_like(MIDDLES), np.zeros_like(MIDDLES))
    slope, curvature = derivatives(MIDDLES)
    if corrected:
        ends, middle = on_grid(time_basis, NODES, np.zeros_like(NODES)), on_grid(time_basis, MIDDLES, half)
    else:
        ends, middle = time_basis(NODES), time_basis(MIDDLES)
    ends = ends * moment(NODES)
    middle = middle * moment(MIDDLES) - first * slope + second * curvature
    rate = position = 0.0
    for k in range(MIDDLES.size):
        change = STEP / 6.0 * (ends[k] + 4.0 * middle[k] + ends[k + 1])
        halfway = rate + change / 2.0 + STEP / 8.0 * (ends[k] - ends[k + 1])
        halfway += first[k] * moment(MIDDLES[k]) - 2.0 * second[k] * slope[k]
        position += STEP / 6.0 * (rate + 4.0 * halfway + rate + change)
        rate += change
    return rate, position


@settings(max_examples=60)
@given(knot=st.floats(0.2, 1.0), length=st.floats(0.2, 0.8))
def test_a_jump_between_nodes_gives_the_rate_and_position_of_the_sharp_jump(knot, length):
    rate, position = collocated(TimeBasis("jump", knot, knot + length))
    stop, end = knot + length, NODES[-1]
    assert rate == pytest.approx(quad(moment, knot, stop)[0], abs=1e-6)
    assert position == pytest.approx(quad(lambda t: (end - t) * moment(t), knot, stop)[0], abs=2e-6)


def test_without_the_correction_the_error_is_a_thousand_times_larger():
    time_basis = TimeBasis("jump", 0.513)
    exact = quad(moment, 0.513, NODES[-1])[0]
    assert abs(collocated(time_basis, corrected=False)[0] - exact) > 1e3 * abs(collocated(time_basis)[0] - exact)


@settings(max_examples=40)
@given(knot=st.floats(0.2, 1.8))
def test_a_ramp_is_integrated_exactly(knot):
    time_basis = TimeBasis("ramp", knot)
    half = np.full_like(MIDDLES, STEP / 2)
    ends, middle = on_grid(time_basis, NODES, np.zeros_like(NODES)), on_grid(time_basis, MIDDLES, half)
    total = np.sum(STEP / 6.0 * (ends[:-1] + 4.0 * middle + ends[1:]))
    assert total == pytest.approx((NODES[-1] - knot) ** 2 / 2.0, abs=1e-12)


@given(knot=st.floats(0.3, 1.5))
def test_the_averaged_time_basis_is_the_mean_over_the_block(knot):
    time_basis, width, time = TimeBasis("jump", knot, knot + 0.2), 0.1, np.linspace(0.1, 1.9, 37)
    fine = np.linspace(-width / 2, width / 2, 4001)
    expected = [np.mean(time_basis(t + fine)) for t in time]
    np.testing.assert_allclose(averaged(time_basis, time, width), expected, atol=1e-3)


OWN = OwnTime(np.linspace(0.0, 2.0, 401), np.linspace(0.0, 2.0, 401) ** 1.5 + 3.0, np.linspace(9.0, 8.0, 401))


@pytest.mark.parametrize("kind", ["jump", "ramp"])
def test_time_bases_in_common_time_are_placed_where_the_flight_passes_them(kind: str) -> None:
    """Simpson's rule has their integrals: of a ramp but for the bend of common time about its knot."""
    time_basis = TimeBasis(kind, 3.5, 4.5)  # type: ignore[arg-type]
    nodes = np.linspace(0.0, 2.0, 41)
    halfway, half = 0.5 * (nodes[1:] + nodes[:-1]), np.full(40, 0.025)
    ends = on_grid(*placed(time_basis, nodes, np.zeros(41), OWN))
    middle = on_grid(*placed(time_basis, halfway, half, OWN))
    simpson = np.sum(0.05 / 6.0 * (ends[:-1] + 4.0 * middle + ends[1:]))
    fine = np.linspace(0.0, 2.0, 400_001)
    exact = np.mean(time_basis(OWN.common_at(fine))) * 2.0
    assert simpson == pytest.approx(exact, abs=2e-4)
    at_start, *_ = placed(TimeBasis("jump", 3.5), nodes, half, OWN)
    assert at_start.start == pytest.approx(0.5 ** (2.0 / 3.0), abs=1e-4)


def test_a_time_basis_in_a_flights_own_time_is_not_changed() -> None:
    time_basis, time, half = TimeBasis("jump", 1.0), np.linspace(0.0, 2.0, 5), np.zeros(5)
    assert placed(time_basis, time, half, None) == (time_basis, time, half)


@pytest.mark.parametrize(("moved", "brought", "stale"), [(0.0, 0.0, False), (0.09, 0.0, True), (0.0, 2e-4, True)])
def test_a_fixed_knot_has_no_error_and_does_not_move(moved: float, brought: float, stale: bool) -> None:
    """Nodes are where they were, or not, whether its error is known or not; so are block means if an estimate moves."""
    nonlinear_parameters = (SimpleNamespace(name="fixed", kind="knot"), SimpleNamespace(name="free", kind="knot"))
    places = {"fixed": 1.0, "free": 2.0}
    old: Any = SimpleNamespace(
        block=2,
        structure=SimpleNamespace(nonlinear_parameters=nonlinear_parameters),
        theta=places,
        seconds_to_node=0.1,
        solve=lambda **_: SimpleNamespace(theta={"free": 2.0 + moved + brought}),
    )
    found: Any = SimpleNamespace(theta={"fixed": 1.0, "free": 2.0 + moved}, std_error={"free": 1e-3})
    assert _stale(old, old, found, ("fixed",)) is stale


@pytest.mark.parametrize(
    ("status", "errors", "loose"),
    [("stalled", (0.2, 0.01), ("a",)), ("stalled", (0.01, 0.01), ("a", "b")), ("converged", (0.2, 0.01), ())],
)
def test_the_least_known_knots_are_fixed_where_a_search_stalls(status: str, errors: Any, loose: Any) -> None:
    """All of them where each is known to less than a node: that the data determine none is not said then."""
    problem: Any = SimpleNamespace(structure=SimpleNamespace(knots=("a", "b")), seconds_to_node=0.1)
    found: Any = SimpleNamespace(status=status, std_error=dict(zip("ab", errors, strict=True)))
    assert _loose_knots(problem, found) == loose
    assert "determine" not in _HELD


def brief_lag() -> SimulatedFlight:
    """Three seconds with a lag that begins and ends."""
    lag = {"mechanism": "lag", "theta": {"delay": 0.04}, "terms": {"lag fraction": 0.7}, "start": 1.0, "stop": 2.0}
    return simulate("research_cone", seed=4, duration=3.0, sample_rate=SAMPLE_RATE_HZ, mechanisms=[lag])


@pytest.mark.thorough
@pytest.mark.parametrize(
    "made", [brief_lag, pytest.param(partial(flown, "research_cone", "lag"), id="whole", marks=pytest.mark.slow)]
)
def test_the_likelihood_knows_no_origin_of_time(made: Callable[[], SimulatedFlight]) -> None:
    """Days after the clock's zero, differences by a knot were steps of seconds: estimates off by 4 standard errors."""
    flight, days = made().flight, 304512.0
    (before, after) = (
        compare([each], CompareConfig(mechanisms=("lag",))).ranking[0].ml for each in (flight, shifted(flight, days))
    )
    assert before is not None
    assert after is not None
    for one, other in zip((*before.terms, *before.derived), (*after.terms, *after.derived), strict=True):
        later = days if one.name.startswith("lag st") else 0.0
        assert other.value - later == pytest.approx(one.value, abs=0.01 * one.std_error)
        assert other.std_error == pytest.approx(one.std_error, rel=1e-3)
