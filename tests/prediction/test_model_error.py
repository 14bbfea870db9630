"""A model's residual on held-out stretches: measured where it was found, in the band of what it predicts elsewhere."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from brv_hypo.errors import UsageError
from brv_hypo.flight import load_flight, save_flight
from brv_hypo.flight.record import Flight
from brv_hypo.linearisation.frame import ResidualMoments, residual_moments
from brv_hypo.mechanisms import find
from brv_hypo.mechanisms.yaml_mechanism import Factor, MechanismFile, YamlTerm, mechanism_of
from brv_hypo.model.model import Model, ModelError, SavedColumn, SavedModel, digest
from brv_hypo.model.term import Regressor, TimeBasis
from brv_hypo.prediction import Prediction, predict
from brv_hypo.tracing import Trace, TraceConfig
from brv_hypo.tracing.baseline import start_model
from brv_hypo.tracing.final_model import model_error
from brv_hypo.tracing.fit import Corrected, Flights, correct
from tests.chains import traced_trim, trimmed
from tests.flights import nominal

BY_MACH = ModelError(mach=(5.0, 10.0), own=(1e-5, 3e-5))
JUMP = SavedColumn(
    mechanism="bodyfixed",
    term="C_b cos(phi_b)",
    units="1",
    kind="jump",
    start=2.0,
    tied=True,
    value=5e-4,
    std_error=1e-6,
)


@pytest.fixture(scope="module")
def data() -> Corrected:
    flight = nominal().flight
    falling = replace(flight, mach=np.linspace(12.0, 6.0, flight.samples))
    return _corrected(falling)


def _corrected(flight: Flight) -> Corrected:
    source = Flights((flight,), TraceConfig())
    return correct(source, start_model(source))


def with_residual(data: Corrected, sigma: Any, seed: int = 1) -> ResidualMoments:
    """Residual moments of that standard deviation, number or (rows,), beside the noise."""
    rng = np.random.default_rng(seed)
    known = residual_moments(data.frame, data.records, data.frame.observed)
    size = np.hypot(known.noise, sigma)
    body = size * (rng.standard_normal(size.size) + 1j * rng.standard_normal(size.size))
    return replace(known, body=body)


def noise_of(data: Corrected) -> float:
    return float(np.median(residual_moments(data.frame, data.records, data.frame.observed).noise))


@pytest.mark.parametrize("times", [2.0, 10.0])
def test_a_residual_beyond_the_noise_is_the_error_of_the_model(data: Corrected, times: float) -> None:
    noise = noise_of(data)
    found = model_error(data, with_residual(data, times * noise))
    assert np.all(np.diff(found.mach) > 0.0)
    assert np.sqrt(np.mean(np.square(found.own))) == pytest.approx(times * noise, rel=0.15)


def test_a_residual_of_noise_alone_makes_little_model_error(data: Corrected) -> None:
    found = model_error(data, with_residual(data, 0.0))
    noise = noise_of(data)
    assert np.sqrt(np.mean(np.square(found.own))) < 0.4 * noise


def test_noise_alone_seldom_makes_a_model_error_on_any_stretch(data: Corrected) -> None:
    """Of many stretches, some have a larger residual than all but one in twenty would."""
    found = [model_error(data, with_residual(data, 0.0, seed)).own for seed in range(100)]
    assert len(found[0]) > 4
    assert sum(any(each) for each in found) <= 10


def test_it_is_at_the_mach_numbers_of_the_residual(data: Corrected) -> None:
    mach = data.frame.motions[0].mach[data.frame.samples(0)]
    found = model_error(data, with_residual(data, np.where(mach > 9.0, 1e-3, 0.0)))
    low, high = found.at(np.array([6.5, 11.5]))
    assert low < 0.1 * high
    assert high == pytest.approx(1e-3, rel=0.25)


def test_without_a_mach_number_there_is_one_value() -> None:
    flight = nominal().flight
    unknown = _corrected(replace(flight, mach=None))
    found = model_error(unknown, with_residual(unknown, 1e-3))
    assert found.mach == ()
    assert found.own[0] == pytest.approx(1e-3, rel=0.2)


@pytest.mark.parametrize(("mach", "expected"), [(4.0, 1e-5), (10.0, 3e-5), (20.0, 3e-5), (7.5, np.sqrt(5.0) * 1e-5)])
def test_it_is_read_between_mach_numbers_and_kept_beyond_them(mach: float, expected: float) -> None:
    assert BY_MACH.at(np.array([mach]))[0] == pytest.approx(expected)


@pytest.mark.parametrize(("error", "expected"), [(BY_MACH, np.sqrt(5.0) * 1e-5), (ModelError(own=(4e-5,)), 4e-5)])
def test_where_the_mach_number_is_unknown_it_is_the_mean(error: ModelError, expected: float) -> None:
    assert error.at(np.array([np.nan]))[0] == pytest.approx(expected)


@pytest.mark.parametrize("content", [{"mach": (5.0, 10.0), "own": (1e-5,)}, {"mach": (10.0, 5.0), "own": (1e-5, 1e-5)}])
def test_a_file_that_contradicts_itself_is_refused(content: dict[str, Any]) -> None:
    with pytest.raises(ValidationError, match="model's error"):
        ModelError.model_validate(content)


def test_what_follows_the_records_time_does_not_last() -> None:
    always = TimeBasis("constant")
    terms = (
        YamlTerm(name="late", axis="body_y", factors=(Factor(of="time", function="step", at=1.0),)),
        YamlTerm(name="slow", axis="body_y", factors=(Factor(of="mach", function="step", at=9.0, width=1.0),)),
    )
    described = mechanism_of(MechanismFile(name="described", title="t", claims="c", source="a test", terms=terms))
    columns = (
        Regressor("described", "late", (), always, "1"),
        Regressor("described", "slow", (), always, "1"),
        Regressor("trim", "C_m0", (), always, "1"),
        Regressor("trim", "C_m0", (), TimeBasis("jump", 1.0), "1"),
    )
    model = Model(mechanisms={"described": described, "trim": find("trim")}, columns=columns)
    assert model.lasting.tolist() == [False, True, True, False]


def with_a_jump(result: Trace, found_on: str, *digests: str) -> SavedModel:
    """The model of a trace with a body-fixed moment from 2 s on, found on records of these digests."""
    definition = result.model.definition
    zeros = tuple(0.0 for _ in definition.columns)
    covariance = (*((*row, 0.0, 0.0) for row in definition.covariance), (*zeros, 1e-12, 0.0), (*zeros, 0.0, 1e-12))
    across = JUMP.model_copy(update={"term": "C_b sin(phi_b)"})
    columns = (*definition.columns, JUMP, across)
    update: dict[str, Any] = {"columns": columns, "covariance": covariance, "of_processes": ()}
    update |= {"found_on": (found_on,), "digests": digests}
    return definition.model_copy(update=update)


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    """The traced flight, in a file."""
    path = tmp_path_factory.mktemp("record") / "flight.h5"
    save_flight(trimmed().flight, path)
    return load_flight(path)


@pytest.fixture(scope="module")
def elsewhere(record: Flight) -> Prediction:
    """By a model of another flight."""
    return predict(record, with_a_jump(traced_trim(), "another.h5"))


@pytest.mark.thorough
def test_what_belongs_to_the_times_of_its_own_flight_is_left_out_elsewhere(
    record: Flight, elsewhere: Prediction
) -> None:
    at_home = predict(record, with_a_jump(traced_trim(), str(record.path), digest(record)))
    assert at_home.left_out == ()
    assert any(term.mechanism == "bodyfixed" for term in at_home.frozen)
    assert elsewhere.left_out == ("bodyfixed",)
    assert not any(term.mechanism == "bodyfixed" for term in elsewhere.frozen)
    assert "Left out, as it belongs to times of the model's own flight: bodyfixed;" in elsewhere.reason
    assert (at_home.own_record, elsewhere.own_record) == (True, False)


@pytest.mark.thorough
def test_what_is_refitted_elsewhere_keeps_its_times_and_this_is_said(record: Flight, elsewhere: Prediction) -> None:
    found = predict(record, with_a_jump(traced_trim(), "another.h5"), "bodyfixed")
    assert {term.mechanism for term in found.refitted} == {"bodyfixed"}
    assert "Of bodyfixed the coefficients alone were fitted to this flight, at the times and delays" in found.reason
    assert "alone were fitted" not in elsewhere.reason


@pytest.mark.thorough
def test_what_changes_outside_a_record_cannot_be_refitted_to_it(record: Flight) -> None:
    """It was estimated as 0 +- 6e-9 there, and the model not contradicted."""
    late = replace(record, time=record.time + 100.0)
    with pytest.raises(UsageError, match=r"--refit bodyfixed: .* within the record, 100 to 1\d\d.* s: it cannot"):
        predict(late, with_a_jump(traced_trim(), "another.h5"), "bodyfixed")


@pytest.mark.thorough
def test_outside_the_times_that_it_was_found_at_its_own_record_is_another(record: Flight) -> None:
    model = with_a_jump(traced_trim(), str(record.path)).model_copy(update={"times": ((0.0, 3.0),)})
    assert predict(record, model).left_out == ("bodyfixed",)


def test_elsewhere_what_stays_is_as_it_was_fitted(elsewhere: Prediction) -> None:
    """Refitted without what is left out, it would make up for that: on a sister that lacks it too, 2,700 times the
    noise.
    """
    known = {(each.term, each.value): each.std_error for each in traced_trim().model.definition.columns}
    for term in elsewhere.frozen:
        assert term.std_error == pytest.approx(known[term.name, term.value], rel=1e-6)


def test_a_file_of_earlier_versions_is_read() -> None:
    column = JUMP.model_dump(by_alias=True) | {"elsewhere": 1e-4}
    error = {"own": [1e-5], "elsewhere": [1e-4]}
    earlier = SavedModel.model_validate({"columns": [column], "covariance_elsewhere": [[1.0]], "error": error})
    assert earlier.error is not None
    assert earlier.error.at(np.zeros(1)) == 1e-5
    assert [each.model_dump() for each in earlier.columns] == [JUMP.model_dump()]


@pytest.mark.thorough
def test_the_models_error_widens_the_band_and_is_reported(record: Flight) -> None:
    definition = traced_trim().model.definition
    plain, unsure = (
        predict(record, definition.model_copy(update={"error": error})) for error in (None, ModelError(own=(1e-3,)))
    )
    assert plain.band.model_error == 0.0
    assert unsure.band.model_error == pytest.approx(1e-3)
    wider = np.sqrt(np.square(unsure.band.half_width) - np.square(plain.band.half_width))
    np.testing.assert_allclose(wider, 1.96e-3, rtol=0.1)
    assert "times the noise: the prediction interval includes this" in unsure.reason
    assert "times the noise" not in plain.reason


def test_a_trace_estimates_its_models_error(record: Flight) -> None:
    definition = traced_trim().model.definition
    assert definition.error is not None
    assert definition.times == ((float(record.time[0]), float(record.time[-1])),)
    assert max(definition.error.own) < 3.0 * np.sqrt(traced_trim().noise)


@pytest.mark.thorough
def test_another_record_under_the_same_name_is_another_flight(record: Flight, tmp_path: Path) -> None:
    """Also one of the same times: a path says where a record is, not which."""
    other = replace(record, q=1.01 * record.q)
    path = tmp_path / Path(record.path).name
    save_flight(other, path)
    model = with_a_jump(traced_trim(), str(path), digest(record))
    assert not predict(load_flight(path), model).own_record
    assert predict(load_flight(record.path).window(1.0, 5.0), model).own_record
    assert not predict(replace(other, path=""), with_a_jump(traced_trim(), "")).own_record
