"""`brv-hypo config`: commented files of settings to start from, and JSON schemas for editors."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from brv_hypo.cli.command import in_session
from brv_hypo.cli.guard import guarded
from brv_hypo.cli.session import Session
from brv_hypo.files.whole import write_whole

if TYPE_CHECKING:
    from pydantic import BaseModel

app = typer.Typer(no_args_is_help=True, add_completion=False, rich_markup_mode=None)

VEHICLE, STUDY, MAP = "research_cone", "study_planted", "launch12"
"""What new simulations, studies and maps start from: files that come along, comments included."""


class Kind(StrEnum):
    """The commands that take settings."""

    COMPARE = "compare"
    TRACE = "trace"
    RECONSTRUCT = "reconstruct"
    SIMULATE = "simulate"
    STUDY = "study"
    IMPORT = "import"


class Schema(StrEnum):
    """What has a JSON schema: settings by command, and the results that --json writes."""

    COMPARE = "compare"
    TRACE = "trace"
    RECONSTRUCT = "reconstruct"
    SIMULATE = "simulate"
    STUDY = "study"
    IMPORT = "import"
    COMPARE_RESULT = "compare-result"
    TRACE_RESULT = "trace-result"
    PREDICT_RESULT = "predict-result"


@app.callback()
def config() -> None:
    """Write a commented file of settings, or print a JSON schema."""


@app.command("new")
@guarded
@in_session("force")
def new(
    session: Session,
    kind: Annotated[Kind, typer.Argument(help="The command that reads the file.")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE.yaml", help="File to write; KIND.yaml if left out.")
    ] = None,
) -> None:
    """Write a commented file of settings, to change and use."""
    path = Path(f"{kind.value}.yaml") if output is None else output
    session.claim(path)
    write_whole(path, _text(kind), overwrite=session.force)
    use = {
        "simulate": f"brv-hypo simulate {path} -o flight.h5",
        "study": f"brv-hypo study {path} -o results",
        "import": f"brv-hypo import log.csv --map {path} -o flight.h5",
    }
    session.show(f"Wrote {path}. Use it with:\n  {use.get(kind, f'brv-hypo {kind.value} flight.h5 --config {path}')}")


@app.command("schema")
@guarded
@in_session()
def schema(
    session: Session,
    kind: Annotated[Schema, typer.Argument(help="Settings of a command, or a result.")],
) -> None:
    """Print the JSON schema of settings or of a result."""
    typer.echo(json.dumps(_model(kind.value).model_json_schema(by_alias=True), indent=2))


def _text(kind: Kind) -> str:
    """The file's content; of simulations and studies one that comes along, which needs more than defaults."""
    from brv_hypo.settings_file import commented
    from brv_hypo.simulation import config_path

    if kind is Kind.SIMULATE:
        return config_path(VEHICLE).read_text(encoding="utf-8")
    if kind is Kind.STUDY:
        return config_path(STUDY, "studies").read_text(encoding="utf-8")
    if kind is Kind.IMPORT:
        return config_path(MAP, "maps").read_text(encoding="utf-8")
    return commented(_model(kind.value), f"Settings of `brv-hypo {kind.value}`")


def _model(kind: str) -> type[BaseModel]:
    from brv_hypo.flight.record_map import RecordMap
    from brv_hypo.motion import ReconstructionConfig
    from brv_hypo.ranking import CompareConfig, Comparison
    from brv_hypo.residuals import Prediction, Trace, TraceConfig
    from brv_hypo.simulation.config import SimulationConfig
    from brv_hypo.study.config import StudyConfig

    models: dict[str, type[BaseModel]] = {
        "compare": CompareConfig,
        "trace": TraceConfig,
        "reconstruct": ReconstructionConfig,
        "simulate": SimulationConfig,
        "study": StudyConfig,
        "import": RecordMap,
        "compare-result": Comparison,
        "trace-result": Trace,
        "predict-result": Prediction,
    }
    return models[kind]
