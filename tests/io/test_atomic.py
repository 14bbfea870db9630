"""Outputs are whole or not there: full media, kills, devices, links, what dead processes left."""

from __future__ import annotations

import errno
import os
import signal
import socket
import subprocess
import sys
import time

import pytest

from brv_hypo.errors import UsageError
from brv_hypo.flight import load_flight, save_flight
from brv_hypo.io import files
from brv_hypo.io.files import whole_folder, write_whole
from tests.flight.records import flight

HOST = socket.gethostname().replace(".", "-")


def dead_process():
    """The number of a process that is no more."""
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    return ended.pid


@pytest.mark.parametrize("kind", ["a pipe", "a directory", "a device"])
def test_only_regular_files_are_replaced(tmp_path, kind):
    target = tmp_path / "out"
    if kind == "a pipe":
        os.mkfifo(target)
    elif kind == "a directory":
        target.mkdir()
    else:
        target.symlink_to("/dev/null")
    with pytest.raises(UsageError, match=kind):
        write_whole(target, "content", overwrite=True)
    with pytest.raises(UsageError, match=kind):
        save_flight(flight(), target, overwrite=True)
    assert [entry.name for entry in tmp_path.iterdir()] == ["out"]


def test_a_link_is_followed_and_the_mode_of_what_is_replaced_is_kept(tmp_path):
    (tmp_path / "real").write_text("old")
    (tmp_path / "real").chmod(0o600)
    (tmp_path / "link").symlink_to("real")
    write_whole(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_text() == "new"
    assert (tmp_path / "real").stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize(
    ("code", "says"), [(errno.ENOSPC, "medium is full"), (errno.EROFS, "read-only"), (errno.EIO, "Choose another")]
)
@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_medium_that_fails_is_a_refusal_and_leaves_the_old_file(tmp_path, monkeypatch, code, says, call):
    def failing(*arguments):
        raise OSError(code, os.strerror(code))

    (tmp_path / "out").write_text("old")
    monkeypatch.setattr(files.os, call, failing)
    with pytest.raises(UsageError, match=says):
        write_whole(tmp_path / "out", "new")
    assert [entry.name for entry in tmp_path.iterdir()] == ["out"]
    assert (tmp_path / "out").read_text() == "old"


def test_what_dead_processes_left_is_removed_and_all_else_kept(tmp_path):
    dead = dead_process()
    folder = tmp_path / f".brv-hypo-x.{HOST}.{dead}.abcdef.partial"
    kept = [
        tmp_path / f".out.h5.{HOST}.{os.getppid()}.abcdef.partial",
        tmp_path / f".out.h5.elsewhere.{dead}.abcdef.partial",
        tmp_path / f"out.{HOST}.{dead}.abcdef.partial",
        tmp_path / ".hidden.partial",
    ]
    for path in kept:
        path.write_text("half")
    folder.mkdir()
    (folder / "half").write_text("half")
    write_whole(tmp_path / "out.h5", "whole")
    assert sorted(tmp_path.iterdir()) == sorted([*kept, tmp_path / "out.h5"])


def test_a_folder_is_filled_whole_or_not_at_all(tmp_path):
    with pytest.raises(ZeroDivisionError), whole_folder(tmp_path / "made") as folder:  # noqa: PT012
        (folder / "half").write_text("half")
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []
    with whole_folder(tmp_path / "made") as folder:
        (folder / "one").write_text("1")
    assert [path.name for path in tmp_path.rglob("*")] == ["made", "one"]


LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
from brv_hypo.errors import UsageError
from brv_hypo.flight import save_flight
from tests.flight.records import flight
try:
    save_flight(flight(), sys.argv[1])
except UsageError as refused:
    print(refused)
"""


def run(code, *arguments):
    paths = os.pathsep.join(path for path in (os.getcwd(), *sys.path) if path)
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": paths},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def test_a_flight_that_finds_no_room_is_a_refusal_and_leaves_nothing(tmp_path):
    printed, _ = run(LIMITED, tmp_path / "f.h5").communicate()
    assert "too large here" in printed
    assert "Traceback" not in printed
    assert list(tmp_path.iterdir()) == []


WRITING = """
import sys
from brv_hypo.flight import save_flight
from tests.flight.records import flight
one = flight()
print("begun", flush=True)
while True:
    save_flight(one, sys.argv[1], overwrite=True)
"""


@pytest.mark.parametrize("delay", [0.03, *(pytest.param(delay, marks=pytest.mark.thorough) for delay in (0.01, 0.1))])
def test_a_kill_leaves_the_old_file_or_the_new_and_the_next_write_cleans(tmp_path, delay):
    process = run(WRITING, tmp_path / "f.h5")
    process.stdout.readline()
    while not (tmp_path / "f.h5").exists():
        time.sleep(0.01)
    time.sleep(delay)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert load_flight(tmp_path / "f.h5").samples == 400
    write_whole(tmp_path / "other", "content")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["f.h5", "other"]
