"""The model that a trace ends with: its errors, its refinement, and another trace that starts from it."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from brv_hypo.errors import UsageError
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.yaml_mechanism import MechanismFile, Turn, YamlTerm
from brv_hypo.model.model import SavedColumn, SavedModel, SavedRecordError, restored
from brv_hypo.simulation import SimulationConfig, load_config, simulate
from brv_hypo.tracing import Trace, TraceConfig, trace
from tests.chains import ONE_EFFECT, TRIM, traced_trim, trimmed, trimmed_cone
from tests.flights import nominal
from tests.studies.loop.planting import another_flight

QUICK = TraceConfig(effects=("trim", "gyro_scale", "accel_scale"), discover=False)
SCALE = 0.01  # known to 1e-3


@cache
def flight_with_errors() -> Flight:
    """A cone with a trim and accelerometers whose y axis reads 1 % too much."""
    data = trimmed_cone(TRIM).model_dump()
    data["instruments"]["errors"] = {"accel_scale": {"y": SCALE}}
    return simulate(SimulationConfig.model_validate(data), seed=21).flight


@cache
def traced_errors() -> Trace:
    return trace(flight_with_errors(), QUICK)


ANY_TRACE = pytest.mark.parametrize("made", [traced_trim, pytest.param(traced_errors, marks=pytest.mark.slow)])


@pytest.fixture
def result() -> Trace:
    return traced_errors()


@pytest.fixture
def flight() -> Flight:
    return nominal().flight


@pytest.mark.slow
def test_both_effects_are_added(result: Trace) -> None:
    assert set(result.added) == {"trim", "accel_scale"}


@ANY_TRACE
def test_each_effect_is_a_finding_or_a_hint(made: Callable[[], Trace]) -> None:
    result = made()
    assert set(result.findings) | set(result.hints) == set(result.added)
    for step in result.steps:
        assert (step.status is None) == (step.named_in is None) == (step.added is None)
        assert (step.status == "hint") == bool(step.doubts)
        assert step.named_in is None or 0.0 <= step.named_in <= 1.0


@ANY_TRACE
def test_the_added_effect_is_the_first_candidate(made: Callable[[], Trace]) -> None:
    result = made()
    added = [step for step in result.steps if step.added is not None]
    assert all(step.candidates[0].effect == step.added for step in added)


@ANY_TRACE
def test_each_steps_error_before_is_the_one_befores_after(made: Callable[[], Trace]) -> None:
    result = made()
    for step, following in pairwise(result.steps):
        assert following.error_before == step.error_after
    models = pairwise(result.account[-1 - len(result.added) :])
    for step, (before, after) in zip(result.steps, models, strict=False):
        assert step.error_after is not None
        assert (step.error_before.held_out, step.error_after.held_out) == (before.held_out, after.held_out)


@pytest.mark.slow
def test_an_error_in_the_specific_force_alone_lowers_the_error_of_the_force(result: Trace) -> None:
    step = next(step for step in result.steps if step.added == "accel_scale")
    assert step.held_out_score is not None
    assert step.held_out_score > 5.0


@pytest.mark.slow
def test_the_error_of_the_record_has_a_standard_error(result: Trace) -> None:
    term = next(t for t in result.model.terms if t.channel == "record")
    # A scale common to both axes is that of the normal force: y reads too much as much as z reads too little.
    expected = {"y": SCALE, "z": -SCALE}[term.name]
    assert 0.0 < term.std_error < 0.5 * SCALE
    assert abs(term.value - expected) < 5.0 * term.std_error


@pytest.mark.slow
def test_after_the_limit_the_residual_is_that_of_the_final_model() -> None:
    settings = QUICK.model_copy(update={"max_steps": 1})
    result = trace(flight_with_errors(), settings)
    assert result.stopped == "limit"
    assert result.final_residual == traced_errors().steps[1].residual


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("flown", "made", "settings"),
    [
        pytest.param(lambda: trimmed().flight, traced_trim, ONE_EFFECT, id="one effect"),
        pytest.param(flight_with_errors, traced_errors, QUICK, id="two effects", marks=pytest.mark.slow),
    ],
)
def test_a_trace_that_starts_from_a_model_finds_its_residual(
    flown: Callable[[], Flight], made: Callable[[], Trace], settings: TraceConfig
) -> None:
    result = made()
    start = SavedModel.model_validate_json(result.model.definition.model_dump_json())
    again = trace(flown(), settings.model_copy(update={"start": start}))
    assert again.added == ()
    assert result.final_residual is not None
    np.testing.assert_allclose(again.steps[0].residual.rms, result.final_residual.rms, rtol=0.03)


def test_a_described_mechanism_survives_in_the_model(flight: Flight) -> None:
    term = YamlTerm(name="a", axis="body_y", turn=Turn(of="time", rate=5.0))
    file = MechanismFile(name="found", title="t", claims="c", source="s", terms=(term,))
    content = SavedModel(columns=(SavedColumn(mechanism="found", term="a", units="1"),), files=(file,))
    model = restored(content, (flight,))
    assert model.added == ("found",)
    assert model.saved() == content


def test_each_of_several_flights_has_its_own_of_what_one_flights_model_has_of_its_vehicle(flight: Flight) -> None:
    """A trim, and what begins at a time of the record; a moment by design is one of all."""
    own = SavedColumn(mechanism="trim", term="C_m0", units="1")
    begins = SavedColumn(mechanism="damping", term="C_mq", units="1/rad", kind="jump", start=2.0)
    shared = SavedColumn(mechanism="magnus", term="C_npalpha", units="1/rad")
    content = SavedModel(columns=(own, begins, shared))
    assert [column.flight for column in restored(content, (flight, flight)).columns] == [0, 1, 0, 1, None]
    assert [column.flight for column in restored(content, (flight,)).columns] == [None, None, None]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"columns": [{"mechanism": "magnos", "term": "a", "units": "1"}]}, "did you mean magnus"),
        ({"columns": [], "record": [{"effect": "magnus", "component": "p", "value": 1.0}]}, "is a mechanism"),
        ({"columns": [], "record": [{"effect": "gyro_bias", "component": "w", "value": 1.0}]}, "which has p, q"),
        (
            {
                "columns": [],
                "record": [{"effect": "gyro_bias", "component": "p", "value": 1.0, "options": {"when": 2.0}}],
            },
            "options",
        ),
    ],
)
def test_a_model_that_does_not_fit_is_refused(flight: Flight, content: dict[str, object], said: str) -> None:
    with pytest.raises(UsageError, match=said):
        restored(SavedModel.model_validate(content), (flight,))


def test_a_saved_effect_keeps_its_options(flight: Flight) -> None:
    error = SavedRecordError(effect="wind_step", component="y", value=2.0, options={"time": 3.0})
    model = restored(SavedModel(columns=(), record=(error,)), (flight,))
    assert model.saved().record[0].options["time"] == 3.0
    assert restored(model.saved(), (flight,)).saved() == model.saved()


def test_another_flight_has_the_same_effects_and_another_start() -> None:
    config = load_config("research_cone")
    other = another_flight(config, 5)
    assert other.start != config.start
    assert other.model_copy(update={"start": config.start}) == config
