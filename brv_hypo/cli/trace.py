"""`brv-hypo trace`: what a model leaves over, traced to the effect that it lacks."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from brv_hypo.cli import options
from brv_hypo.cli.command import in_session
from brv_hypo.cli.session import Session
from brv_hypo.errors import UsageError
from brv_hypo.files.mappings import YAML_ENDINGS, read_json
from brv_hypo.files.printed import one_line
from brv_hypo.files.whole import write_whole
from brv_hypo.report.chart_names import TRACE

if TYPE_CHECKING:
    from brv_hypo.residuals.saved import SavedModel

Model = Annotated[
    Path | None,
    typer.Option("--model", metavar="MODEL.json", help="Start from a model, or from that of a comparison or trace."),
]
MechanismFile = Annotated[
    Path | None,
    typer.Option(
        "--write-mechanism", metavar="FILE.yaml", help="Write what was discovered as a mechanism for compare."
    ),
]


ModelFile = Annotated[
    Path | None,
    typer.Option(
        "--write-model", metavar="FILE.yaml", help="Write the whole model, to read, edit, and use again by --model."
    ),
]
Aero = Annotated[
    Path | None,
    typer.Option(
        "--aero", metavar="TABLE", help="Static slope by Mach number and alpha, with its uncertainty (csv or yaml)."
    ),
]


@in_session("json", "report", "figures", "force", "plugin")
def trace(
    session: Session,
    flights: options.FlightFiles,
    model: Model = None,
    aero: Aero = None,
    mechanism_file: MechanismFile = None,
    model_file: ModelFile = None,
    config: options.Config = None,
    start: options.Start = None,
    stop: options.Stop = None,
    instruments: options.Instruments = None,
    seed: options.Seed = None,
) -> None:
    """Trace what a model leaves over to its effects, one by one.

    Several flights share the terms by Mach number and angle of attack; trim and instruments are of each.
    """
    session.claim(mechanism_file, model_file, charts=TRACE)
    from brv_hypo.flight.sources import flight_as_asked
    from brv_hypo.model.aero_table import read_aero_table
    from brv_hypo.report.trace import trace_document
    from brv_hypo.residuals import TraceConfig
    from brv_hypo.residuals import trace as traced
    from brv_hypo.residuals.model_file import model_text
    from brv_hypo.settings import read_settings

    chosen: dict[str, Any] = {} if model is None else {"start": starting_model(model, session)}
    if aero is not None:
        chosen["aero"] = read_aero_table(aero)
    settings = read_settings(TraceConfig, config, **chosen)
    records = [flight_as_asked(path, start, stop, instruments) for path in flights]
    with session.progress("tracing") as progress:
        result = traced(records, settings, progress=progress)
    document = trace_document(result)
    session.present(document)
    session.write_json(result)
    if model_file is not None:
        write_whole(model_file, model_text(result.model.definition))
        session.show(f"Wrote {model_file}: `brv-hypo predict FLIGHT.h5 --model {model_file}` predicts with it.")
    if mechanism_file is not None:
        _write_mechanism(session, mechanism_file, result.discovered)
    session.write_report(document, settings, [record.path for record in records])


def _write_mechanism(session: Session, file: Path, discovered: Any) -> None:
    """The discovered mechanism, where there is one."""
    from brv_hypo.mechanisms.filed import mechanism_text

    if discovered is None:
        session.warn(f"nothing was discovered, so {file} is not written")
        return
    write_whole(file, mechanism_text(discovered))
    session.show(f"Wrote {file}: `brv-hypo compare FLIGHT.h5 --mechanisms {file}` compares it.")


def starting_model(path: Path, session: Session) -> str | SavedModel:
    """The model in a file of `trace --write-model`, or that a comparison or a trace, written with `--json`, ended with.

    Of a comparison, the winning hypothesis; of a trace, the model as it stands, errors of the record included.
    Raises UsageError where the file is neither.
    """
    from brv_hypo.residuals.model_file import is_model, read_structure

    if path.suffix in YAML_ENDINGS:
        return read_structure(path)
    content = read_json(path, "what `compare --json` or `trace --json` wrote")
    if is_model(content):
        return read_structure(path)
    try:
        if content["schema"] == "brv-hypo/compare/1":
            return _of_comparison(content, session)
        if content["schema"] == "brv-hypo/trace/1":
            return _of_trace(content["model"], session)
    except (ValueError, KeyError, IndexError, TypeError, AttributeError) as error:
        raise UsageError(
            f"{path} is not a model ({type(error).__name__}: {one_line(str(error))}). Give what `compare --json` or "
            "`trace --json` wrote."
        ) from None
    raise UsageError(
        f"{path} holds {one_line(repr(content['schema']))}, expected the JSON of a comparison or of a trace."
    )


def _of_comparison(content: dict[str, Any], session: Session) -> str:
    """The winner or, where there is none, the leader; what its likelihood says of the instruments is found anew."""
    name = str(content["verdict"]["winner"] or content["ranking"][0]["mechanism"])
    ranked: dict[str, Any] = next((r for r in content["ranking"] if r["mechanism"] == name), {})
    _say_found_anew(session, [term["name"] for term in (ranked.get("ml") or {}).get("instrument", ())])
    return name


def _of_trace(model: dict[str, Any], session: Session) -> str | SavedModel:
    """The model itself, where the file holds its definition; else its mechanisms, fitted anew."""
    from brv_hypo.residuals.saved import SavedModel

    if "definition" in model:
        return SavedModel.model_validate(model["definition"])
    terms = model["terms"]
    _say_found_anew(session, [term["mechanism"] for term in terms if term["channel"] == "record"])
    moments = [term["mechanism"] for term in terms if term["channel"] != "record"]
    return "+".join(dict.fromkeys(name for name in moments if name != "baseline")) or "none"


def _say_found_anew(session: Session, errors: list[str]) -> None:
    if errors:
        session.warn(f"errors of the record are found anew: {', '.join(sorted(set(errors)))}")
