"""Every command that writes: its inputs, its outputs, and what makes an output whole."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import yaml
from typer.testing import CliRunner

from brv_hypo.cli.main import app
from brv_hypo.flight import load_flight, read_tree
from tests.harness.fuzz.targets import good_map, write_csv
from tests.study.outcomes import stored

FLIGHTS = 3  # of the study
_FLIGHT = "base: research_cone\ntitle: short\nduration: 3.0\nsample_rate: 100.0\n"
_COMPARE = "mechanisms: [damping]\nmaximum_likelihood: none\n"
_TRACE = "effects: [trim]\nmax_steps: 1\ndiscover: false\n"
_STUDY = {
    "title": "killed",
    "planted": ["none"],
    "flights": FLIGHTS,
    "compare": {"mechanisms": ["damping"], "maximum_likelihood": "none"},
}

Check = Callable[[Path], None]


@dataclass(frozen=True)
class Command:
    """`arguments` as on the command line, {inputs} being the folder of the inputs.

    `outputs`: by name in the folder that the command runs in, a check that raises where the output is not whole.
    `replaces`: it takes --force. `goes_on`: a second run goes on with what the first left.
    """

    label: str
    arguments: tuple[str, ...]
    outputs: Mapping[str, Check]
    replaces: bool = True
    goes_on: bool = False

    def line(self, inputs: Path) -> list[str]:
        """The arguments with these inputs."""
        return [argument.format(inputs=inputs) for argument in self.arguments]


def _json(kind: str) -> Check:
    def check(path: Path) -> None:
        found = json.loads(path.read_text(encoding="utf-8"))["schema"]
        assert found == f"brv-hypo/{kind}/1", f"{path.name} holds {found}"

    return check


def _page(path: Path) -> None:
    assert path.read_text(encoding="utf-8").rstrip().endswith("</html>"), f"{path.name} is cut short"


def _settings(path: Path) -> None:
    assert path.read_text(encoding="utf-8").endswith("\n"), f"{path.name} is cut short"


def _flight(samples: int, path: Path) -> None:
    assert load_flight(path).samples == samples


def _motion(path: Path) -> None:
    assert "alpha" in read_tree(path).datasets, f"{path.name} lacks alpha"


def _package(path: Path) -> None:
    files = {entry.name for entry in path.rglob("*") if entry.is_file()}
    expected = {"README.md", "pyproject.toml", "brv_hypo_ablation.py", "test_brv_hypo_ablation.py"}
    assert files == expected, f"{path.name} holds {sorted(files)}"


def _study(path: Path) -> None:
    """Every file that is there is whole; no flight is in it twice."""
    checks = {"results.csv": _rows, "summary.json": _json("study"), "report.html": _page}
    for name, check in checks.items():
        if (path / name).exists():
            check(path / name)
    keys = flights_of(path)
    assert len(set(keys)) == len(keys), f"flights are there twice: {keys}"


def _manual(folder: Path) -> None:
    for page in ("start.html", "functions.html"):
        _page(folder / page)
    assert (folder / "manual.js").read_text(encoding="utf-8").endswith('field.addEventListener("input", search);\n')


def flights_of(folder: Path) -> list[str]:
    """Keys of the flights that a study's folder holds."""
    return [_key(flight["draw"]) for flight in stored(folder)]


def _key(draw: dict[str, Any]) -> str:
    return f"{draw['vehicle']}/{draw['planted']}/{draw['repeat']}"


def complete(folder: Path) -> None:
    """Raise unless the study holds every flight once, and its table and its summary count it so."""
    _study(folder)
    found = len(flights_of(folder))
    counted = json.loads((folder / "summary.json").read_text(encoding="utf-8"))["flights"]
    assert (found, counted) == (FLIGHTS, FLIGHTS), f"{found} flights are held, {counted} counted"


def _rows(path: Path) -> None:
    rows = list(csv.reader(path.read_text(encoding="utf-8").splitlines()))
    assert {len(row) for row in rows} == {len(rows[0])}, f"{path.name} is cut short"
    assert len(rows) == 1 + FLIGHTS, f"{path.name} has {len(rows) - 1} flights"


_FILES = ("--json", "out.json", "--report", "out.html")
_RECORD = "{inputs}/flight.h5"

COMMANDS = (
    Command(
        "simulate",
        ("simulate", "{inputs}/flight.yaml", "-o", "out.h5", "--json", "out.json"),
        {"out.h5": partial(_flight, 301), "out.json": _json("simulate")},
    ),
    Command(
        "import",
        ("import", "{inputs}/data.csv", "--map", "{inputs}/map.yaml", "-o", "out.h5"),
        {"out.h5": partial(_flight, 60)},
    ),
    Command("inspect", ("inspect", _RECORD, "--json", "out.json"), {"out.json": _json("inspect")}),
    Command(
        "reconstruct",
        ("reconstruct", _RECORD, "-o", "out.h5", *_FILES),
        {"out.h5": _motion, "out.json": _json("reconstruct"), "out.html": _page},
    ),
    Command(
        "compare",
        ("compare", _RECORD, "--config", "{inputs}/compare.yaml", *_FILES),
        {"out.json": _json("compare"), "out.html": _page},
    ),
    Command(
        "trace",
        ("trace", _RECORD, "--config", "{inputs}/trace.yaml", *_FILES),
        {"out.json": _json("trace"), "out.html": _page},
    ),
    Command(
        "predict",
        ("predict", _RECORD, "--model", "{inputs}/model.json", "--json", "out.json"),
        {"out.json": _json("predict")},
    ),
    Command(
        "demo",
        ("demo", "--config", "{inputs}/compare.yaml", *_FILES),
        {"out.json": _json("compare"), "out.html": _page},
    ),
    Command("config new", ("config", "new", "compare", "-o", "out.yaml"), {"out.yaml": _settings}),
    Command("docs", ("docs", "-o", "pages"), {"pages": _manual}, replaces=False),
    Command("mechanisms", ("mechanisms", "--json", "out.json"), {"out.json": _json("mechanisms")}),
    Command(
        "mechanisms check", ("mechanisms", "check", "lag", "--json", "out.json"), {"out.json": _json("conformance")}
    ),
    Command("mechanisms new", ("mechanisms", "new", "ablation"), {"brv-hypo-ablation": _package}, replaces=False),
    Command(
        "study",
        ("study", "{inputs}/study.yaml", "-o", "out", "--jobs", "1"),
        {"out": _study},
        replaces=False,
        goes_on=True,
    ),
    Command(
        "study with workers",
        ("study", "{inputs}/study.yaml", "-o", "out", "--jobs", "2"),
        {"out": _study},
        replaces=False,
        goes_on=True,
    ),
)


def write_inputs(folder: Path) -> None:
    """What the commands read, but for what takes a flight."""
    cone, study = folder / "flight.yaml", {**_STUDY, "vehicles": [str(folder / "flight.yaml")]}
    for path, text in (
        (cone, _FLIGHT),
        (folder / "compare.yaml", _COMPARE),
        (folder / "trace.yaml", _TRACE),
        (folder / "study.yaml", yaml.safe_dump(study)),
        (folder / "map.yaml", yaml.safe_dump(good_map())),
    ):
        path.write_text(text, encoding="utf-8")
    write_csv(folder / "data.csv")


def fly_inputs(folder: Path) -> None:
    """The record that commands read, and a model of it."""
    record, model = str(folder / "flight.h5"), str(folder / "model.json")
    _run("simulate", str(folder / "flight.yaml"), "-o", record, "-q")
    _run("trace", record, "--config", str(folder / "trace.yaml"), "--json", model, "-q")


def _run(*arguments: str) -> None:
    done = CliRunner().invoke(app, [*arguments])
    assert done.exit_code == 0, done.output
