"""Signals end a command, its workers and its temporaries within two seconds, with the contract's codes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import typer

from brv_hypo.cli import session
from brv_hypo.cli.session import guarded

STUDY = """
title: long
vehicles: [research_cone]
planted: [none, bodyfixed]
flights: 50
compare: {mechanisms: [bodyfixed], maximum_likelihood: none}
"""
CODES = {signal.SIGINT: (130, "interrupted"), signal.SIGTERM: (143, "terminated")}
LIMIT_SECONDS = 2.0 + 3.0  # of the contract, and of a machine that is busy with other tests


def begun(folder, *arguments):
    """The command, as the leader of a group of processes."""
    paths = os.pathsep.join(path for path in sys.path if path)
    return subprocess.Popen(
        [sys.executable, "-m", "brv_hypo", *map(str, arguments)],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": paths},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def descendants(group):
    """Processes of the session that `group` leads, itself left out."""
    found = []
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            fields = (entry / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[3]) == group and int(entry.name) != group and fields[0] != "Z":
            found.append(int(entry.name))
    return found


def ended(process, number, everyone=False):
    """Seconds from the signal to the end, exit code and messages."""
    sent = time.monotonic()
    (os.killpg if everyone else os.kill)(process.pid, number)
    _, errors = process.communicate(timeout=60)
    return time.monotonic() - sent, process.returncode, errors


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks for processes in /proc")
@pytest.mark.thorough
@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)])
@pytest.mark.parametrize("everyone", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_study_ends_with_its_workers_and_goes_on_later(tmp_path, number, everyone):
    (tmp_path / "study.yaml").write_text(STUDY)
    process = begun(tmp_path, "study", "study.yaml", "-o", "out", "--jobs", "2")
    patience = time.monotonic() + 90.0
    while len(descendants(process.pid)) < 2 and time.monotonic() < patience:
        time.sleep(0.1)
    time.sleep(2.0)
    seconds, code, errors = ended(process, number, everyone)
    assert (code, seconds < LIMIT_SECONDS) == (CODES[number][0], True), errors
    time.sleep(0.5)
    assert descendants(process.pid) == []
    assert CODES[number][1] in errors
    assert "goes on with what out holds" in errors
    assert "Traceback" not in errors
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["flights.db"]


@pytest.mark.thorough
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("delay", [0.8, pytest.param(4.0, marks=pytest.mark.slow)])
def test_a_simulation_ends_at_once_and_leaves_no_file(tmp_path, number, delay):
    process = begun(tmp_path, "simulate", "research_cone", "-o", "flight.h5", "--json", "out.json")
    time.sleep(delay)
    if process.poll() is None:
        seconds, code, errors = ended(process, number)
        assert seconds < LIMIT_SECONDS
        if code != 0:  # it may have been done just then
            assert code in (CODES[number][0], -number), errors  # -number: while Python itself starts
            assert not [path.name for path in tmp_path.iterdir() if path.name.startswith(".")]


STUCK = """
import brv_hypo.cli.main as main, time, typer
from brv_hypo.cli.session import guarded

def command():
    print("begun", flush=True)
    while True:
        try:
            time.sleep(60)
        except BaseException:
            pass

main.app = typer.Typer()
main.app.command()(guarded(command))
main.run()
"""


@pytest.mark.thorough
@pytest.mark.parametrize("number", CODES)
def test_what_swallows_the_signal_is_ended_after_the_grace(number):
    paths = os.pathsep.join(path for path in sys.path if path)
    process = subprocess.Popen(
        [sys.executable, "-c", STUCK],
        env={**os.environ, "PYTHONPATH": paths},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    process.stdout.readline()
    time.sleep(0.3)
    seconds, code, errors = ended(process, number)
    assert code == CODES[number][0]
    assert 1.0 < seconds < LIMIT_SECONDS
    assert len(errors.splitlines()) == 1


IN_EXEC = """
import brv_hypo.cli.main as main, typer
from brv_hypo.cli.session import guarded

def command():
    exec("import os, signal; os.kill(os.getpid(), signal.{})")

main.app = typer.Typer()
main.app.command()(guarded(command))
main.run()
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.thorough)])
def test_a_signal_while_a_text_is_executed_keeps_its_code(tmp_path, number):
    """CPython marks a KeyboardInterrupt that passes through `exec` of a text, and dies of SIGINT at its end."""
    (tmp_path / "command_in_exec.py").write_text(IN_EXEC.format(number.name))
    paths = os.pathsep.join([str(tmp_path), *(path for path in sys.path if path)])
    done = subprocess.run(
        [sys.executable, "-m", "command_in_exec"],
        env={**os.environ, "PYTHONPATH": paths},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == CODES[number][0]
    assert CODES[number][1] in done.stderr


def test_what_a_library_makes_of_a_signal_is_the_signal(monkeypatch, capsys):
    """A signal in the middle of an import comes back as an ImportError."""

    def command():
        raise ImportError("initialization failed")

    monkeypatch.setattr(session, "_signal", signal.SIGTERM)
    with pytest.raises(typer.Exit) as ended_with:
        guarded(command)()
    assert ended_with.value.exit_code == 143
    assert "terminated" in capsys.readouterr().err
