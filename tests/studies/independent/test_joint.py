"""What begins and ends at the same Mach numbers on two flights, at other times, is found on both together."""

from __future__ import annotations

from dataclasses import replace

import pytest

from brv_hypo import compare, simulate
from brv_hypo.comparison import CompareConfig
from brv_hypo.comparison.preparation import _by_mach, sharing_warnings
from brv_hypo.model.common_time import CommonTime
from brv_hypo.motion.reconstruction import Reconstruction
from tests.comparison.pulse import problem
from tests.studies.independent.joint import fly_several, machs
from tests.studies.independent.mechanisms import LISTED

# What the fits state of the edges that they know least, s.
EDGE_SIGMA = 0.0245


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("vehicle", "truth", "seed"),
    [
        ("cone", "bodyfixed", 1),
        pytest.param("slender", "inplane", 2, marks=pytest.mark.slow),
        pytest.param("capsule", "damping", 3, marks=pytest.mark.slow),
    ],
)
def test_a_mechanism_at_mach_numbers_is_named_and_placed(vehicle: str, truth: str, seed: int) -> None:
    """The flights come by them 0.3 to 2.3 s apart: at the same times on both, nothing was adequate."""
    made = fly_several(vehicle, truth, seed)
    comparison = compare([each.flight for each in made], CompareConfig(mechanisms=LISTED, maximum_likelihood="none"))
    assert comparison.warnings == ()
    assert comparison.verdict.winner == truth
    knots = comparison.ranking[0].knots
    run = float(made[0].true.mach[0] - made[0].true.mach[-1])
    for edge, wanted in enumerate(machs(made[0])):
        knot = min(knots, key=lambda each: abs(each.mach - wanted))
        assert knot.mach == pytest.approx(wanted, abs=0.005 * run)
        for own, flight in zip(knot.flights_s, made, strict=True):
            planted = flight.true.planted
            assert own == pytest.approx((planted.start, planted.stop)[edge], abs=2.0 * EDGE_SIGMA)
    regions = [term.region_s for term in comparison.ranking[0].terms if term.region_s is not None]
    assert {edge for region in regions for edge in region} == {knot.time_s for knot in knots}


@pytest.mark.slow
def test_events_off_one_mach_number_are_named_too_and_said() -> None:
    """On the second flight the damping begins 41 ms early."""
    made = fly_several("cone", "damping", 3002, apart=0.04)
    comparison = compare([each.flight for each in made], CompareConfig(mechanisms=LISTED, maximum_likelihood="none"))
    assert comparison.verdict.winner == "damping"
    (said,) = comparison.warnings
    assert "the change of C_damping" in said
    assert "each flight has its own time" in said
    for number, flight in enumerate(made):
        starts = [knot.flights_s[number] for knot in comparison.ranking[0].knots]
        assert min(abs((start or 0.0) - flight.true.planted.start) for start in starts) < EDGE_SIGMA


@pytest.mark.slow
def test_steps_that_come_apart_on_two_flights_are_no_onsets_that_take_time() -> None:
    """In the time of their Mach numbers alone four changes were found about the two, and knots 5 sigma off."""
    planted = {"mechanism": "lag", "theta": {"delay": 0.03}, "terms": {"lag fraction": 1.0}}
    edges = [(2.0, 3.2), (2.04, 3.22)]
    flown = [
        simulate(
            {"base": "research_cone", "duration": 4.2, "mechanisms": [{**planted, "start": a, "stop": b}]}, seed=seed
        )
        for seed, (a, b) in enumerate(edges, start=5)
    ]
    comparison = compare(flown, CompareConfig(mechanisms=("lag",), maximum_likelihood="none"))
    leader = comparison.ranking[0]
    assert comparison.verdict.winner == "lag"
    assert [term.name for term in leader.terms] == ["jump in lag fraction"] * 2
    for edge, knot in zip(zip(*edges, strict=True), leader.knots, strict=False):
        assert knot.flights_s == pytest.approx(edge, abs=0.005)
    (said,) = comparison.warnings
    assert "does not come at one Mach number on all flights (0.04 s apart): each flight has its own time" in said


def _reconstruction(**channels: object) -> Reconstruction:
    found = problem().frame.reconstructions[0]
    return replace(found, flight=replace(found.flight, **channels))  # type: ignore[arg-type]


def test_flights_without_mach_numbers_keep_their_times_and_it_is_said_why() -> None:
    flights = [_reconstruction(), _reconstruction(mach=None)]
    assert not isinstance(_by_mach(flights), CommonTime)
    (warning,) = sharing_warnings(flights)
    assert "at the same time on every flight" in warning
    assert "flight 2 has no Mach number" in warning


def test_one_flight_shares_nothing_and_nothing_is_said_of_it() -> None:
    assert _by_mach([_reconstruction()]) is None
    assert sharing_warnings([_reconstruction()]) == ()
