"""Results of the frozen flights as they are now: each flight is made, and each command run, once in a process."""

from __future__ import annotations

import contextlib
import json
import tempfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from typer.testing import CliRunner

from brv_hypo import simulate
from brv_hypo.cli.main import app
from brv_hypo.simulation import load_config
from tests.flights import STEP_S
from tests.frozen.content import content_of
from tests.frozen.flights import FLIGHTS, Command, Measured, Simulated
from tests.shared_data import SHARED, shared_file

MAPS = Path(__file__).parents[2] / "configs" / "maps"
RESULTS = Path(__file__).parent / "results"


def frozen_file(name: str, command: Command) -> Path:
    """The file of a frozen result."""
    return RESULTS / f"{name}.{command}.json"


def frozen_content(name: str, command: Command) -> dict[str, Any]:
    """What is frozen."""
    content: dict[str, Any] = json.loads(frozen_file(name, command).read_text(encoding="utf-8"))
    return content


@cache
def current_content(name: str, command: Command) -> dict[str, Any]:
    """What the command says now, in the form that is frozen."""
    content = content_of(_result(name, command))
    text = json.dumps(content)
    for place in (_folder(), SHARED, MAPS):
        if str(place) in text:
            raise AssertionError(f"{name}.{command} names a path of this machine: {place}")
    return content


@cache
def _result(name: str, command: Command) -> dict[str, Any]:
    """The command's JSON with its exit code; without JSON, what it says on standard error."""
    flight = FLIGHTS[name]
    _record(name)
    output = _folder() / f"{name}.{command}.json"
    options: list[str] = []
    for option, value in (("--start", flight.start), ("--stop", flight.stop)):
        options += [] if value is None else [option, repr(value)]
    if command == "reconstruct":
        options += ["-o", f"{name}.motion.h5"]
    elif command == "compare" and flight.accept_record:
        options += ["--accept-record"]
    elif command == "predict":
        if flight.model is None:
            raise ValueError(f"{name} has no model to predict with")
        _result(flight.model, "trace")
        options += ["--model", f"{flight.model}.trace.json", "--refit", flight.refit]
    code, error = _run(command, f"{name}.h5", "--json", output.name, "--quiet", *options)
    if not output.exists():
        return {"exit_code": code, "reason": error}
    result: dict[str, Any] = {"exit_code": code, **json.loads(output.read_text(encoding="utf-8"))}
    if command == "reconstruct":
        result["histories"] = _histories(_folder() / f"{name}.motion.h5")
    return result


@cache
def _record(name: str) -> None:
    """The flight's file in the folder."""
    flight = FLIGHTS[name]
    target = _folder() / f"{name}.h5"
    if isinstance(flight, Simulated):
        simulate(_configuration(flight), seed=flight.seed, plant=flight.plant).save(target)
    elif isinstance(flight, Measured):
        source = shared_file(flight.source)
        if flight.map is None:
            target.write_bytes(source.read_bytes())
            return
        own = MAPS / f"{flight.map}.yaml"
        code, error = _run(
            "import", source, "--map", own if own.exists() else shared_file(flight.map), "-o", target.name
        )
        if code:
            raise AssertionError(f"{name} is not imported: {error}")


def _configuration(flight: Simulated) -> dict[str, Any]:
    data = load_config(flight.config).model_dump()
    data |= {"sample_rate": flight.sample_rate, "step": min(STEP_S, 1.0 / flight.sample_rate)}
    if flight.duration is not None:
        data["duration"] = flight.duration
    instruments = {"grade": flight.grade, "draw": flight.draw}
    for section, values in {"instruments": instruments, **flight.changes}.items():
        data[section] = {**data[section], **values}
    return data


def _run(command: str, *arguments: str | Path) -> tuple[int, str]:
    """Exit code and standard error of the command line, run in this process in the flights' folder."""
    with contextlib.chdir(_folder()):
        done = CliRunner().invoke(
            app, [command, *map(str, arguments)], prog_name="brv-hypo", env={"COLUMNS": "100"}, catch_exceptions=False
        )
    return done.exit_code, " ".join(done.stderr.split())


def _histories(file: Path) -> Mapping[str, Any]:
    """Every data set of a motion file, by its place."""
    import h5py

    found: dict[str, Any] = {}

    def take(place: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            found[place] = item[()].tolist()

    with h5py.File(file) as motion:
        motion.visititems(take)
    return _finite(found)


def _finite(item: Any) -> Any:
    """NaN and infinity as null, as in the commands' JSON."""
    if isinstance(item, dict):
        return {key: _finite(value) for key, value in item.items()}
    if isinstance(item, list):
        return [_finite(each) for each in item]
    return None if isinstance(item, float) and not abs(item) < float("inf") else item


@cache
def _folder() -> Path:
    """One folder for the process; it goes when the process ends."""
    _KEPT.append(tempfile.TemporaryDirectory(prefix="frozen-"))
    return Path(_KEPT[-1].name)


_KEPT: list[tempfile.TemporaryDirectory[str]] = []
