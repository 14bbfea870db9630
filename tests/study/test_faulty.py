"""Faults of the record in a study: drawn, planted, named, counted."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.study import StudyConfig, run, run_study, summarise
from brv_hypo.study.config import DrawsConfig, FaultDraws, corrupted, draws, planted_faults
from brv_hypo.study.run import fly
from tests.flights import nominal
from tests.studies.record_faults import records
from tests.study.outcomes import outcome

STUDY = StudyConfig(vehicles=("research_cone",), planted=("none", "lag"), flights=100)


def with_faults(**faults):
    return STUDY.model_copy(update={"draws": DrawsConfig(faults=FaultDraws(**faults))})


def test_faults_are_drawn_in_their_share_and_do_not_change_the_flights():
    plain, faulty = draws(STUDY), draws(with_faults(share=0.3))
    assert [one.model_copy(update={"fault": ""}) for one in faulty] == list(plain)
    assert np.mean([bool(one.fault) for one in faulty]) == pytest.approx(0.3, abs=0.1)
    known = {fault.name for fault in planted_faults().values()}
    assert {one.fault for one in faulty} <= known | {""}


def test_an_unknown_kind_of_fault_is_refused_with_the_nearest():
    with pytest.raises(ValueError, match="is 'sign of q' meant"):
        FaultDraws(share=1.0, kinds=("signs of q",))


@pytest.mark.parametrize("fault", planted_faults().values(), ids=lambda fault: fault.name)
def test_a_fault_changes_its_channels_and_no_others(fault):
    record = nominal().record
    (draw, *_) = draws(with_faults(share=1.0, kinds=(fault.name,)))
    found = corrupted(record, draw)
    if fault.channels == ("time",):
        assert found.time.size < record.time.size or np.any(found.time != record.time)
        return
    changed = {n for n, values in found.channels.items() if np.any(values != record.channels[n])}
    assert changed == set(fault.channels)


def test_a_study_of_faults_counts_them_apart(tmp_path, monkeypatch):
    def pretend(study, draw, plugins=None):
        named = draw.planted == "lag"
        wrong = {"winner": "sticking", "faults": ("p: sign",) if named else ()}
        found = outcome(draw.planted, "sticking", **({"winner": "sticking"} if draw.fault else {}))
        more = {"draw": draw, "fault_named": named if draw.fault else None}
        return found.model_copy(update={**more, **(wrong if draw.fault else {})})

    monkeypatch.setattr(run, "fly", pretend)
    study = with_faults(share=1.0, kinds=("sign of p",)).model_copy(update={"flights": 3})
    summary = summarise(study, run_study(study, tmp_path))
    assert (summary.flights, summary.compared) == (6, 0)
    (row,) = summary.faults
    assert (row.flights, row.named.count, row.wrong.count, row.unwarned.count) == (6, 3, 6, 3)
    assert summary.false_alarms.total == 0


@pytest.mark.thorough
def test_a_flipped_sign_is_planted_refused_and_named():
    study = with_faults(share=1.0, kinds=("sign of q",)).model_copy(update={"sample_rate": 100.0})
    found = fly(study, draws(study)[0])
    assert (found.status, found.fault_named) == ("refused", True)
    assert found.faults == ("q: sign",)


@pytest.mark.thorough
def test_sound_records_are_drawn_from_every_grade():
    record = next(records(3, 1))
    assert record.instruments.grade == "laboratory"
    assert set("pqr") <= set(record.channels)
