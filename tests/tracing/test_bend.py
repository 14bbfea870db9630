"""A static moment that bends with the angle of attack: part of the loop's baseline, within what bodies do."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms import find
from brv_hypo.mechanisms.conformance import sample_motion, uniform_time
from brv_hypo.mechanisms.yaml_mechanism import Factor, YamlMechanism, YamlTerm
from brv_hypo.model.aero_table import AeroTable
from brv_hypo.model.baseline import StaticBend
from brv_hypo.model.model import Model, model_text, read_model, restored
from brv_hypo.prediction import predict
from brv_hypo.simulation import SimulationConfig, load_config, simulate
from brv_hypo.tracing import Trace, TraceConfig, trace
from brv_hypo.tracing.baseline import has_schedule, is_bend, start_model
from brv_hypo.tracing.fit import Flights
from tests.flights import SAMPLE_RATE_HZ, STEP_S, nominal
from tests.studies.loop.planting import another_flight

# 1/rad^3: a fifth of the static moment at the 4 degrees that the cone turns to, less than two sigma of the prior.
BEND = -4.0
MAGNUS = -6.0
OTHERS = ("magnus", "stiffness_asymmetry", "inplane", "damping")


def bent_cone(**beside: float) -> SimulationConfig:
    """The research cone with a bend, and a Magnus moment where one is given."""
    planted = {"cubic_stiffness": {"C_malpha3": BEND}, **({"magnus": beside} if beside else {})}
    data = load_config("research_cone").model_dump() | {"sample_rate": SAMPLE_RATE_HZ, "step": STEP_S}
    data["mechanisms"] = tuple(
        {"mechanism": name, "terms": terms, "kind": "constant"} for name, terms in planted.items()
    )
    return SimulationConfig.model_validate(data)


@cache
def bent() -> Flight:
    return simulate(bent_cone(), seed=11).flight


@cache
def traced(*effects: str, magnus: bool = False) -> Trace:
    flight = simulate(bent_cone(C_npalpha=MAGNUS), seed=12).flight if magnus else bent()
    return trace(flight, TraceConfig(effects=effects, discover=False, max_steps=2))


def bend_of(result: Trace) -> tuple[float, float]:
    term = next(term for term in result.model.terms if term.name == "C_malpha3")
    return term.value, term.std_error


def model_of(flight: Flight, aero: AeroTable | None = None, fixed: tuple[str, ...] = ()) -> Model:
    return start_model(Flights((flight,), TraceConfig(aero=aero)), [find(name) for name in fixed])


@pytest.mark.thorough
def test_a_vehicle_whose_moment_bends_needs_no_effect() -> None:
    found = traced(*OTHERS)
    assert found.added == ()
    value, error = bend_of(found)
    assert abs(value - BEND) < 4.0 * error
    assert error < 0.2 * abs(BEND)


@pytest.mark.slow
def test_an_effect_beside_the_bend_is_found() -> None:
    found = traced(*OTHERS, magnus=True)
    assert found.findings == ("magnus",)
    assert abs(bend_of(found)[0] - BEND) < 4.0 * bend_of(found)[1]


@pytest.mark.slow
def test_the_bend_is_named_where_its_name_is_offered() -> None:
    found = traced("magnus", "cubic_stiffness")
    assert found.findings == ("cubic_stiffness",)
    assert abs(bend_of(found)[0] - BEND) < 4.0 * bend_of(found)[1]
    assert StaticBend.name not in {column.mechanism for column in found.model.definition.columns}


@pytest.mark.slow
def test_a_moment_in_proportion_is_not_said_to_bend() -> None:
    settings = TraceConfig(effects=("cubic_stiffness",), discover=False, max_steps=1)
    assert trace(nominal().flight, settings).added == ()


@pytest.mark.slow
def test_the_saved_model_predicts_a_sister_by_its_bend(tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("bent") / "model.yaml"
    path.write_text(model_text(traced(*OTHERS).model.definition), encoding="utf-8")
    model = read_model(path)
    sister = simulate(another_flight(bent_cone(), 4), seed=13).flight
    fixed = predict(sister, model)
    assert "C_malpha3" in {term.name for term in fixed.frozen}
    columns = tuple(c.model_copy(update={"value": 0.0}) if c.mechanism == StaticBend.name else c for c in model.columns)
    without = predict(sister, model.model_copy(update={"columns": columns}))
    assert fixed.error.frozen < 1.05 * fixed.error.own
    assert without.error.frozen > 2.0 * fixed.error.frozen


@pytest.mark.thorough
def test_a_structure_estimates_it_anew_and_a_frozen_model_has_it_as_a_column() -> None:
    definition = traced(*OTHERS).model.definition
    flight = bent()
    anew, frozen = (restored(definition, (flight,), frozen=known) for known in (False, True))
    assert anew.mechanisms[StaticBend.name] == definition.bend
    for model, known in ((anew, False), (frozen, True)):
        assert any(column.mechanism == StaticBend.name for column in model.columns) is known
        assert any(mechanism.name == StaticBend.name for mechanism in model.tolerated(flight)) is not known


def test_a_bend_is_no_schedule() -> None:
    model = model_of(nominal().flight)
    assert StaticBend.name in model.mechanisms
    assert not has_schedule(model)


@pytest.mark.parametrize(
    ("alphas", "expected"), [((0.0,), True), ((0.0, 0.2), False)], ids=["by Mach number", "by angle of attack too"]
)
def test_a_table_by_angle_of_attack_says_how_it_bends(alphas: tuple[float, ...], expected: bool) -> None:
    rows = tuple(tuple(value for _ in alphas) for value in (-0.09, -0.09))
    errors = tuple(tuple(0.01 for _ in alphas) for _ in rows)
    table = AeroTable(mach=(10.0, 25.0), alpha=alphas, slope=rows, std_error=errors)
    model = model_of(nominal().flight, table)
    assert (StaticBend.name in model.mechanisms) is expected
    if expected:
        assert model.mechanisms[StaticBend.name] == StaticBend(slope=-0.09)


def test_a_fixed_term_of_the_start_has_no_prior_beside_it() -> None:
    assert StaticBend.name not in model_of(nominal().flight, fixed=("cubic_stiffness",)).mechanisms


@pytest.mark.parametrize(("name", "expected"), [("cubic_stiffness", True), ("magnus", False), ("inplane", False)])
def test_a_name_for_the_bend_is_known_by_its_moment(name: str, expected: bool) -> None:
    assert is_bend(find(name), sample_motion(uniform_time())) is expected


@pytest.mark.parametrize(("power", "expected"), [(3, True), (2, False)])
def test_a_file_may_name_it_too(power: int, expected: bool) -> None:
    term = YamlTerm(name="a", axis="in_plane", factors=(Factor(of="alpha", power=power),))
    motion = sample_motion(uniform_time())
    assert is_bend(YamlMechanism(definition=(term,)), motion) is expected
    assert np.any(motion.alpha)
