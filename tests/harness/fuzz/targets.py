"""A valid input of every format, and the command that reads it; commands that would run long stop after reading."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import scipy.io
import yaml

from brv_hypo.flight import save_flight
from tests.flight.records import UNITS, VEHICLE, flight, motion
from tests.harness.fuzz.mutations import OF_RECORDS, OF_TABLES, OF_TREES, RAW, Mutation

MECHANISM = {
    "format": "brv-mechanism",
    "name": "turning",
    "title": "turning moment",
    "claims": "a moment that turns",
    "source": "a test",
    "terms": [
        {"name": "along", "axis": "body_y", "turn": {"of": "time", "rate": 5.0}},
        {"name": "bump", "axis": "in_plane", "factors": [{"of": "alpha", "function": "bump", "at": 0.1, "width": 0.1}]},
    ],
}
MODEL = {
    "schema": "brv-hypo/trace/1",
    "model": {"terms": [{"name": "C", "mechanism": "magnus", "channel": "out of plane", "value": 1.0}]},
}
COMPARISON = {
    "schema": "brv-hypo/compare/1",
    "verdict": {"winner": None},
    "ranking": [{"mechanism": "lag", "ml": {"instrument": [{"name": "gyro_bias"}]}}],
}
SETTINGS = {"mechanisms": ["lag", "damping"], "knot_count": 7, "max_terms": 3, "options": {"lag": {"delays": [0.1]}}}
STUDY = {"vehicles": ["research_cone"], "planted": ["none", "lag"], "flights": 2, "draws": {"size": [0.2, 1.0]}}
SAMPLES = 120
TOLERANCES = {"grade": "tactical", "gyro_bias": 0.1, "wind": [1.0, 2.0, 3.0], "accel_bias": "0.01 m/s^2"}


@dataclass(frozen=True)
class Target:
    """`write` puts the valid input into a folder under `name`; `arguments` give it to a command."""

    label: str
    name: str
    write: Callable[[Path], None]
    mutations: tuple[Mutation, ...]
    arguments: tuple[str, ...]
    weight: int = 4


def good_map() -> dict[str, object]:
    """The map of the table that `write_csv` writes."""
    channels = {name: {"column": name, "units": UNITS[name]} for name in motion()}
    vehicle = {
        name: {"value": list(value) if isinstance(value, tuple) else value, "units": UNITS[name]}
        for name, value in vars(VEHICLE).items()
    }
    return {"title": "a flight", "channels": channels, "vehicle": vehicle}


def write_csv(path: Path) -> None:
    """A foreign record of 60 samples."""
    columns = motion(60)
    with path.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))


def _yaml(content: object) -> Callable[[Path], None]:
    return lambda path: path.write_text(yaml.safe_dump(content)) and None


def _json(content: object) -> Callable[[Path], None]:
    return lambda path: path.write_text(json.dumps(content)) and None


def _record(path: Path) -> None:
    save_flight(flight(**motion(SAMPLES)), path)


def _parquet(path: Path) -> None:
    pd.DataFrame(motion(SAMPLES)).to_parquet(path)


def _mat(path: Path) -> None:
    scipy.io.savemat(path, motion(SAMPLES))


def _imported(data: str, mapping: str = "good.yaml") -> tuple[str, ...]:
    return ("import", data, "--map", mapping, "-o", "out.h5")


TARGETS = (
    Target("record", "in.h5", _record, OF_RECORDS, ("inspect", "in.h5"), 16),
    Target("record json", "in.h5", _record, OF_RECORDS, ("inspect", "in.h5", "--json", "-")),
    Target("motion", "in.h5", _record, OF_RECORDS, ("reconstruct", "in.h5", "-o", "out.h5"), 2),
    Target("csv", "in.csv", write_csv, OF_TABLES, _imported("in.csv")),
    Target("parquet", "in.parquet", _parquet, RAW, _imported("in.parquet")),
    Target("mat", "in.mat", _mat, RAW, _imported("in.mat")),
    Target("map", "in.yaml", _yaml(good_map()), OF_TREES, _imported("good.csv", "in.yaml")),
    Target("settings", "in.yaml", _yaml(SETTINGS), OF_TREES, ("compare", "none.h5", "--config", "in.yaml")),
    Target(
        "tolerances", "in.yaml", _yaml(TOLERANCES), OF_TREES, ("reconstruct", "good.h5", "--instruments", "in.yaml"), 2
    ),
    Target("mechanism", "in.yaml", _yaml(MECHANISM), OF_TREES, ("mechanisms", "check", "in.yaml"), 2),
    Target("model", "in.json", _json(MODEL), OF_TREES, ("trace", "none.h5", "--model", "in.json")),
    Target("winner", "in.json", _json(COMPARISON), OF_TREES, ("trace", "none.h5", "--model", "in.json")),
    Target("study", "in.yaml", _yaml(STUDY), OF_TREES, ("study", "in.yaml", "-o", "good.csv")),
)


def prepare(folder: Path) -> None:
    """What the commands read beside the mutated input."""
    write_csv(folder / "good.csv")
    _yaml(good_map())(folder / "good.yaml")
    _record(folder / "good.h5")
