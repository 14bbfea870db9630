"""`brv-hypo config`: what it writes is read by the command that it is for; schemas and completion."""

from __future__ import annotations

import json
import re
from pydoc import locate

import pytest
import yaml

from brv_hypo import reconstruct, simulate
from brv_hypo.comparison import CompareConfig
from brv_hypo.docs import text
from brv_hypo.docs.manual import RESULTS, generated
from brv_hypo.errors import UsageError
from brv_hypo.flight.inspection import inspect_flight
from brv_hypo.flight.record import CHANNEL_DIMENSIONS, VEHICLE_DIMENSIONS, RecordTrial
from brv_hypo.flight.tolerances import instruments_from, of_grade
from brv_hypo.importing.formats import Layout
from brv_hypo.importing.record_map import RecordMap, read_map
from brv_hypo.mechanisms import installed
from brv_hypo.motion import ReconstructionConfig
from brv_hypo.report.listings import inspection_data, listing_data, simulation_data
from brv_hypo.report.reconstruction import reconstruction_data
from brv_hypo.settings import commented, settings_of
from brv_hypo.simulation import load_config
from brv_hypo.study import read_study
from brv_hypo.tracing import TraceConfig

MODELS = {"compare": CompareConfig, "trace": TraceConfig, "reconstruct": ReconstructionConfig}


@pytest.mark.parametrize(("kind", "model"), MODELS.items())
def test_a_new_file_sets_nothing_until_it_is_changed(brv_hypo, kind, model, tmp_path):
    done = brv_hypo("config", "new", kind, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    path = tmp_path / f"{kind}.yaml"
    assert settings_of(model, path) == model()
    assert f"--config {kind}.yaml" in done.stdout


@pytest.mark.parametrize("model", MODELS.values())
def test_settings_are_an_object_a_mapping_or_a_file(model, tmp_path):
    path = tmp_path / "s.yaml"
    path.write_text("{}\n")
    given = model()
    assert settings_of(model, given) is given
    assert all(settings_of(model, source) == given for source in (None, {}, path, str(path)))


@pytest.mark.parametrize(
    ("source", "said"), [({"mechanism": ["lag"]}, "is 'mechanisms' meant"), (3, "type int, expected a CompareConfig")]
)
def test_settings_that_are_none_are_refused_in_words(source, said):
    with pytest.raises(UsageError, match=said):
        settings_of(CompareConfig, source)


@pytest.mark.parametrize("model", MODELS.values())
def test_every_setting_is_in_it_and_uncommented_is_the_default(model):
    settings = [line[1:] for line in commented(model, "t").splitlines() if line.startswith("#") and line[1:2] != " "]
    content = yaml.safe_load("\n".join(settings))
    assert set(content) == set(model.model_fields)
    assert model.model_validate(content) == model()


@pytest.mark.parametrize("model", MODELS.values())
def test_every_setting_is_explained(model):
    assert [name for name, field in model.model_fields.items() if not field.description] == []


@pytest.mark.parametrize("command", ["compare", "trace", "predict", "study"])
def test_every_key_of_a_result_is_explained(command):
    schema = locate(f"brv_hypo.{RESULTS[command]}").model_json_schema(by_alias=True, mode="serialization")
    parts = {command: schema, **schema["$defs"]}
    unexplained = [
        (t, key)
        for t, part in parts.items()
        for key, field in part["properties"].items()
        if not field.get("description")
    ]
    assert unexplained == []
    page = generated("results")
    assert all(f"\n## {title}\n" in page for title in parts)
    assert [key for key in schema["properties"] if f"| `{key}` | " not in page] == []


def test_every_key_of_other_json_is_in_the_reference(tmp_path):
    flown = simulate("research_cone", seed=1, plant="lag", duration=1.0)
    written = [
        reconstruction_data(reconstruct(flown)),
        simulation_data(flown, tmp_path),
        inspection_data(inspect_flight(flown.flight), RecordTrial()),
        listing_data({name: installed()[name] for name in ("lag", "gyro_drift")}, {}),
    ]
    nested = [written[0]["reconstruction"], written[1]["planted_share"], written[3]["mechanisms"][1]]
    keys = {key for each in (*written, *nested) for key in each} - {"schema", "flight"}
    assert sorted(key for key in keys if f"`{key}`" not in text("reference")) == []


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"maximum_likelihood": "quik"}, r"expected 'quick', 'full' or 'none' \(is 'quick' meant\?\), got 'quik'"),
        ({"knot_count": "many"}, "'knot_count': expected a valid integer, got 'many'"),
    ],
)
def test_a_wrong_value_is_refused_in_plain_words(settings, said):
    with pytest.raises(UsageError, match=said):
        settings_of(CompareConfig, settings)


def test_a_setting_of_a_section_is_sent_there():
    with pytest.raises(UsageError, match="'draw' is not a known key \\(it is a key of `instruments`\\)"):
        load_config("research_cone", keywords={"draw": 1})


def test_a_new_simulation_and_study_are_read(brv_hypo, tmp_path):
    for kind in ("simulate", "study"):
        assert brv_hypo("config", "new", kind, "-o", f"my_{kind}.yaml", cwd=tmp_path).returncode == 0
    assert load_config(tmp_path / "my_simulate.yaml").duration > 0.0
    assert read_study(tmp_path / "my_study.yaml").flights > 0


def test_a_new_map_has_every_key_and_is_read(brv_hypo, tmp_path):
    """As it is, and with what is optional in use."""
    assert brv_hypo("config", "new", "import", cwd=tmp_path).returncode == 0
    text = (tmp_path / "import.yaml").read_text()
    content = yaml.safe_load(re.sub(r"(?m)^( *)# ( *(?:- \{|\w+:))", r"\1\2", text))
    assert set(content) == set(RecordMap.model_fields) - set(Layout.model_fields)
    assert {*content["channels"], "reynolds"} == set(CHANNEL_DIMENSIONS)
    assert set(content["vehicle"]) == set(VEHICLE_DIMENSIONS)
    for each in (yaml.safe_load(text), content):
        assert read_map(each).planet == "earth"


def test_tolerances_that_come_along_can_be_written_and_used(brv_hypo, tmp_path):
    done = brv_hypo("config", "new", "opportunity", cwd=tmp_path)
    assert "--instruments opportunity.yaml" in done.stdout
    known = of_grade("tactical")
    assert instruments_from(tmp_path / "opportunity.yaml", known) == instruments_from("opportunity", known)


def test_a_plant_of_none_says_how_to_plant_nothing():
    with pytest.raises(UsageError, match="leave --plant out to plant nothing"):
        load_config("research_cone", plant="none")


def test_an_existing_file_is_kept_unless_forced(brv_hypo, tmp_path):
    (tmp_path / "compare.yaml").write_text("mine")
    assert brv_hypo("config", "new", "compare", cwd=tmp_path).returncode == 2
    assert (tmp_path / "compare.yaml").read_text() == "mine"
    assert brv_hypo("config", "new", "compare", "--force", cwd=tmp_path).returncode == 0


@pytest.mark.parametrize("kind", ["compare", "simulate", "study", "compare-result", "trace-result", "predict-result"])
def test_a_schema_is_json_with_properties(brv_hypo, kind):
    done = brv_hypo("config", "schema", kind)
    assert done.returncode == 0, done.stderr
    schema = json.loads(done.stdout)
    assert schema["properties"]
    if kind == "compare-result":
        assert schema["$defs"]["Derivative"]["properties"]["extrapolated"]["readOnly"]


def test_an_unknown_kind_ends_with_2(brv_hypo):
    assert brv_hypo("config", "new", "coffee").returncode == 2


def test_shells_are_offered_completion(brv_hypo):
    assert "--install-completion" in brv_hypo("--help").stdout
