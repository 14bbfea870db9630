"""Flights that share their Mach numbers: whose time is what, and time bases in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from brv_hypo.arrays import FloatArray
from brv_hypo.inference.search import offers
from brv_hypo.linearisation.frame import WeakSegment, build_frame
from brv_hypo.mechanisms.contract import TimeVariation
from brv_hypo.mechanisms.registry import parse_hypothesis
from brv_hypo.model.baseline import PitchDamping
from brv_hypo.model.common_time import CommonTime, at, common_time
from brv_hypo.model.term import Regressor, TimeBasis
from brv_hypo.motion import reconstruct
from tests.chains import reconstructed
from tests.comparison.pulse import problem

TIME = np.linspace(2.0, 6.0, 401)
OTHER_TIME = np.linspace(10.0, 13.0, 301)


def mach(time: FloatArray) -> FloatArray:
    """Of the first flight."""
    return np.asarray(9.0 - 0.6 * (time - 2.0) - 0.1 * (time - 2.0) ** 2, dtype=float)


def first_time(time: FloatArray) -> FloatArray:
    """When the first flight has the Mach number of the other one."""
    return np.asarray(2.5 + 0.8 * (time - 10.0) + 0.1 * (time - 10.0) ** 2, dtype=float)


def noisy(values: FloatArray, seed: int, sigma: float = 0.005) -> FloatArray:
    return values + sigma * np.random.default_rng(seed).standard_normal(values.size)


def shared(seed: int = 0, sigma: float = 0.005) -> CommonTime:
    found = common_time(
        [(TIME, noisy(mach(TIME), seed, sigma)), (OTHER_TIME, noisy(mach(first_time(OTHER_TIME)), seed + 1, sigma))]
    )
    assert isinstance(found, CommonTime)
    return found


@given(seed=st.integers(0, 10_000))
@settings(max_examples=20, deadline=None)
def test_common_time_is_that_of_the_reference_flight_at_the_same_mach_number(seed: int) -> None:
    """Noise of 0.005 makes errors of some milliseconds where Mach number falls by 1 in a second."""
    found = shared(seed)
    first, other = found.flights
    assert first.common is first.time
    assert np.all(np.diff(other.common) > 0.0)
    inside = (first_time(OTHER_TIME) > 2.0) & (first_time(OTHER_TIME) < 6.0)
    error = other.common[inside] - first_time(OTHER_TIME)[inside]
    assert np.sqrt(np.mean(error**2)) < 0.005
    assert found.mach(4.0) == pytest.approx(float(mach(np.array(4.0))), abs=0.005)


@pytest.mark.parametrize("order", [(0, 1, 2), (1, 0, 2), (2, 1, 0)])
def test_the_reference_is_the_flight_of_the_widest_range_in_any_order(order: tuple[int, ...]) -> None:
    records = [(OTHER_TIME, mach(first_time(OTHER_TIME))), (TIME, mach(TIME)), (TIME + 20.0, mach(TIME) * 0.99)]
    found = common_time([records[k] for k in order])
    assert isinstance(found, CommonTime)
    assert found.reference == order.index(1)
    assert found.flights[order.index(0)].common == pytest.approx(first_time(OTHER_TIME), abs=0.01)


@given(time=st.floats(10.0, 13.0))
@settings(max_examples=20, deadline=None)
def test_own_and_common_time_are_inverse(time: float) -> None:
    other = shared().flights[1]
    assert other.own_at(float(other.common_at(np.array(time)))) == pytest.approx(time, abs=1e-9)


def test_a_time_that_a_flight_does_not_come_by_lies_beyond_its_record() -> None:
    other = shared().flights[1]
    assert not other.flies(2.0)
    assert other.own_at(2.0) < 10.0
    assert other.own_at(np.inf) == np.inf
    assert at(None, 2.0) == "2.00 s"
    assert at(shared(sigma=0.0), 2.0) == "Mach 9.00"


@given(time=st.floats(10.0, 13.0), late=st.tuples(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2)))
@settings(max_examples=20, deadline=None)
def test_events_that_are_late_by_mach_number_come_together_in_the_aligned_time(
    time: float, late: tuple[float, float]
) -> None:
    by_mach = shared(sigma=0.0)
    found = by_mach.aligned(np.array([[0.0, 0.0], late]))
    assert found is not None
    assert found.flights[0].common is by_mach.flights[0].common or np.array_equal(found.flights[0].common, TIME)
    before = float(by_mach.flights[1].common_at(np.array(time)))
    after = float(found.flights[1].common_at(np.array(time)))
    assert before - after == pytest.approx(float(np.interp(before, by_mach.span, late)), abs=1e-3)
    assert found.late_at(before) == pytest.approx([0.0, before - after], abs=1e-3)
    assert by_mach.late_at(before) == pytest.approx([0.0, 0.0])


def test_an_alignment_by_which_time_would_run_backwards_is_none() -> None:
    assert shared().aligned(np.array([[0.0, 0.0], [-9.0, 9.0]])) is None


@pytest.mark.parametrize(
    ("other", "word"),
    [
        (None, "flight 2 has no Mach number"),
        (np.full(301, np.nan), "flight 2 has no Mach number"),
        (np.full(301, 5.0), "neither only falls nor only rises"),
        (8.0 + np.sin(OTHER_TIME * 4.0), "neither only falls nor only rises"),
        (noisy(np.full(301, 5.0), 3), "neither only falls nor only rises"),
        (mach(first_time(OTHER_TIME))[::-1], "rises on others"),
    ],
)
def test_flights_whose_mach_numbers_do_not_give_time_have_none_in_common(other: FloatArray | None, word: str) -> None:
    found = common_time([(TIME, mach(TIME)), (OTHER_TIME, other)])
    assert isinstance(found, str)
    assert word in found


def test_flights_at_other_mach_numbers_are_apart() -> None:
    falls = mach(first_time(OTHER_TIME))
    found = common_time([(TIME, mach(TIME)), (OTHER_TIME, falls - 7.0), (OTHER_TIME, falls)])
    assert isinstance(found, CommonTime)
    assert found.apart() == (1,)
    assert np.all(np.diff([found.mach(time) for time in np.linspace(0.0, 20.0, 50)]) < 0.0)


def segment(common: FloatArray | None) -> WeakSegment:
    count = OTHER_TIME.size
    return WeakSegment(OTHER_TIME, np.zeros(count, complex), np.ones(count, complex), 0, slice(0, count), common)


def moment(time: FloatArray) -> FloatArray:
    return np.asarray(np.cos(3.0 * time) + 0.3, dtype=float)


@settings(max_examples=40, deadline=None)
@given(kind=st.sampled_from(["constant", "jump", "ramp"]), start=st.floats(1.0, 6.5), length=st.floats(0.2, 6.0))
def test_columns_are_integrals_of_time_bases_in_common_time(kind: str, start: float, length: float) -> None:
    """Wherever the knots lie; a ramp is straight in common time, and bent in the flight's own."""
    time_basis = TimeBasis("constant") if kind == "constant" else TimeBasis(kind, start, start + length)  # type: ignore[arg-type]
    here = segment(first_time(OTHER_TIME))
    column = here.columns(here.integrate(moment(OTHER_TIME)[:, np.newaxis] + 0j), np.array([0]), [time_basis])[:, 0]
    knots = [float(np.interp(t, first_time(OTHER_TIME), OTHER_TIME)) for t in (start, start + length)]
    for index in (57, 230, 300):
        inside = [t for t in knots if 10.0 < t < OTHER_TIME[index]] or None
        expected = quad(
            lambda t: float(moment(np.array(t)) * time_basis(first_time(np.array(t)))),
            10.0,
            OTHER_TIME[index],
            points=inside,
            limit=200,
        )[0]
        assert column[index].real == pytest.approx(expected, abs=2e-5)


@pytest.mark.parametrize("kind", ["constant", "jump", "ramp"])
def test_a_common_time_that_is_the_own_changes_nothing(kind: str) -> None:
    time_basis = TimeBasis("constant") if kind == "constant" else TimeBasis(kind, 11.2345, 12.3456)  # type: ignore[arg-type]
    values = moment(OTHER_TIME)[:, np.newaxis] + 0j
    columns = [
        each.columns(each.integrate(values), np.array([0]), [time_basis])
        for each in (segment(None), segment(OTHER_TIME))
    ]
    np.testing.assert_allclose(columns[0], columns[1], rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("kind", ["jump", "ramp"])
@pytest.mark.parametrize("later", [-1e-13, 0.0, 1e-13, 0.7])
def test_what_begins_where_a_flight_has_ended_is_nothing_of_it(kind: TimeVariation, later: float) -> None:
    """Not what rounding leaves of two equal integrals, by any multiple of which a fit takes up the last sample's noise.

    Several flights in the other order round otherwise: which knots such a fit chose was rounding.
    """
    common = first_time(OTHER_TIME)
    here, draws = segment(common), np.random.default_rng(1)
    moments = draws.standard_normal((OTHER_TIME.size, 200)) + 1j * draws.standard_normal((OTHER_TIME.size, 200))
    every = np.arange(200)
    begun, before = (
        here.columns(here.integrate(moments), every, [TimeBasis(kind, start)] * every.size)
        for start in (float(common[-1]) + later, 0.5 * float(common[-2] + common[-1]))
    )
    assert not np.any(begun)
    assert not np.any(before[:-1])
    assert np.all(before[-1])


@pytest.mark.parametrize("count", [1, 2])
def test_what_begins_where_flights_by_the_clock_have_ended_is_nothing_of_them(count: int) -> None:
    one = reconstructed("bodyfixed")
    frame = build_frame([one] * count, [PitchDamping()])
    (term,) = PitchDamping().terms(one.motion, {})
    late = Regressor(PitchDamping.name, term.name, (), TimeBasis("jump", float(one.motion.time[-1])), term.units)
    assert not np.any(frame.columns([late]))


@pytest.mark.parametrize("order", [(0, 1, 2), (1, 2, 0), (2, 1, 0)])
def test_common_mach_numbers_do_not_depend_on_the_order_of_flights(order: tuple[int, ...]) -> None:
    records = [
        (TIME, noisy(mach(TIME), 3)),
        (OTHER_TIME, noisy(mach(first_time(OTHER_TIME)), 4)),
        (OTHER_TIME, noisy(mach(first_time(OTHER_TIME) + 2.0), 5)),
    ]
    found = [common_time([records[k] for k in places]) for places in ((0, 1, 2), order)]
    assert all(isinstance(each, CommonTime) for each in found)
    places = np.linspace(1.0, 9.0, 60)
    first, again = ([each.mach(place) for place in places] for each in found if isinstance(each, CommonTime))
    assert first == again


def test_of_flights_that_share_their_clocks_the_longest_record_is_the_reference() -> None:
    longest = reconstructed("bodyfixed")
    short = reconstruct(longest.flight.window(None, 4.0))
    frames = [build_frame(each, []) for each in ([longest, short], [short, longest])]
    assert [frame.reference for frame in frames] == [0, 1]
    per_cycle = parse_hypothesis("bodyfixed", {"bodyfixed": {"variant": "per_cycle"}})
    offered = [offers(problem(), frame.with_mechanisms(per_cycle), per_cycle) for frame in frames]
    assert offered[0] == offered[1]


def test_one_flight_has_its_own_time() -> None:
    """Nothing is at another time than before there was a common one: the very arrays are the same."""
    frame = problem().frame
    assert frame.common is None
    assert frame.own_time(0) is None
    assert all(motion.coefficient_time is motion.time for motion in frame.motions)
    assert all(each.coefficient_time is each.time for each in frame.segments)
    assert replace(frame.motions[0], common_time=TIME).coefficient_time is TIME
