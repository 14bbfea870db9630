from __future__ import annotations

import json
from dataclasses import replace
from importlib import import_module
from typing import Any

import numpy as np
import pytest

from brv_hypo.errors import UnanswerableError, UsageError
from brv_hypo.flight import load_flight
from brv_hypo.flight.record import Flight
from brv_hypo.io.text import share
from brv_hypo.mechanisms.contract import FAMILIES
from brv_hypo.report.document import Bars, Line, Table, Texts, flat
from brv_hypo.report.figures import chart_figure
from brv_hypo.report.html import plotly_chart
from brv_hypo.report.tables import COLLINEAR_MARK
from brv_hypo.report.trace import families_chart, families_text, next_data, outcome_text, trace_document
from brv_hypo.simulation import load_config, simulate
from brv_hypo.simulation.config import PlantedConfig, SimulationConfig
from brv_hypo.tracing import Trace, TraceConfig, trace
from brv_hypo.tracing.baseline import start_model
from brv_hypo.tracing.fit import Flights, converged
from brv_hypo.tracing.result import Family, names_added
from tests.chains import ONE_EFFECT, traced_trim, trimmed_cone
from tests.flights import nominal
from tests.shared_data import shared_file
from tests.studies.comparison.benchmark import finer

trace_module = import_module("brv_hypo.tracing.trace")

STOPS = {"white", "nothing significant", "nothing improves held-out error", "limit"}


def planted(mechanism: str, terms: dict[str, float]) -> SimulationConfig:
    entry = PlantedConfig(mechanism=mechanism, terms=terms, kind="constant")
    return load_config("research_cone").model_copy(update={"mechanisms": (entry,)})


def instrument(effect: str, component: str, value: float) -> SimulationConfig:
    data = load_config("research_cone").model_dump()
    data["instruments"]["errors"] = {effect: {component: value}}
    return SimulationConfig.model_validate(data)


# What tactical tolerances allow is no effect: the trim is of 7 mm, the scale of 20 tolerances. The asymmetry is so
# large that its effect exceeds the noise of held-out blocks.
CASES = {
    "trim": planted("trim", {"C_m0": 1e-3, "C_n0": -6e-4}),
    "magnus": planted("magnus", {"C_npalpha": -1.0}),
    "stiffness_asymmetry": planted("stiffness_asymmetry", {"pitch-yaw": 8e-4, "diagonal": 4e-4}),
    "gyro_scale": instrument("gyro_scale", "p", 1e-2),
}


@pytest.fixture(scope="module")
def clean() -> Trace:
    return trace(nominal().flight, TraceConfig())


@pytest.mark.thorough
def test_a_flight_with_nothing_missing_adds_nothing(clean: Trace) -> None:
    assert clean.added == ()
    assert clean.stopped in ("white", "nothing significant")
    assert clean.steps[-1].error_before.held_out < 1.2 * clean.noise


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_names_what_was_planted_and_ends_at_the_noise(name: str) -> None:
    result = trace(simulate(CASES[name], seed=12).flight, TraceConfig(max_steps=2))
    step = result.steps[0]
    assert step.candidates[0].effect == name
    assert step.added == name
    assert step.error_after is not None
    assert step.error_ratio_held_out is not None
    # Fixed at zero, what has a tolerance is partly absorbed by what else has one.
    tolerated = name in ("trim", "gyro_scale")
    assert step.error_ratio_held_out < (1.2 if tolerated else 1.0)
    assert step.error_after.held_out < 1.2 * result.noise


@pytest.mark.thorough
def test_the_dump_is_the_contracts_json(clean: Trace) -> None:
    content = json.loads(clean.model_dump_json(by_alias=True))
    assert content["schema"] == "brv-hypo/trace/1"
    assert content["stopped"] in STOPS
    step = content["steps"][0]
    assert set(step) >= {
        "step", "residual", "candidates", "added", "error_before", "error_after", "error_ratio_held_out",
    }  # fmt: skip
    assert set(step["residual"]) >= {
        "rms", "white", "p_value", "worst_channel", "worst_region_s", "dominant_frequency_hz",
    }  # fmt: skip
    assert set(step["candidates"][0]) >= {"effect", "kind", "f_ratio", "p_value_adjusted", "explains"}
    assert {"picture", "discovered"}.isdisjoint(content)


def test_an_unknown_effect_is_refused() -> None:
    with pytest.raises(UsageError, match="did you mean magnus"):
        trace(nominal().flight, TraceConfig(effects=("magnos",)))


@pytest.mark.parametrize("seconds", [0.3, 2.0])
def test_a_record_too_short_is_refused(seconds: float) -> None:
    flight = nominal().flight.window(1.0, 1.0 + seconds)
    with pytest.raises(UnanswerableError, match="too few"):
        trace(flight)


@pytest.mark.thorough
def test_the_shortest_record_is_traced_with_fewer_blocks_where_repeated() -> None:
    """Blocks of 8.2 samples; a quarter more of them would be too short to be held out."""
    short = CASES["magnus"].model_copy(update={"sample_rate": 50.0, "duration": 261 / 50.0, "step": 0.02})
    magnus = short.mechanisms[0].model_copy(update={"terms": {"C_npalpha": -30.0}})
    flight = simulate(short.model_copy(update={"mechanisms": (magnus,)}), seed=1).flight
    result = trace(flight, effects=("magnus", "lag"), max_steps=1)
    assert result.steps[0].named_in == 1.0


@pytest.mark.shared
@pytest.mark.slow
def test_opportunity_needs_stiffness_that_changes_with_the_mach_number() -> None:
    """From constant stiffness; its residual is explained by the trace in the manual."""
    flight = load_flight(shared_file("data/opportunity/opportunity_entry.h5"))
    result = trace(flight, TraceConfig(baseline="constant", max_steps=1))
    assert result.findings == ("mach_stiffness",)
    (step,) = result.steps
    assert step.error_ratio_held_out is not None
    assert step.error_ratio_held_out < 0.02
    assert result.unexplained is not None


def test_a_record_far_finer_than_its_motion_is_traced_as_means_of_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    traced: list[Flight] = []
    result = traced_trim()

    def begun(source: Flights, *_: Any) -> Trace:
        traced.extend(source.records)
        return result

    monkeypatch.setattr(trace_module, "_trace", begun)
    trace(finer(nominal().flight, 24_001), TraceConfig())
    assert traced[0].samples < 6_000
    assert "means of" in traced[0].notes[-1]


def test_a_record_that_contradicts_itself_is_traced_and_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    """A rate gyro with the wrong sign; the trial is of the record as it is, whatever the trace makes of it."""
    result = traced_trim()
    monkeypatch.setattr(trace_module, "_trace", lambda *_: result)
    flight = nominal().flight
    assert trace(flight).record.sound
    wrong = trace(replace(flight, q=-flight.q)).record
    assert not wrong.sound
    assert any("q" in fault.channel for fault in wrong.faults)


def test_what_a_trace_found_and_what_families_explain_is_one_sentence() -> None:
    """No "No effect was found" before shares of the residual; steps before the answer."""
    traced = traced_trim()
    family = Family(family="body", share=0.83, interval_95=(0.7, 0.9), evidence=200.0, process="own_drift")
    small = Family(family="air", share=0.02, interval_95=(0.0, 0.05), evidence=300.0)
    residual = traced.steps[0].residual.model_copy(update={"white": False})
    first = traced.steps[0].model_copy(update={"decomposition": (family, small), "residual": residual})
    shares = "body 83 % (70 to 90 %, mostly own_drift)."
    for findings, said in (
        ((), f"No effect with a name was found; families of processes explain the residual: {shares}"),
        (
            ("trim",),
            f"With trim, the held-out error is {share(traced.steps[0].error_ratio_held_out)} of what it is without.",
        ),
    ):
        document = trace_document(traced.model_copy(update={"findings": findings, "steps": (first,)}))
        assert document.conclusion.splitlines()[0] == said
    texts = [text for block in flat(document.blocks) if isinstance(block, Texts) for text in block.texts]
    assert f"By family, largest share first: {shares[:-1]}; not surely above 0.5 %: air 2 %." in texts
    assert "Evidence of each beside all others, largest first: air 300 nats, body 200 nats." in texts
    noise = first.model_copy(update={"residual": residual.model_copy(update={"white": True})})
    of_noise = trace_document(traced.model_copy(update={"findings": (), "steps": (noise,)}))
    assert of_noise.conclusion.splitlines()[0] == "No effect with a name was found."
    assert document.ahead == ()


def test_where_nothing_is_added_the_next_step_is_said() -> None:
    """Once a trace without a name ended there; a family that explains most is to be studied, unless the residual is
    noise."""
    traced = traced_trim()
    residual = traced.steps[0].residual.model_copy(update={"white": False})
    update = {"decomposition": (Family(family="gyros", share=0.8, interval_95=(0.7, 0.9)),), "residual": residual}
    step = traced.steps[0].model_copy(update={**update, "added": None})
    said = "To go on: gyros first, by rates where no air acts, and the gyros as calibrated."
    assert next_data(step) == said
    assert said in trace_document(traced.model_copy(update={"steps": (step,), "findings": ()})).conclusion
    assert next_data(step.model_copy(update={"decomposition": ()})) == ""
    assert next_data(traced.steps[0].model_copy(update={"residual": residual.model_copy(update={"white": True})})) == ""


def test_every_family_has_data_that_would_identify_it() -> None:
    step = traced_trim().steps[0]
    residual = step.residual.model_copy(update={"white": False})
    for name in FAMILIES:
        own = (Family(family=name, share=0.8, interval_95=(0.7, 0.9)),)
        assert name in next_data(step.model_copy(update={"residual": residual, "decomposition": own}))


def test_a_further_part_of_what_was_found_is_a_hint_and_ramps_are_in_its_table() -> None:
    """Once a finding with a ramp had no table, and what was added to it as a hint was in no list."""
    traced = traced_trim()
    step = traced.steps[0]
    steps = (step, step.model_copy(update={"status": "hint"}))
    assert (names_added(steps, "finding"), names_added(steps, "hint")) == (("trim",), ("trim",))
    terms = [each.model_copy(update={"name": f"ramp in {each.name}"}) for each in traced.model.terms]
    model = traced.model.model_copy(update={"terms": tuple(terms)})
    both = traced.model_copy(update={"findings": ("trim",), "hints": ("trim",), "model": model})
    assert "Hints, no findings: trim (a further part)." in trace_document(both).conclusion
    tables = [block for block in flat(trace_document(both).beside) if isinstance(block, Table)]
    assert [row["term"] for row in tables[0].rows] == ["ramp in C_m0", "ramp in C_n0"]


def test_what_was_found_in_parts_has_the_ratio_of_all_of_them() -> None:
    traced = traced_trim()
    steps = tuple(traced.steps[0].model_copy(update={"error_ratio_held_out": ratio}) for ratio in (0.2, 0.5))
    document = trace_document(traced.model_copy(update={"findings": ("trim",), "steps": steps}))
    assert document.conclusion.splitlines()[0] == "With trim, the held-out error is 10 % of what it is without."


@pytest.mark.thorough
def test_a_trim_beyond_its_tolerance_is_found_where_the_rest_is_noise() -> None:
    """Processes without evidence explain some of the noise: once "the model is inadequate"."""
    result = trace(simulate(trimmed_cone((-3e-4, 2.5e-4)), seed=3), ONE_EFFECT)
    assert result.findings == ("trim",)
    step = result.steps[0]
    assert step.error_after is not None
    assert step.error_ratio_held_out < 0.5 * step.error_after.held_out / step.error_before.held_out
    assert result.final_residual is not None
    assert result.final_residual.noise_ratio < 1.2**0.5


def test_the_chart_of_families_marks_those_that_the_text_is_not_sure_of() -> None:
    surely = Family(family="body", share=0.83, interval_95=(0.7, 0.9))
    doubtful = Family(family="air", share=0.02, interval_95=(0.0, 0.05))
    step = traced_trim().steps[0].model_copy(update={"decomposition": (surely, doubtful)})
    chart = families_chart(step)
    bars = [(layer.names, layer.role, layer.name) for layer in chart.panels[0].layers if isinstance(layer, Bars)]
    rest = (["noise, lack of fit 15 %"], "measured", "")
    assert bars == [
        (["body 83 %"], "second", "surely above 0.5 %"),
        (["air 2 %"], "none", "not surely above 0.5 %"),
        rest,
    ]
    drawn, names = plotly_chart(chart), ["body 83 %", "air 2 %", *rest[0]]
    assert [trace["name"] for trace in drawn["traces"] if trace["showlegend"]] == [bars[0][2], bars[1][2]]
    assert [text.get_text() for text in chart_figure(chart).axes[0].get_yticklabels()] == names
    body, ends = drawn["traces"][0], [surely.interval_95[0], surely.interval_95[1]]
    error = body["error_x"]
    low, high = body["x"][0] - error["arrayminus"][0], body["x"][0] + error["array"][0]
    assert [low, high] == pytest.approx([100.0 * end for end in ends])
    assert drawn["layout"]["xaxis"]["range"][1] > high
    assert sum(layer.values[0] for layer in chart.panels[0].layers) == pytest.approx(100.0)


def test_candidates_are_listed_by_their_f_ratio() -> None:
    step = traced_trim().steps[0]
    one = step.candidates[0].model_copy(update={"near_equals": ()})
    tried = [one.model_copy(update={"effect": name, "f_ratio": f}) for name, f in (("a", 2.0), ("b", 7.0), ("c", 5.0))]
    first = step.model_copy(update={"candidates": tuple(tried), "added": "c"})
    document = trace_document(traced_trim().model_copy(update={"steps": (first,)}))
    (table,) = (each for each in flat(document.blocks) if isinstance(each, Table) and "by F-ratio" in each.heading)
    assert [row["effect"] for row in table.rows] == ["b", "c", "a"]
    assert list(table.marked) == [1]


def test_before_and_after_are_drawn_where_something_was_added() -> None:
    traced = traced_trim()
    nothing = traced.model_copy(update={"steps": (traced.steps[0].model_copy(update={"added": None}),)})
    for result, names in ((traced, {"before", "after"}), (nothing, {"residual"})):
        chart = next(chart for chart in trace_document(result).charts if chart.name == "residuals")
        assert {layer.name for panel in chart.panels for layer in panel.layers if isinstance(layer, Line)} == names


def test_a_hint_is_followed_by_what_to_do_next() -> None:
    said = trace_document(traced_trim().model_copy(update={"hints": ("trim",), "findings": ()})).conclusion
    rivals = "bodyfixed,damping,inplane,lag,sticking,trim"
    assert f"Hints, no findings: trim. To go on: `brv-hypo compare FLIGHT.h5 --mechanisms {rivals}` weighs it" in said
    assert "`brv-hypo predict OTHER.h5 --model MODEL.yaml`" in said


def test_what_is_nearly_collinear_points_to_where_its_values_are() -> None:
    (found,) = traced_trim().damping
    beside = found.model_copy(update={"collinear_with": {"two_lobes": (0.999,) * len(found.time_s)}})
    said = trace_document(traced_trim().model_copy(update={"damping": (beside,)})).conclusion
    (line,) = (line for line in said.splitlines() if line.startswith("C_mq is nearly collinear with two_lobes"))
    assert "Its values there and their errors (coefficients along the flight: -v, and on the page) hold only" in line


def test_a_step_says_nothing_twice() -> None:
    """No candidates of a white residual, no residual of the last step again, no interval of no width, no name twice."""
    traced = traced_trim()
    last = traced.steps[-1].model_copy(update={"added": None})
    white = last.model_copy(update={"residual": last.residual.model_copy(update={"white": True})})
    family = Family(family="side", share=1.0, interval_95=(1.0, 1.0))
    assert families_text(white.model_copy(update={"decomposition": (family,)})) == "side 100 %"
    account = tuple(traced.account[0].model_copy(update={"model": name}) for name in ("constant", "trim", "trim"))
    document = trace_document(traced.model_copy(update={"steps": (white,), "account": account}))
    blocks = list(flat((*document.beside, *document.blocks)))
    tables = [block for block in blocks if isinstance(block, Table)]
    assert {block.shown for block in tables if block.headings[:2] == ("effect", "kind")} == {"verbose"}
    assert "Final residual" not in {block.heading for block in blocks}
    rows = next(block.rows for block in tables if block.headings[:1] == ("model",))
    assert [row["model"] for row in rows] == ["constant", "trim, part 1", "trim, part 2", "noise alone"]


@pytest.mark.thorough
def test_errors_of_terms_have_what_processes_make_of_them() -> None:
    """The model's file has the same ones, `predict` too: two sigmas of one coefficient differed sevenfold."""
    model = traced_trim().model
    whole, alone = map(np.diag, model.definition.known_covariance)
    stated = np.array([term.std_error for term in model.terms[: alone.size]])
    np.testing.assert_allclose(stated, np.sqrt(whole))
    assert np.all(whole >= alone)
    assert whole[0] > 1.01 * alone[0]


def test_the_largest_channel_and_place_are_over_the_noise_there() -> None:
    """Where it was thin, a large residual of noise was called the worst; a small one of an effect was not."""
    flight = nominal().flight
    source = Flights((flight,), TraceConfig())
    fit = converged(source, start_model(source))
    rows = np.arange(fit.left.body.size)
    late = rows > 0.9 * rows.size
    noise = np.where(late, 100.0, 1.0)
    left = replace(fit.left, body=np.where(late, 20.0j, 1.0 + 0.0j), noise=noise, usable=np.ones(rows.size, dtype=bool))
    other = replace(fit)
    vars(other)["left"] = left
    vars(other)["rest"] = fit.rest
    assert other.residual.worst_channel == "C_m"
    assert other.residual.worst_region_s[1] < flight.time[-1]


def test_the_values_of_a_step_are_said_to_be_of_that_step() -> None:
    step = traced_trim().steps[0]
    assert step.description
    assert f"added trim (values of this step, not of the final model: {step.description})" in outcome_text(step)


@pytest.mark.thorough
def test_what_is_collinear_is_marked_where_it_is_quoted() -> None:
    """The table of what was found had no mark; on several flights no label was that of the terms."""
    traced = traced_trim()
    pair = tuple(term.begins for term in traced.model.terms if term.mechanism == "trim")
    document = trace_document(traced.model_copy(update={"findings": ("trim",), "collinear_groups": (pair,)}))
    (found,) = (block for block in document.beside if isinstance(block, Table) and block.heading.startswith("What was"))
    assert all(COLLINEAR_MARK in row["value"] for row in found.rows)


@pytest.mark.thorough
def test_a_final_value_beyond_its_mechanisms_bounds_is_said() -> None:
    """The step's doubt had the step's value, 1.77; of the final one nothing was said."""
    planted = {"mechanism": "lag", "terms": {"lag fraction": 1.6}, "theta": {"delay": 0.03}, "start": 2.0, "stop": 3.2}
    flight = simulate("research_cone", seed=3, sample_rate=100.0, mechanisms=[planted])
    found = trace(flight, effects=("lag",), discover=False, max_steps=1)
    assert found.hints == ("lag",)
    said = "lag is beyond what is possible: lag fraction = 1.6 from 2.00 to 3.20 s, where 0 to 1 is possible"
    assert found.caveats[0] == said
