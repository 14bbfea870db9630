from __future__ import annotations

import pytest

from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms import installed
from brv_hypo.mechanisms.conformance import sample_flight
from brv_hypo.mechanisms.contract import RecordEffect

CONTRACT = {
    "magnus", "cubic_stiffness", "stiffness_asymmetry", "trim", "dynamic_imbalance", "gyro_bias", "gyro_scale",
    "accel_bias", "accel_scale", "accel_position", "time_skew", "wind_step",
}  # fmt: skip
RECORD = [e.item for e in installed().values() if isinstance(e.item, RecordEffect)]


def test_every_effect_of_the_contract_is_installed() -> None:
    assert set(installed()) >= CONTRACT


@pytest.mark.parametrize("effect", RECORD, ids=lambda effect: effect.name)
def test_variants_are_the_same_effect(effect: RecordEffect) -> None:
    flight: Flight = sample_flight()
    assert all(variant.name == effect.name for variant in effect.variants(flight))


def test_wind_step_is_searched_over_the_record_and_then_closer() -> None:
    flight = sample_flight()
    effect = next(e for e in RECORD if e.name == "wind_step")
    first = effect.variants(flight)
    times = [variant.time for variant in first]
    assert flight.time[0] < min(times) < max(times) < flight.time[-1]
    closer = [variant.time for variant in first[4].variants(flight)]
    assert max(closer) - min(closer) < 2.0 * (times[1] - times[0])
