"""Studies that are interrupted, grow, fail in part; and the command."""

from __future__ import annotations

import csv
import json
import os
import signal
import sqlite3
from contextlib import closing

import pytest
from typer.testing import CliRunner

from brv_hypo.cli.main import app
from brv_hypo.errors import UsageError
from brv_hypo.study import StudyConfig, read_study, run, run_study, summarise
from brv_hypo.study.run import FLIGHTS, Store, fly, results_csv
from tests.study.outcomes import outcome, stored

STUDY = StudyConfig(vehicles=("research_cone",), planted=("none", "lag"), flights=2)


@pytest.fixture
def flown(monkeypatch):
    """Flights cost nothing; gives the keys of those that were flown."""
    keys = []

    def pretend(study, draw, plugins=None):
        keys.append(draw.key)
        return outcome(draw.planted, draw.planted, winner=draw.planted).model_copy(update={"draw": draw})

    monkeypatch.setattr(run, "fly", pretend)
    return keys


def test_every_flight_is_flown_once_and_kept_at_once(tmp_path, flown):
    kept = []

    def progress(fraction, text):
        kept.append((fraction, text.partition(" flights")[0], len(stored(tmp_path))))

    outcomes = run_study(STUDY, tmp_path, progress=progress)
    assert [o.draw.key for o in outcomes] == flown
    assert kept == [(n / 4, f"{n} of 4", n) for n in (1, 2, 3, 4)]
    assert [path.name for path in tmp_path.iterdir()] == [FLIGHTS]


def test_an_interrupted_study_goes_on_with_what_it_lacks(tmp_path, flown):
    def interrupt(fraction, text):
        if fraction == 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_study(STUDY, tmp_path, progress=interrupt)
    assert len(flown) == len(stored(tmp_path)) == 2
    outcomes = run_study(STUDY, tmp_path)
    assert [o.draw.key for o in outcomes] == flown
    flown.clear()
    assert run_study(STUDY, tmp_path) == outcomes
    assert flown == []


def killed_as_it_writes(folder):
    """The exit code of a process that begins a study there; it is forked, for a new one would import for seconds."""
    process = os.fork()
    if process == 0:
        try:
            store = Store(folder, STUDY)
            store.add(outcome("lag", "lag"))
            store._database.execute("PRAGMA cache_size = 1")
            store._database.execute("BEGIN")
            written = [(str(n), "x" * 4000) for n in range(100)]
            store._database.executemany("INSERT INTO flights VALUES (?, ?)", written)
            os.kill(os.getpid(), signal.SIGKILL)
        finally:
            os._exit(1)
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])


def test_what_a_killed_process_was_writing_is_rolled_back(tmp_path):
    """It was killed within a transaction of which a part was in the file already, beside its journal."""
    assert killed_as_it_writes(tmp_path) == -signal.SIGKILL
    assert (tmp_path / f"{FLIGHTS}-journal").exists()
    store = Store(tmp_path, STUDY)
    assert list(store.known()) == ["cone/lag/0"]
    store.close()
    assert [path.name for path in tmp_path.iterdir()] == [FLIGHTS]


def test_two_processes_may_not_fly_one_study(tmp_path):
    first = Store(tmp_path, STUDY)
    with pytest.raises(UsageError, match="in use by another process"):
        Store(tmp_path, STUDY)
    first.close()
    Store(tmp_path, STUDY).close()


def test_a_full_medium_is_refused_and_outcomes_are_whole(tmp_path):
    store = Store(tmp_path, STUDY)
    store.add(outcome("lag", "lag"))
    pages = store._database.execute("PRAGMA page_count").fetchone()[0]
    store._database.execute(f"PRAGMA max_page_count = {pages}")
    added = [outcome("lag", "lag", repeat=repeat) for repeat in range(1, 100)]
    with pytest.raises(UsageError, match="full"):
        list(map(store.add, added))
    kept = list(store.known())
    store.close()
    assert kept == [f"cone/lag/{repeat}" for repeat in range(len(kept))]
    assert len(stored(tmp_path)) == len(kept)


@pytest.mark.parametrize("content", [b"\x00" * 100, b"no database, but long enough to be taken for one" * 40])
def test_a_damaged_database_is_refused(tmp_path, flown, content):
    (tmp_path / FLIGHTS).write_bytes(content)
    with pytest.raises(UsageError, match="is damaged"):
        run_study(STUDY, tmp_path)
    assert flown == []
    assert (tmp_path / FLIGHTS).read_bytes() == content


def test_outcomes_of_other_versions_are_refused_unless_forced(tmp_path, flown):
    run_study(STUDY, tmp_path / "fields")
    with closing(sqlite3.connect(tmp_path / "fields" / FLIGHTS)) as database, database:
        database.execute("UPDATE flights SET outcome = '{}'")
    flown.clear()
    with pytest.raises(UsageError, match="not of this version"):
        run_study(STUDY, tmp_path / "fields")
    assert flown == []
    run_study(STUDY, tmp_path / "fields", overwrite=True)
    assert len(flown) == 4


def test_a_study_grows_and_another_one_is_refused_unless_forced(tmp_path, flown):
    run_study(STUDY, tmp_path)
    flown.clear()
    run_study(STUDY.model_copy(update={"flights": 3}), tmp_path)
    assert flown == ["research_cone/none/2", "research_cone/lag/2"]
    other = STUDY.model_copy(update={"seed": 9})
    with pytest.raises(UsageError, match="holds another study"):
        run_study(other, tmp_path)
    flown.clear()
    run_study(other, tmp_path, overwrite=True)
    assert len(flown) == 4


def test_a_folder_that_cannot_be_written_is_refused(tmp_path, flown):
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="cannot be written"):
        run_study(STUDY, tmp_path / "file")
    assert flown == []


@pytest.mark.slow
def test_failures_are_outcomes_with_their_reason(tmp_path):
    """Damping ten thousand times too unstable diverges; half a second is too short to compare."""
    wild = STUDY.draws.model_copy(update={"size": (1e4, 1e4)})
    (tmp_path / "brief.yaml").write_text("base: research_cone\nduration: 0.5\nsample_rate: 100.0")
    diverging = StudyConfig(vehicles=("research_cone",), planted=("damping",), flights=1, draws=wild)
    brief = StudyConfig(vehicles=(str(tmp_path / "brief.yaml"),), planted=("none",), flights=1)
    outcomes = [*run_study(diverging, tmp_path / "a"), *run_study(brief, tmp_path / "b")]
    assert [o.status for o in outcomes] == ["not simulated", "not compared"]
    assert "diverges" in outcomes[0].reason
    assert "Widen" in outcomes[1].reason
    summary = summarise(STUDY, outcomes)
    assert len(summary.failures) == 2
    assert summary.seconds_per_flight is None


def test_the_table_has_a_row_for_each_flight():
    failed = outcome("lag", "lag", repeat=1).model_copy(
        update={"status": "not compared", "reason": "too short", "probability": {}, "information": {}}
    )
    rows = list(csv.DictReader(results_csv([outcome("lag", "sticking"), failed]).splitlines()))
    assert [row["status"] for row in rows] == ["compared", "not compared"]
    assert (rows[0]["first"], rows[0]["probability_sticking"], rows[0]["vehicle"]) == ("sticking", "1.0", "cone")
    assert (rows[1]["reason"], rows[1]["probability_sticking"]) == ("too short", "")


SMALL = """
title: small
vehicles: [{vehicle}]
planted: [none, bodyfixed]
flights: 1
draws: {{size: [0.9, 1.1], onset_shift: [-0.1, 0.1]}}
compare: {{mechanisms: [bodyfixed], maximum_likelihood: none}}
"""
VEHICLE = """
base: research_cone
title: short cone
duration: 3.0
sample_rate: 100.0
plantable:
  bodyfixed:
    - {mechanism: bodyfixed, terms: {C_b cos(phi_b): 8.0e-4, C_b sin(phi_b): -3.0e-4}, start: 1.0, stop: 2.0}
"""


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A study of two short flights that really are simulated and compared."""
    folder = tmp_path_factory.mktemp("study")
    (folder / "cone.yaml").write_text(VEHICLE)
    (folder / "small.yaml").write_text(SMALL.format(vehicle=folder / "cone.yaml"))
    return folder / "small.yaml"


@pytest.fixture(scope="module")
def commanded(small):
    """The command's outcome and its folder."""
    folder = small.parent / "out"
    return CliRunner().invoke(app, ["study", str(small), "-o", str(folder), "--jobs", "1", "--json", "-"]), folder


@pytest.mark.thorough
def test_the_command_writes_table_summary_and_page(commanded):
    done, folder = commanded
    assert done.exit_code == 0, done.output
    summary = json.loads(done.stdout)
    assert summary["schema"] == "brv-hypo/study/1"
    assert summary == json.loads((folder / "summary.json").read_text())
    rows = list(csv.DictReader((folder / "results.csv").read_text().splitlines()))
    assert [(row["planted"], row["first"]) for row in rows] == [("none", "none"), ("bodyfixed", "bodyfixed")]
    page = (folder / "report.html").read_text()
    assert "Ranked first" in page
    assert "Ranked first, cone" not in page  # of one vehicle that is the table of all flights
    assert "Detection limits" in page


@pytest.mark.thorough
def test_the_command_goes_on_where_it_was_and_prints_tables(commanded, small):
    _, folder = commanded
    done = CliRunner().invoke(app, ["study", str(small), "-o", str(folder), "--jobs", "1", "-v"])
    assert done.exit_code == 0, done.output
    for heading in ("Ranked first", "Calibration", "Detection limits"):
        assert heading in done.stdout
    quiet = CliRunner().invoke(app, ["study", str(small), "-o", str(folder), "--jobs", "1", "-q"])
    assert quiet.stdout.startswith("Study: What was planted is named in 1 of 1")


@pytest.mark.thorough
def test_another_seed_is_another_study(commanded, small):
    _, folder = commanded
    done = CliRunner().invoke(app, ["study", str(small), "-o", str(folder), "--seed", "5"])
    assert done.exit_code == 2
    assert "another study" in done.output


@pytest.mark.slow
def test_a_flight_is_the_same_wherever_it_is_flown(commanded, small):
    _, folder = commanded
    kept = stored(folder)[0]
    study = read_study(small)
    again = fly(study, run.draws(study)[0])
    assert again.information == pytest.approx(kept["information"], rel=1e-9)
