"""What a study flies: files that come along, refusals, and the draws."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from brv_hypo.comparison import CompareConfig
from brv_hypo.errors import UsageError
from brv_hypo.study import StudyConfig, read_study
from brv_hypo.study.config import InstrumentDraws, check_names, draws, flight_config

CONE = StudyConfig(vehicles=("research_cone",), planted=("none", "sticking", "sticking+bodyfixed"), flights=2)


@pytest.mark.parametrize("name", ["study_planted", "study_instruments", "study_short", "study_short.yaml"])
def test_studies_that_come_along_can_be_flown(name):
    check_names(read_study(name))


def test_the_main_study_plants_every_mechanism_in_every_vehicle():
    study = read_study("study_planted", seed=7)
    assert set(study.planted) == {"none", "damping", "inplane", "bodyfixed", "lag", "sticking"}
    assert len(study.vehicles) == 3
    assert study.seed == 7


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("vehicles: [research_cone]", "'planted' is missing"),
        ("vehicles: [research_cone]\nplanted: [none, none]", "'none' is named twice"),
        ("vehicles: [a/cone, b/cone]\nplanted: [none]", "the vehicle 'cone' is named twice"),
        ("vehicles: [research_cone]\nplanted: [none]\ndraws: {size: [2, 1]}", "the lower end comes first"),
        ("vehicles: [research_cone]\nplanted: [none]\ndraws: {size: [0, 1]}", "greater than 0"),
        ("vehicles: [research_cone]\nplanted: [none]\nflight: 3", "is 'flights' meant"),
        ("vehicles: [research_cone]\nplanted: [none]\ndraws: {instruments: {grade: tactica}}", "is 'tactical' meant"),
    ],
)
def test_bad_studies_are_refused(tmp_path, text, message):
    path = tmp_path / "study.yaml"
    path.write_text(text)
    with pytest.raises(UsageError, match=message):
        read_study(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"planted": ("magic",)}, "'magic' is not plantable"),
        ({"vehicles": ("research_con",)}, "did you mean"),
        ({"compare": CompareConfig(mechanisms=("lagg",))}, "lag"),
    ],
)
def test_what_cannot_be_planted_is_refused_before_any_flight(change, message):
    with pytest.raises(UsageError, match=message):
        check_names(CONE.model_copy(update=change))


def test_unknown_names_of_studies_are_refused_with_the_nearest():
    with pytest.raises(UsageError, match="did you mean study_short"):
        read_study("study_shor")


@settings(max_examples=20)
@given(seed=st.integers(0, 10_000), flights=st.integers(1, 4))
def test_draws_are_the_seeds_alone_lie_in_their_ranges_and_stay_when_the_study_grows(seed, flights):
    study = CONE.model_copy(update={"seed": seed, "flights": flights})
    drawn = draws(study)
    assert drawn == draws(study)
    assert draws(study.model_copy(update={"flights": flights + 1}))[: len(drawn)] == drawn
    assert len({draw.key for draw in drawn}) == len({draw.seed for draw in drawn}) == 3 * flights
    for draw in drawn:
        for name in ("size", "delay", "onset_shift", "alpha", "roll_rate", "windward_meridian", "gyro_noise"):
            low, high = getattr(study.draws, name)
            assert low - 1e-12 <= getattr(draw, name) <= high + 1e-12


def test_a_draw_changes_the_flight_as_it_says():
    draw = draws(CONE)[1]
    assert draw.planted == "sticking"
    plain = flight_config(CONE, draw.model_copy(update={"planted": "none"}))
    config = flight_config(CONE, draw)
    (entry,) = config.mechanisms
    assert plain.mechanisms == ()
    assert entry.terms["eps"] == pytest.approx(0.6 * draw.size)
    assert entry.theta["delay"] == pytest.approx(0.12 * draw.delay)
    assert (entry.start, entry.stop) == pytest.approx((2.0 + draw.onset_shift, 4.0 + draw.onset_shift))
    assert config.start.alpha == pytest.approx(0.0436 * draw.alpha)
    assert config.start.windward_meridian == draw.windward_meridian
    assert config.instruments.gyro.noise == pytest.approx(3.5e-4 * draw.gyro_noise)


def test_a_study_may_draw_what_the_instruments_err_by():
    instruments = InstrumentDraws(grade="industrial", tolerances={"wind": 2.0}, factor=0.5)
    study = CONE.model_copy(update={"draws": CONE.draws.model_copy(update={"instruments": instruments})})
    found = flight_config(study, draws(study)[0]).instruments
    assert (found.grade, found.draw, found.declared().wind) == ("industrial", 0.5, (2.0, 2.0, 2.0))
    assert found.gyro == flight_config(CONE, draws(CONE)[0]).instruments.gyro
    assert flight_config(CONE, draws(CONE)[0]).instruments.draw == 1.0


def test_joined_plants_are_both_planted():
    config = flight_config(CONE, draws(CONE)[2])
    assert [entry.mechanism for entry in config.mechanisms] == ["sticking", "bodyfixed"]


@pytest.mark.parametrize("rate", [50.0, 100.0, 200.0, 400.0, 333.0])
def test_another_sample_rate_keeps_whole_steps_no_longer_than_they_were_by_half(rate):
    study = CONE.model_copy(update={"sample_rate": rate})
    config = flight_config(study, draws(study)[0])
    assert config.sample_rate == rate
    assert config.step * config.steps_per_sample == pytest.approx(1.0 / rate)
    assert config.step <= 1.5 * 0.005
    assert np.isclose(config.samples, 6.0 * rate + 1.0, atol=1.0)
