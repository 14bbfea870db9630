from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms import installed
from brv_hypo.mechanisms.conformance import sample_flight
from brv_hypo.mechanisms.contract import RecordEffect
from brv_hypo.tracing import additions
from brv_hypo.tracing.fit import history_name

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


@pytest.mark.parametrize(("value", "offered"), [(-2.24, False), (-0.5, True)])
def test_an_error_as_large_as_what_is_measured_is_offered_by_no_trace(
    value: float, offered: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A dynamic pressure of -124 % was within 30 tolerances of 7.5 %."""
    effect = next(e for e in RECORD if e.name == "dynamic_pressure_scale")
    (variant,) = additions._variants_of({0: sample_flight()}, effect)
    variant = tuple(each.model_copy(update={"size": 0.075}) for each in variant)
    column = SimpleNamespace(term=history_name(variant[0]))
    found = SimpleNamespace(selected=(column,), values=np.array([value]), baseline_size=0, information=0.0)
    monkeypatch.setattr(additions, "forward", lambda *_: [found])
    fit: Any = SimpleNamespace(problem=SimpleNamespace(frame=None), null=found)
    assert (additions._try_record_effect(fit, [variant]) is not None) is offered


def test_wind_step_is_searched_over_the_record_and_then_closer() -> None:
    flight = sample_flight()
    effect = next(e for e in RECORD if e.name == "wind_step")
    first = effect.variants(flight)
    times = [variant.time for variant in first]
    assert flight.time[0] < min(times) < max(times) < flight.time[-1]
    closer = [variant.time for variant in first[4].variants(flight)]
    assert max(closer) - min(closer) < 2.0 * (times[1] - times[0])
