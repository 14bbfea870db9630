"""`--instruments`: tolerances in place of those that the record states."""

from __future__ import annotations

import numpy as np
import pytest

import brv_hypo
from brv_hypo.cli.session import Session
from brv_hypo.comparison.summary import flight_summary
from brv_hypo.errors import UsageError
from brv_hypo.flight.format import load_flight
from brv_hypo.flight.tolerances import of_grade
from brv_hypo.report.reconstruction import reconstruction_document
from brv_hypo.report.tables import flight_lines


def test_without_the_option_tolerances_are_those_of_the_record(flight_file):
    assert load_flight(flight_file).instruments == of_grade("tactical")


def test_a_grade_replaces_every_tolerance(flight_file):
    flight = load_flight(flight_file, instruments="industrial").window(1.0, 3.0)
    assert flight.instruments == of_grade("industrial")
    assert flight.time[-1] == pytest.approx(3.0, abs=0.011)


def test_a_file_replaces_what_it_names(flight_file, tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("gyro_bias: 0.3\naccel_position: [1 mm, 0.002, 0.002]\n")
    found = load_flight(flight_file, instruments=str(file)).instruments
    assert found.gyro_bias == pytest.approx(np.radians([0.3] * 3))
    assert found.accel_position == pytest.approx((0.001, 0.002, 0.002))
    assert found.wind == of_grade("tactical").wind
    assert found.described == "tactical but for 2 of 14 tolerances"


def test_a_file_that_comes_along_has_a_name(flight_file):
    along = Session(instruments="opportunity").load(flight_file).instruments
    assert along == load_flight(flight_file, instruments="opportunity").instruments
    assert along.accel_position == pytest.approx((0.01, 0.01, 0.01))
    assert Session(instruments="industrial").load(flight_file).instruments == of_grade("industrial")


def test_the_grade_is_at_the_top_of_an_answer(flight_file):
    flight = load_flight(flight_file, instruments="industrial")
    summary = flight_summary(flight)
    assert summary.instruments == "industrial"
    (line,) = flight_lines([summary])
    assert line.endswith("Hz, instruments industrial")
    assert flight_lines([summary, summary]) == [f"flight 1: {line}", f"flight 2: {line}"]
    motion = reconstruction_document(brv_hypo.reconstruct(flight, method="rates"))
    assert motion.subtitle[-1].endswith("Hz, instruments industrial")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gyro_bais: 0.3", "is 'gyro_bias' meant"),
        ("grade: labaratory", "is 'laboratory' meant"),
        ("wind: -1.0", "none below zero"),
        ("wind: 3 parsec", "parsec"),
        ("wind: [1.0, 2.0]", "three by body axis"),
        ("wind: strong", "expected a number"),
    ],
)
def test_files_without_tolerances_are_refused(flight_file, tmp_path, text, message):
    file = tmp_path / "mine.yaml"
    file.write_text(text)
    with pytest.raises(UsageError, match=message):
        load_flight(flight_file, instruments=str(file))


@pytest.mark.parametrize("command", ["compare", "trace", "reconstruct"])
def test_an_unknown_grade_ends_with_2_and_the_nearest(brv_hypo, flight_file, command):
    done = brv_hypo(command, flight_file, "--instruments", "tactica")
    assert done.returncode == 2
    assert "is 'tactical' meant" in done.stderr
