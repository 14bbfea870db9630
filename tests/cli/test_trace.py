"""`brv-hypo trace`: the contract's JSON, the page, and the model that it starts from."""

from __future__ import annotations

import json

import pytest

from brv_hypo.cli.analyses import starting_model
from brv_hypo.cli.session import Session
from brv_hypo.errors import UsageError
from brv_hypo.tracing import TraceConfig
from tests.chains import ONE_EFFECT, traced_trim, trimmed

STEP_KEYS = "step residual candidates added error_before error_after error_ratio_held_out"
RESIDUAL_KEYS = "rms white p_value worst_channel worst_region_s dominant_frequency_hz"
CANDIDATE_KEYS = "effect kind f_ratio p_value_adjusted explains"

FLIGHT = """
base: research_cone
title: short
duration: 3.0
sample_rate: 100.0
step: 0.01
mechanisms: [{mechanism: trim, terms: {C_m0: 1.0e-3, C_n0: -6.0e-4}, kind: constant}]
"""
CONFIG = "effects: [trim]\nmax_steps: 1\ndiscover: false\n"


def known(flights, settings, **_):
    """In the place of `trace`: what it finds in this flight with these settings."""
    assert [flight.samples for flight in flights] == [trimmed().flight.samples]
    assert settings == ONE_EFFECT
    return traced_trim()


@pytest.fixture(
    scope="module",
    params=[pytest.param("known", marks=pytest.mark.thorough), pytest.param("found", marks=pytest.mark.slow)],
)
def traced(request, brv_hypo, tmp_path_factory):
    """The trace of a flight with a planted trim: the finished command, its JSON and its report.

    With `known` the trace is precomputed: the command reads flight and settings, and reports it.
    """
    folder = tmp_path_factory.mktemp("traced")
    (folder / "config.yaml").write_text(CONFIG)
    (folder / "flight.yaml").write_text(FLIGHT)
    files = ("--json", folder / "out.json", "--report", folder / "out.html")
    with pytest.MonkeyPatch.context() as patch:
        if request.param == "known":
            trimmed().save(folder / "flight.h5")
            patch.setattr("brv_hypo.tracing.trace", known)
        else:
            assert brv_hypo("simulate", folder / "flight.yaml", "-o", folder / "flight.h5").returncode == 0
        done = brv_hypo("trace", folder / "flight.h5", "--config", folder / "config.yaml", *files)
    assert done.returncode == 0, done.stderr
    assert request.param == "known" or "Found: trim" in done.stdout
    return done, json.loads((folder / "out.json").read_text()), (folder / "out.html").read_text()


def test_json_follows_the_contract(traced):
    result = traced[1]
    assert result["schema"] == "brv-hypo/trace/1"
    assert result["stopped"] in ("white", "nothing significant", "nothing improves held-out error", "limit")
    for step in result["steps"]:
        assert set(STEP_KEYS.split()) <= set(step)
        assert set(RESIDUAL_KEYS.split()) <= set(step["residual"])
        assert all(set(CANDIDATE_KEYS.split()) <= set(candidate) for candidate in step["candidates"])
        assert set(step["error_before"]) == {"fit", "held_out"}
    assert result["model"]["terms"]


def test_the_json_holds_a_model_that_another_trace_starts_from(traced, tmp_path):
    path = tmp_path / "model.json"
    path.write_text(json.dumps(traced[1]))
    start = starting_model(path, Session())["start"]
    assert {column.mechanism for column in start.columns} >= {"trim"}
    assert TraceConfig(start=start).start == start


def test_instruments_of_a_comparison_are_said_to_be_found_anew(tmp_path, capsys):
    path = tmp_path / "model.json"
    ranked = {"mechanism": "lag", "ml": {"instrument": [{"name": "gyro bias p"}]}}
    path.write_text(json.dumps({"schema": "brv-hypo/compare/1", "verdict": {"winner": "lag"}, "ranking": [ranked]}))
    assert starting_model(path, Session())["start"] == "lag"
    assert "estimated anew: 1 error of the record" in capsys.readouterr().err


def test_prints_what_was_added_and_the_error_before_and_after(traced):
    found = ", ".join(traced[1]["findings"]) or "nothing"
    for expected in ("Step 1", "added trim", "held out", f"Found: {found}"):
        assert expected in traced[0].stdout


def test_the_report_shows_moments_and_residual(traced):
    assert traced[2].count('class="chart"') == 12
    assert "Moments, measured and modelled" in traced[2]
    assert "Residual moments" in traced[2]


@pytest.mark.parametrize(
    ("content", "hypothesis"),
    [
        ({"schema": "brv-hypo/compare/1", "verdict": {"winner": "lag"}, "ranking": []}, "lag"),
        (
            {"schema": "brv-hypo/compare/1", "verdict": {"winner": None}, "ranking": [{"mechanism": "lag+trim"}]},
            "lag+trim",
        ),
    ],
)
def test_a_model_starts_with_its_mechanisms(tmp_path, content, hypothesis):
    path = tmp_path / "model.json"
    path.write_text(json.dumps(content))
    assert starting_model(path, Session()) == {"start": hypothesis, "columns": ()}


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"schema": "other/1"}', '{"schema": "brv-hypo/trace/1"}'])
def test_what_is_no_model_is_refused(tmp_path, text):
    path = tmp_path / "model.json"
    path.write_text(text)
    with pytest.raises(UsageError, match=r"model|expected"):
        starting_model(path, Session())


def test_a_missing_model_is_refused(tmp_path):
    with pytest.raises(UsageError, match="cannot be read"):
        starting_model(tmp_path / "nowhere.json", Session())


@pytest.mark.slow
def test_several_flights_and_the_model_as_a_file(brv_hypo, simulated_file, tmp_path):
    (tmp_path / "config.yaml").write_text("effects: [magnus]\nmax_steps: 1\ndiscover: false\n")
    files = ("--json", tmp_path / "out.json", "--write-model", tmp_path / "model.yaml")
    done = brv_hypo("trace", simulated_file, simulated_file, "--config", tmp_path / "config.yaml", *files)
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "out.json").read_text())
    assert len(result["flights"]) == 2
    outputs = ("--json", tmp_path / "predicted.json", "--report", tmp_path / "predicted.html")
    model = ("--model", tmp_path / "model.yaml", "--refit", "trim,instruments")
    done = brv_hypo("predict", simulated_file, *model, *outputs)
    assert done.returncode == 0, done.stderr
    predicted = json.loads((tmp_path / "predicted.json").read_text())
    assert set(predicted["band"]) >= {"level", "inside", "time_s", "measured", "predicted", "half_width"}
    assert "predictive band" in (tmp_path / "predicted.html").read_text()
