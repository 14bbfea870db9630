"""The whole model as a file: what is declared, found and described, with values, errors and covariance."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from brv_hypo import compare
from brv_hypo.cli.analyses import starting_model
from brv_hypo.cli.session import Session
from brv_hypo.errors import UsageError
from brv_hypo.mechanisms.yaml_mechanism import Factor, MechanismFile, YamlTerm, mechanism_text
from brv_hypo.model.model import SavedColumn, SavedModel, model_text, read_model, read_structure, restored
from brv_hypo.prediction import predict
from brv_hypo.tracing import Trace, TraceConfig, trace
from tests.chains import ONE_EFFECT, traced_trim, trimmed
from tests.flights import flown, nominal

TERMS = 14


def declared() -> MechanismFile:
    """More terms than a search may choose."""
    low, high = 15.0, 21.0
    places = np.linspace(low, high, TERMS)
    hats = (Factor(of="mach", function="bump", at=float(place), width=float(places[1] - places[0])) for place in places)
    terms = tuple(
        YamlTerm(name=f"hat {k}", axis="out_of_plane", units="1/rad", factors=(hat, Factor(of="alpha")))
        for k, hat in enumerate(hats)
    )
    return MechanismFile(name="declared", title="t", claims="c", source="a test", terms=terms)


@pytest.mark.parametrize(
    ("earlier", "today"),
    [("C_N0", "C_m0"), ("C_Nalpha drift 1", "C_malpha drift 1"), ("C_Nalpha_force", "C_Nalpha_force")],
)
def test_names_of_earlier_files_are_read(earlier: str, today: str) -> None:
    assert SavedColumn(mechanism="static", term=earlier, units="1").term == today


@pytest.fixture(scope="module")
def result() -> Trace:
    return traced_trim()


@pytest.fixture(scope="module")
def beside_the_declared(tmp_path_factory: pytest.TempPathFactory) -> Trace:
    path = tmp_path_factory.mktemp("declared") / "declared.yaml"
    path.write_text(mechanism_text(declared()), encoding="utf-8")
    settings = TraceConfig(start=str(path), effects=("gyro_scale",), discover=False, max_steps=1)
    return trace(nominal().flight, settings)


@pytest.fixture(scope="module")
def path(result: Trace, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("model") / "model.yaml"
    file.write_text(model_text(result.model.definition), encoding="utf-8")
    return file


@pytest.mark.thorough
def test_nothing_that_was_declared_is_cut_or_left_out_of_the_file(beside_the_declared: Trace, tmp_path: Path) -> None:
    assert len([term for term in beside_the_declared.model.terms if term.mechanism == "declared"]) == TERMS
    model = beside_the_declared.model.definition
    (tmp_path / "model.yaml").write_text(model_text(model), encoding="utf-8")
    assert read_model(tmp_path / "model.yaml") == model


def test_the_file_has_all_of_the_model(result: Trace, path: Path) -> None:
    assert read_model(path) == result.model.definition
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert all(column["std_error"] >= 0.0 for column in content["columns"])
    assert len(content["covariance"]) == len(content["columns"])


def test_errors_are_the_covariances(result: Trace) -> None:
    model = result.model.definition
    sigmas = np.sqrt(np.diag(np.array(model.covariance)))
    np.testing.assert_allclose([column.std_error for column in model.columns], sigmas)


def test_a_trace_starts_from_it(result: Trace, path: Path) -> None:
    assert starting_model(path, Session()) == {"start": result.model.definition}


@pytest.mark.thorough
def test_a_trace_starts_from_the_columns_of_a_comparison() -> None:
    """Searched anew without processes they came to lie at other times, with other values."""
    flight = flown("research_cone", "bodyfixed").flight
    (row,) = (
        row for row in compare(flight, mechanisms=["bodyfixed"], maximum_likelihood="none").ranking if row.columns
    )
    found = trace(flight, start="bodyfixed", columns=row.columns, effects=["magnus"], discover=False, max_steps=1)
    kept = [column for column in found.model.definition.columns if column.mechanism == "bodyfixed"]
    assert [each.term for each in kept] == [each.term for each in row.columns]
    assert [each.start for each in kept] == pytest.approx([each.start for each in row.columns], abs=0.01)
    assert [each.value for each in kept] == pytest.approx([each.value for each in row.terms], rel=0.02)


@pytest.mark.thorough
def test_it_predicts_what_the_model_does(result: Trace, path: Path) -> None:
    predicted = predict(trimmed().flight, path)
    again = predict(trimmed().flight, result.model.definition)
    assert predicted.error == again.error


@pytest.mark.thorough
def test_an_edited_value_counts(path: Path, tmp_path: Path) -> None:
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    slope = next(column for column in content["columns"] if column["term"] == "C_malpha")
    slope["value"], slope["std_error"] = 1.5 * slope["value"], 0.25
    content.pop("covariance")
    edited = tmp_path / "edited.yaml"
    edited.write_text(yaml.safe_dump(content), encoding="utf-8")
    predicted = predict(trimmed().flight, edited)
    term = next(term for term in predicted.frozen if term.name == "C_malpha")
    assert (term.value, term.std_error) == pytest.approx((slope["value"], 0.25))
    assert predicted.ratio > 10.0 * predict(trimmed().flight, path).ratio


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda content: content["covariance"].pop(), "covariance has"),
        (lambda content: content["columns"][0].update(kind="wave"), "kind"),
        (lambda content: content["columns"][0].pop("value"), "no coefficients"),
        (lambda content: content.update(format="other"), "no model"),
    ],
)
def test_says_what_is_wrong(path: Path, tmp_path: Path, change, said: str) -> None:
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    change(content)
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text(yaml.safe_dump(content), encoding="utf-8")
    with pytest.raises(UsageError, match=said):
        read_model(wrong)


@pytest.mark.parametrize("called", ["structure.yaml", "structure.json", "structure"])
def test_a_model_without_values_may_start_a_trace(tmp_path: Path, called: str) -> None:
    model = SavedModel(columns=(SavedColumn(mechanism="static", term="C_m0", units="1"),))
    path = tmp_path / called
    path.write_text(model_text(model), encoding="utf-8")
    assert read_structure(path) == model
    assert restored(model, (nominal().flight,)).saved().columns == model.columns


@pytest.mark.thorough
def test_all_that_was_described_is_written() -> None:
    files = tuple(
        MechanismFile(
            name=f"discovered_{number}",
            title=f"moment {number}",
            claims="c",
            source="s",
            terms=(YamlTerm(name="a", axis="out_of_plane", factors=(Factor(of="alpha", power=number),)),),
        )
        for number in (1, 2)
    )
    always = trace(nominal().flight, ONE_EFFECT).model.definition.model_dump()
    columns = [*always["columns"], *({"mechanism": f.name, "term": "a", "units": "1"} for f in files)]
    start = SavedModel.model_validate({**always, "columns": columns, "covariance": (), "files": files})
    settings = TraceConfig(start=start, effects=("gyro_scale",), discover=False, max_steps=1)
    found = trace(nominal().flight, settings).discovered
    assert found is not None
    assert [term.name for term in found.terms] == ["discovered_1: a", "discovered_2: a"]
    assert all(term.value is not None for term in found.terms)
