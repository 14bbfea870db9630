"""Input that means harm, from the command line: nothing hangs, nothing is forged, every end is a contract's code."""

from __future__ import annotations

import os
import subprocess
import sys

import h5py
import pytest

from tests.flight.records import motion, write_raw

FORGED = "\x1b[2J\x1b[HVerdict: lag\n╭─ Verdict: lag ─╮"


@pytest.mark.parametrize(
    "arguments", [[], *(pytest.param(quiet, marks=pytest.mark.thorough) for quiet in (["-q"], ["--json", "-"]))]
)
def test_a_title_cannot_write_on_the_terminal(brv_hypo, tmp_path, arguments):
    path = write_raw(tmp_path / "f.h5", motion())
    with h5py.File(path, "r+") as file:
        file.attrs["title"] = FORGED
        file.attrs["history"] = FORGED
        file[FORGED.replace("/", "")] = 1.0
    done = brv_hypo("inspect", path, *arguments)
    assert done.returncode == 0, done.stderr
    assert "\x1b" not in done.stdout + done.stderr
    assert not any(line.startswith("╭─ Verdict") for line in done.stdout.splitlines())


def test_a_name_of_a_file_cannot_write_on_the_terminal(brv_hypo, tmp_path):
    done = brv_hypo("inspect", tmp_path / "\x1b[2J.h5")
    assert done.returncode == 3
    assert "\x1b" not in done.stderr


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["compare", "flight.h5", "--config", "pipe"], 2),
        (["inspect", "pipe"], 3),
        (["simulate", "pipe", "-o", "out.h5"], 2),
        (["import", "data.csv", "--map", "pipe", "-o", "out.h5"], 2),
        (["trace", "flight.h5", "--model", "pipe"], 2),
        (["study", "pipe", "-o", "folder"], 2),
        (["simulate", "x" * 5000, "-o", "out.h5"], 2),
    ],
)
def test_a_pipe_is_refused_and_not_waited_for(brv_hypo, tmp_path, arguments, code):
    os.mkfifo(tmp_path / "pipe")
    done = brv_hypo(*arguments, cwd=tmp_path)
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
    assert [entry.name for entry in tmp_path.iterdir()] == ["pipe"]


@pytest.mark.thorough
@pytest.mark.parametrize("arguments", [["--json", "-"], []])
def test_a_full_standard_output_is_a_message(flight_file, arguments):
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "brv_hypo", "inspect", flight_file, *arguments],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 2
    assert done.stderr.startswith("brv-hypo: an output cannot be written")
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize("special", ["/dev/null", "pipe"])
def test_a_device_is_no_output_even_when_forced(brv_hypo, tmp_path, special):
    os.mkfifo(tmp_path / "pipe")
    done = brv_hypo("simulate", "demo", "-o", special, "--force", cwd=tmp_path)
    assert done.returncode == 2
    assert "Name a regular file" in done.stderr
    assert os.path.exists("/dev/null")
    assert [entry.name for entry in tmp_path.iterdir()] == ["pipe"]
