"""Several flights at once: what they share, what is of each, and each flight as the others predict it."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms import find
from brv_hypo.model.model import SavedModel
from brv_hypo.prediction import predict
from brv_hypo.simulation import SimulationConfig, load_config, simulate
from brv_hypo.simulation.config import PlantedConfig
from brv_hypo.tracing import Trace, TraceConfig, trace
from brv_hypo.tracing.additions import analyse_step
from brv_hypo.tracing.baseline import start_model
from brv_hypo.tracing.fit import Flights, converged
from tests.chains import ONE_EFFECT, traced_trim, trimmed
from tests.flights import SAMPLE_RATE_HZ, STEP_S
from tests.studies.loop.planting import another_flight

pytestmark = pytest.mark.thorough

MAGNUS = -1.0
TRIMS = ((1.2e-3, -6e-4), (-9e-4, 1.0e-3))
QUICK = TraceConfig(effects=("magnus", "trim"), discover=False)


def flight(number: int) -> Flight:
    """One of two sister cones: the same Magnus moment, another trim, another start."""
    trim = dict(zip(("C_m0", "C_n0"), TRIMS[number], strict=True))
    data = load_config("research_cone").model_dump() | {"sample_rate": SAMPLE_RATE_HZ, "step": STEP_S}
    data["mechanisms"] = (
        {"mechanism": "magnus", "terms": {"C_npalpha": MAGNUS}, "kind": "constant"},
        {"mechanism": "trim", "terms": trim, "kind": "constant"},
    )
    return simulate(another_flight(SimulationConfig.model_validate(data), number), seed=30 + number).flight


@pytest.fixture(scope="module")
def pair() -> tuple[Flight, Flight]:
    return flight(0), flight(1)


@pytest.fixture(scope="module")
def result(pair: tuple[Flight, Flight]) -> Trace:
    return trace(pair, QUICK.model_copy(update={"max_steps": 2}))


@pytest.mark.slow
def test_both_effects_are_added(result: Trace) -> None:
    assert set(result.added) == {"magnus", "trim"}


@pytest.mark.slow
def test_what_follows_the_motion_is_shared(result: Trace) -> None:
    terms = [term for term in result.model.terms if term.mechanism == "magnus"]
    assert len(terms) == 1
    assert abs(terms[0].value - MAGNUS) < 0.1 * abs(MAGNUS)
    assert len([term for term in result.model.terms if term.name == "C_malpha"]) == 1


@pytest.mark.slow
@pytest.mark.parametrize("number", [0, 1])
def test_each_flight_has_its_trim(result: Trace, number: int) -> None:
    terms = {term.name: term for term in result.model.terms}
    for name, planted in zip(("C_m0", "C_n0"), TRIMS[number], strict=True):
        found = terms[f"{name} [flight {number + 1}]"]
        # Beside a c.g. offset within its tolerance, which every fit includes.
        assert abs(found.value - planted) < 0.15 * 1.2e-3


@pytest.mark.slow
def test_each_flight_is_predicted_from_the_other(result: Trace) -> None:
    shared = next(step for step in result.steps if step.added == "magnus")
    assert shared.ratio_of_flights_left_out is not None
    assert shared.ratio_of_flights_left_out < 1.0
    own = next(step for step in result.steps if step.added == "trim")
    assert own.ratio_of_flights_left_out is None


@pytest.mark.slow
def test_the_json_has_all_flights(result: Trace, pair: tuple[Flight, Flight]) -> None:
    content = json.loads(result.model_dump_json(by_alias=True))
    assert [each["samples"] for each in content["flights"]] == [each.samples for each in pair]
    assert content["flight"] == content["flights"][0]
    assert all(math.isfinite(step["residual"]["rms"]) for step in content["steps"])


@pytest.mark.slow
def test_the_model_starts_another_trace_of_as_many(result: Trace, pair: tuple[Flight, Flight]) -> None:
    start = SavedModel.model_validate_json(result.model.definition.model_dump_json())
    again = trace(pair, QUICK.model_copy(update={"start": start, "max_steps": 1}))
    assert again.added == ()


@pytest.mark.slow
def test_a_single_flight_takes_what_is_shared(result: Trace) -> None:
    predicted = predict(flight(1), result.model.definition, ("trim",))
    assert {term.name for term in predicted.refitted} == {"C_m0", "C_n0"}
    np.testing.assert_allclose([t.value for t in predicted.refitted], TRIMS[1], atol=0.15 * 1.2e-3)
    error = predicted.error
    assert error.frozen - error.noise < 0.05 * (error.without - error.noise)


@pytest.mark.slow
def test_a_delay_of_several_flights_is_found_between_the_points_of_its_grid() -> None:
    delay = {"delay": 0.055}
    lag = PlantedConfig(mechanism="lag", theta=delay, terms={"lag fraction": 0.03}, kind="constant")
    data = load_config("research_cone").model_dump() | {"sample_rate": SAMPLE_RATE_HZ, "step": STEP_S}
    config = SimulationConfig.model_validate(data | {"mechanisms": (lag,)})
    source = Flights(tuple(simulate(another_flight(config, k), seed=30 + k).flight for k in range(2)), QUICK)
    _, (candidate,) = analyse_step(converged(source, start_model(source)), [find("lag")], ())
    (found,) = {value for column in candidate.fit.selected for _, value in column.theta}
    assert found == pytest.approx(delay["delay"], rel=0.1)


@pytest.mark.slow
def test_one_flight_in_a_sequence_is_that_flight() -> None:
    alone, listed = traced_trim(), trace([trimmed().flight], ONE_EFFECT)
    assert alone.model_dump(exclude={"seconds"}) == listed.model_dump(exclude={"seconds"})
