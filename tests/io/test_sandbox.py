"""Hostile binary files: the library that reads them works in a process of its own, within budgets."""

from __future__ import annotations

import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from brv_hypo.errors import FlightRecordError
from brv_hypo.flight import load_flight, read_tree
from brv_hypo.io import sandbox
from tests.flight.records import motion, write_raw

CRASHES = {
    "crashes": ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "crashed on it .SIGSEGV"),
    "ends": ("raise SystemExit(4)", r"ended on it .code 4"),
    "hangs": ("import time; time.sleep(60)", "did not finish"),
    "works for ever": (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_CPU, (1, 2))\nwhile True: pass",
        "did not finish",
    ),
}


@pytest.fixture
def worker_that(monkeypatch):
    """Replace the reading process by a script; the real one is back for the next test."""

    def replaced(script):
        monkeypatch.setattr(sandbox, "_PROGRAM", script)
        monkeypatch.setattr(sandbox, "_worker", sandbox._Worker())
        monkeypatch.setattr(sandbox, "LONGEST_READ_SECONDS", 3.0)

    return replaced


@pytest.mark.parametrize(
    "how",
    [pytest.param(how, marks=pytest.mark.thorough if how in ("hangs", "works for ever") else ()) for how in CRASHES],
)
def test_a_library_that_fails_is_a_refusal_and_the_next_file_is_read(tmp_path, worker_that, how, monkeypatch):
    path = write_raw(tmp_path / "flight.h5", motion())
    script, says = CRASHES[how]
    worker_that(script)
    with pytest.raises(FlightRecordError, match=says):
        load_flight(path)
    monkeypatch.undo()
    assert load_flight(path).samples == 400


def outcome(path: Path) -> FlightRecordError | None:
    """The refusal of a record; None where it is read."""
    try:
        load_flight(path)
    except FlightRecordError as refused:
        return refused
    return None


def opened(path: Path) -> h5py.File:
    """A valid record, open to be damaged."""
    return h5py.File(write_raw(path, motion()), "r+")


@pytest.mark.parametrize("samples", [50_000_000, 10**12])
def test_a_dataset_that_is_not_requested_is_never_read(tmp_path, samples):
    with opened(tmp_path / "f.h5") as file:
        file.create_dataset("telemetry", shape=(samples,), dtype="f8", chunks=(1000,), compression="gzip")
        file["vehicle"].create_dataset("model", shape=(samples,), dtype="f8", chunks=(1000,))
    flight = load_flight(tmp_path / "f.h5")
    assert "dataset 'telemetry' is not part of format 1 and was ignored" in " ".join(flight.notes)


@pytest.mark.parametrize("name", ["q", "time", "vehicle/mass"])
@pytest.mark.parametrize("samples", [50_000_000, 10**12])
def test_a_channel_beyond_the_budget_is_refused_by_its_header(tmp_path, name, samples):
    with opened(tmp_path / "f.h5") as file:
        units = file[name].attrs["units"]
        del file[name]
        file.create_dataset(name, shape=(samples,), dtype="f8", chunks=(1000,)).attrs["units"] = units
    begun = time.process_time()
    with pytest.raises(FlightRecordError, match=f"'{name}': found .* MB declared"):
        load_flight(tmp_path / "f.h5")
    assert time.process_time() - begun < 2.0


def soft(file):
    del file["q"]
    file["q"] = h5py.SoftLink("/r")


def external(file):
    del file["q"]
    file["q"] = h5py.ExternalLink("/dev/zero", "/q")


def loop(file):
    del file["q"]
    file["q"] = h5py.SoftLink("/q")


def virtual(file):
    del file["q"]
    layout = h5py.VirtualLayout((400,), "f8")
    layout[:] = h5py.VirtualSource("other.h5", "q", (400,))
    file.create_virtual_dataset("q", layout)


def stored_elsewhere(file):
    del file["q"]
    file.create_dataset("q", (400,), "f8", external=[("/dev/zero", 0, 3200)])


def compound(file):
    del file["q"]
    file.create_dataset("q", data=np.zeros(400, dtype=[("a", "f8")]))


def empty(file):
    del file["q"]
    file.create_dataset("q", data=h5py.Empty("f8"))


def a_group(file):
    del file["q"]
    file.create_group("q")


def wide_chunks(file):
    del file["q"]
    file.create_dataset("q", (400,), "f8", chunks=(2**28,), maxshape=(None,))


@pytest.mark.parametrize(
    "damage",
    [soft, external, loop, virtual, stored_elsewhere, compound, empty, a_group, wide_chunks],
    ids=lambda damage: damage.__name__,
)
def test_a_channel_that_is_no_plain_dataset_is_refused_by_name(tmp_path, damage):
    with opened(tmp_path / "f.h5") as file:
        damage(file)
    with pytest.raises(FlightRecordError, match="'q'"):
        load_flight(tmp_path / "f.h5")


def test_groups_that_are_not_requested_may_be_anything(tmp_path):
    with opened(tmp_path / "f.h5") as file:
        file["loop"] = file["/"]
        deep = file
        for _ in range(300):
            deep = deep.create_group("deeper")
        file["vehicle/up"] = file["/"]
    assert load_flight(tmp_path / "f.h5").samples == 400


def test_a_loop_in_a_requested_group_is_refused(tmp_path):
    with opened(tmp_path / "f.h5") as file:
        file["truth/again"] = file.create_group("truth")
    with pytest.raises(FlightRecordError, match="more than 8 groups in one another"):
        read_tree(tmp_path / "f.h5", only={"truth": None})
    assert load_flight(tmp_path / "f.h5").samples == 400


@pytest.mark.parametrize("name", ["format", "format_version", "title", "planet", "history"])
@pytest.mark.parametrize(
    "value", [np.arange(3.0), np.array(["a", "b"], dtype=h5py.string_dtype()), h5py.Empty("f8"), 1e300, True]
)
def test_attributes_of_any_kind_are_refused_or_accepted(tmp_path, name, value):
    with opened(tmp_path / "f.h5") as file:
        file.attrs[name] = value
    assert outcome(tmp_path / "f.h5") is None or name in str(outcome(tmp_path / "f.h5"))


@pytest.mark.parametrize("value", [np.arange(3.0), h5py.Empty("f8"), 7, "\x1b[2J"])
def test_units_of_any_kind_are_refused_by_name(tmp_path, value):
    with opened(tmp_path / "f.h5") as file:
        file["q"].attrs["units"] = value
    with pytest.raises(FlightRecordError, match=r"dataset 'q'.*units") as refused:
        load_flight(tmp_path / "f.h5")
    assert "\x1b" not in str(refused.value)


def test_a_title_is_one_line_of_plain_text(tmp_path):
    with opened(tmp_path / "f.h5") as file:
        file.attrs["title"] = "Entry\x1b[2J\x1b[H\nVerdict: lag"
        file.attrs["history"] = "cut\nby \x1b[1mhand"
    flight = load_flight(tmp_path / "f.h5")
    assert flight.title == "Entry[2J[H Verdict: lag"
    assert flight.notes[:2] == ("cut", "by [1mhand")


@pytest.mark.parametrize("offset", range(0, 2048, 64))
def test_damage_anywhere_in_the_head_is_read_or_refused(tmp_path, offset):
    path = write_raw(tmp_path / "f.h5", motion())
    content = bytearray(path.read_bytes())
    content[offset : offset + 16] = b"\xff" * 16
    path.write_bytes(content)
    assert outcome(path) is None or "f.h5" in str(outcome(path))
