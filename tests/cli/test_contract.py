"""What every command keeps: exit codes, streams, and outputs written whole or not at all."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
import time

import numpy as np
import pytest
import typer

from brv_hypo.cli.analyses import expected_seconds
from brv_hypo.cli.main import app
from brv_hypo.cli.session import Session, as_json, guarded
from brv_hypo.errors import FlightRecordError, UnanswerableError, UsageError
from brv_hypo.io.files import write_whole
from brv_hypo.simulation import simulate

COMMANDS = (*("demo", "simulate", "inspect", "import", "reconstruct", "compare", "trace", "study", "mechanisms"),)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(brv_hypo, command):
    done = brv_hypo(command, "--help")
    assert done.returncode == 0
    assert done.stdout.startswith(f"Usage: brv-hypo {command}")


def test_the_help_names_every_command(brv_hypo_process):
    done = brv_hypo_process("--help")
    listed = done.stdout.partition("Commands:")[2].split()
    assert set(COMMANDS) <= set(listed)


def test_the_help_imports_nothing_heavy():
    heavy = "{'numpy', 'scipy', 'pydantic', 'h5py', 'pint', 'plotly', 'numba', 'pluggy'}"
    code = f"import sys, brv_hypo, brv_hypo.cli.main; print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(
    "arguments",
    [
        ["nonsense"],
        ["compare"],
        ["compare", "flight.h5", "--start", "soon"],
        ["simulate", "demo"],
        ["mechanisms", "--colour"],
    ],
)
def test_wrong_usage_ends_with_2_and_no_traceback(brv_hypo, arguments):
    done = brv_hypo(*arguments)
    assert done.returncode == 2
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    assert "Error" in done.stderr


@pytest.mark.parametrize("command", [["inspect"], ["compare"], ["reconstruct"]])
def test_a_missing_record_ends_with_3(brv_hypo, tmp_path, command):
    done = brv_hypo(*command, "nowhere.h5", cwd=tmp_path)
    assert done.returncode == 3
    assert "nowhere.h5" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_file_that_is_no_record_ends_with_3_and_leaves_no_output(brv_hypo, tmp_path):
    (tmp_path / "flight.h5").write_text("time,p\n0,1\n")
    done = brv_hypo("compare", "flight.h5", "--json", "out.json", "--report", "out.html", cwd=tmp_path)
    assert done.returncode == 3
    assert [entry.name for entry in tmp_path.iterdir()] == ["flight.h5"]


def test_an_unknown_mechanism_ends_with_2_and_the_nearest_names(brv_hypo, flight_file):
    done = brv_hypo("compare", flight_file, "--mechanisms", "lag,stickin")
    assert done.returncode == 2
    assert "unknown mechanism 'stickin'; did you mean sticking" in done.stderr


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("mechanism: [lag]", "is 'mechanisms' meant"),
        ("max_terms: many", "'max_terms'"),
        ("[lag, bodyfixed]", "expected a mapping"),
        ("a: b: c", "not YAML"),
        (None, "cannot be read"),
    ],
)
def test_a_bad_configuration_ends_with_2_and_says_what_is_wrong(brv_hypo, flight_file, tmp_path, text, expected):
    config = tmp_path / "config.yaml"
    if text is not None:
        config.write_text(text)
    done = brv_hypo("compare", flight_file, "--config", config)
    assert done.returncode == 2
    assert expected in done.stderr


def test_an_empty_window_ends_with_2_and_gives_the_span_of_the_record(brv_hypo, flight_file):
    done = brv_hypo("inspect", flight_file, "--start", 100)
    assert done.returncode == 2
    assert "usable over 0.000 to" in done.stderr


def test_a_window_too_short_to_answer_ends_with_1(brv_hypo, flight_file):
    done = brv_hypo("compare", flight_file, "--stop", 0.1, "--mechanisms", "lag")
    assert done.returncode == 1
    assert "--stop" in done.stderr


def test_an_existing_output_is_refused_before_the_work_and_kept(brv_hypo, flight_file, tmp_path):
    kept = tmp_path / "out.json"
    kept.write_text("mine")
    begun = time.perf_counter()
    done = brv_hypo("compare", flight_file, "--json", kept)
    assert done.returncode == 2
    assert "--force" in done.stderr
    assert kept.read_text() == "mine"
    assert time.perf_counter() - begun < 5.0


@pytest.mark.parametrize("output", ["missing/out.json", "."])
def test_an_output_that_cannot_be_written_is_refused_before_the_work(brv_hypo, flight_file, tmp_path, output):
    done = brv_hypo("compare", flight_file, "--json", output, cwd=tmp_path)
    assert done.returncode == 2
    assert list(tmp_path.iterdir()) == []


def test_one_file_for_two_outputs_is_refused(tmp_path):
    session = Session(json=str(tmp_path / "x"), report=tmp_path / "." / "x")
    with pytest.raises(UsageError, match="two outputs"):
        session.claim()


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (UnanswerableError("too few samples"), 1),
        (UsageError("no such thing"), 2),
        (FlightRecordError("no units"), 3),
        (ZeroDivisionError("division by zero"), 70),
        (KeyboardInterrupt(), 130),
    ],
)
def test_each_kind_of_error_has_its_exit_code_and_one_message(error, code, capsys):
    def command(verbose: bool = False) -> None:
        raise error

    with pytest.raises(typer.Exit) as ended:
        guarded(command)(verbose=False)
    captured = capsys.readouterr()
    assert ended.value.exit_code == code
    assert captured.out == ""
    assert captured.err.startswith("brv-hypo: ")
    assert len(captured.err.splitlines()) == 1


def test_a_fault_of_the_program_shows_its_traceback_with_verbose(capsys):
    def command(verbose: bool = False) -> None:
        raise ZeroDivisionError("division by zero")

    with pytest.raises(typer.Exit):
        guarded(command)(verbose=True)
    assert "Traceback" in capsys.readouterr().err


def test_json_has_null_for_what_is_not_finite(tmp_path):
    import numpy as np

    text = as_json({"a": float("nan"), "b": [1.0, float("inf")], "c": np.array([1.5, np.nan]), "d": tmp_path})
    assert json.loads(text, parse_constant=pytest.fail) == {
        "a": None,
        "b": [1.0, None],
        "c": [1.5, None],
        "d": str(tmp_path),
    }


def test_a_file_is_written_whole_or_not_at_all(tmp_path):
    target = tmp_path / "out.txt"
    with pytest.raises(UnicodeEncodeError):
        write_whole(target, "half \ud800")
    assert list(tmp_path.iterdir()) == []
    write_whole(target, "whole")
    assert target.read_text() == "whole"


def test_the_version_is_that_of_the_package(brv_hypo_process):
    from importlib.metadata import version

    assert brv_hypo_process("--version").stdout == f"brv-hypo {version('brv-hypo')}\n"


def test_the_console_script_is_the_program(brv_hypo):
    assert app.info.name == "brv-hypo"


@pytest.mark.parametrize(
    ("seconds", "quiet", "expected"),
    [
        (12.0, False, ""),
        (40.0, False, "brv-hypo: tracing takes about 40 s of a free processor\n"),
        (400.0, False, "brv-hypo: tracing takes about 7 min of a free processor\n"),
        (400.0, True, ""),
    ],
)
def test_what_takes_long_says_so_beforehand(seconds, quiet, expected, capsys):
    with Session(quiet=quiet).progress("tracing", seconds):
        assert capsys.readouterr().err == expected


def test_a_record_of_many_cycles_takes_longer():
    short = simulate("research_cone", seed=1, duration=2.0).flight
    stamps = np.arange(8 * short.samples) * short.step
    swings = np.sin(2.0 * np.pi * 5.0 * stamps)
    many = dataclasses.replace(short, **{name: np.tile(values, 8) for name, values in short.arrays().items()})
    many = dataclasses.replace(many, time=stamps, q=swings, r=0.0 * swings, segments=())
    assert 4.0 < expected_seconds([short], 4.0) < 5.0
    assert expected_seconds([many], 4.0) == pytest.approx(4.0 * (1.0 + 5.0 * 16.0 / 40.0), rel=0.05)
    assert expected_seconds([short, many], 4.0) == expected_seconds([short], 4.0) + expected_seconds([many], 4.0)
