"""A smooth schedule of the slope by Mach number: its prior, where it is used, that it comes before jumps."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from brv_hypo.mechanisms import find
from brv_hypo.mechanisms.conformance import sample_motion, uniform_time
from brv_hypo.model.baseline import SlopeSchedule
from brv_hypo.motion.smoother import BENT
from brv_hypo.tracing import TraceConfig
from brv_hypo.tracing.acceptance import schedules_first
from brv_hypo.tracing.baseline import has_schedule, start_model, static_moment
from brv_hypo.tracing.fit import Flights, next_corrections
from tests.flights import nominal

machs = st.floats(0.5, 30.0)
MOTION = sample_motion(uniform_time())
FLIGHT: Any = None  # a schedule's prior is the design's: no flight changes it


@given(low=machs, ratio=st.floats(1.0001, 20.0), size=st.floats(1e-3, 10.0))
def test_every_term_has_a_prior_and_smoother_ones_the_larger(low: float, ratio: float, size: float) -> None:
    schedule = SlopeSchedule(low=low, high=low * ratio, size=size)
    sigmas = np.array(schedule.tolerance(FLIGHT))
    assert len(schedule.terms(MOTION, {})) == sigmas.size == 2 * schedule.sizes.size
    assert np.all(np.diff(schedule.sizes) < 0.0)
    np.testing.assert_allclose(sigmas[schedule.sizes.size :], schedule.sizes / BENT**2)


@given(low=machs, size=st.floats(1e-3, 10.0))
def test_there_is_no_schedule_over_a_narrow_range(low: float, size: float) -> None:
    assert SlopeSchedule(low=low, high=1.02 * low, size=size).sizes.size == 0


@given(low=machs, ratio=st.floats(1.5, 20.0))
def test_the_slopes_spread_is_at_most_its_size(low: float, ratio: float) -> None:
    schedule = SlopeSchedule(low=low, high=low * ratio, size=1.0)
    places = np.linspace(0.0, 1.0, 50)
    waves = np.cos(np.pi * np.outer(places, np.arange(1, schedule.sizes.size + 1)))
    # The mean is a column of its own; a boundary doubles the variance of what is even about it.
    assert np.all((waves**2) @ schedule.sizes**2 < 2.0 + 1e-9)


@pytest.mark.parametrize(("baseline", "expected"), [("scheduled", True), ("constant", False)])
def test_a_scheduled_baseline_follows_the_mach_number(baseline: Any, expected: bool) -> None:
    assert has_schedule(start_model(Flights((_falling(),), TraceConfig()), (), baseline)) is expected


@pytest.mark.parametrize(
    ("mach", "warming", "wavers"),
    [
        ((16.0, 15.7), 0.0, False),  # at one temperature the speed is Mach number by another name
        ((16.0, 15.7), 0.05, True),
        ((12.0, 6.0), 0.05, False),  # the schedule over so wide a range can follow it
    ],
)
def test_where_mach_number_hardly_changes_the_slope_follows_the_speed_too(
    mach: tuple[float, float], warming: float, wavers: bool
) -> None:
    flight = nominal().flight
    share = np.linspace(0.0, 1.0, flight.samples)
    own = mach[0] + (mach[1] - mach[0]) * share
    speed = 300.0 * own * (1.0 + warming * np.sin(np.pi * share))
    static = static_moment([replace(flight, mach=own, velocity=speed)], "scheduled")
    assert static.by == "mach"
    assert static.speeds == (pytest.approx((speed.min(), speed.max())) if wavers else None)


def _falling() -> Any:
    """A flight whose Mach number halves."""
    flight = nominal().flight
    return replace(flight, mach=np.linspace(12.0, 6.0, flight.samples))


def test_the_schedule_is_known_by_its_prior() -> None:
    flight = _falling()
    model = start_model(Flights((flight,), TraceConfig()), (), "scheduled")
    names = [mechanism.name for mechanism in model.tolerated(flight)]
    assert names.count(SlopeSchedule.name) == 1
    assert not any(column.mechanism == SlopeSchedule.name for column in model.columns)


def test_corrections_of_a_record_are_plausible() -> None:
    flight = nominal().flight
    model = start_model(Flights((flight,), TraceConfig()))
    size = flight.instruments.gyro_bias[1]
    found = next_corrections(0, flight, model, {("gyro_bias", "q"): 40.0 * size}, {})
    assert found["gyro_bias", "q"] == pytest.approx(3.0 * size)
    assert next_corrections(0, flight, model, {("gyro_bias", "q"): -size}, {})["gyro_bias", "q"] == -size


@pytest.mark.parametrize(("gain", "expected"), [(100.0, True), (60.0, True), (40.0, False)])
def test_a_schedule_that_explains_not_much_less_comes_first(gain: float, expected: bool) -> None:
    schedule, best = (
        SimpleNamespace(gain=size, follows=find(name).follows)
        for size, name in ((gain, "mach_stiffness"), (100.0, "inplane"))
    )
    candidates: Any = (best, schedule)
    assert (schedules_first(candidates) == (schedule,)) is expected


@pytest.mark.parametrize(
    ("name", "follows"), [("mach_stiffness", "mach"), ("reynolds_stiffness", "reynolds"), ("inplane", None)]
)
def test_the_mechanism_says_whether_it_is_a_schedule(name: str, follows: str | None) -> None:
    assert find(name).follows == follows
