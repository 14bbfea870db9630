"""Commands `compare`, `trace`, `predict` and `study`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from os import cpu_count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from brv_hypo.cli.session import ANALYSIS, FlightFile, FlightFiles, Seed, Session, as_json, complete_studies, in_session
from brv_hypo.errors import UnanswerableError, UsageError
from brv_hypo.io.files import write_whole
from brv_hypo.io.mappings import read_mapping
from brv_hypo.io.text import counted, one_line

if TYPE_CHECKING:
    from brv_hypo.comparison import CompareConfig, Comparison
    from brv_hypo.flight.record import Flight


COMPARED, TRACED = 4.5, 15.0  # s of a processor for a flight of few cycles, on cones and capsules; if trace finds some
SLOWING_CYCLES = 40.0  # of the transverse motion, which take as long again as the rest, as on Opportunity's record


def expected_seconds(flights: Sequence[Flight], seconds: float) -> float:
    """How long an analysis takes that needs so many seconds for a flight of few cycles."""
    from brv_hypo.flight.clock import transverse_frequency

    cycles = (transverse_frequency(each.q, each.r, each.step) * each.step * each.samples for each in flights)
    return sum(seconds * (1.0 + each / SLOWING_CYCLES) for each in cycles)


def complete_hypotheses(incomplete: str) -> list[str]:
    """A list of mechanisms, the last of which is not whole yet; commas and pluses are between them."""
    from brv_hypo.mechanisms.registry import mechanisms

    before = re.sub(r"[^,+]*$", "", incomplete)
    names = (before + name for name in sorted(mechanism.name for mechanism in mechanisms()))
    return [name for name in names if name.startswith(incomplete)]


_HYPOTHESES = (
    "As lag,sticking+bodyfixed (+ joins two); installed: all of kind mechanism; left out: the five, and --plugin's."
)
Mechanisms = Annotated[
    str | None, Option("--mechanisms", metavar="NAME,NAME", autocompletion=complete_hypotheses, help=_HYPOTHESES)
]


@in_session(*ANALYSIS)
def compare(
    session: Session,
    flights: FlightFiles,
    mechanisms: Mechanisms = None,
    accept_record: Annotated[
        bool, Option("--accept-record", help="Go on with a record that contradicts itself.")
    ] = False,
    seed: Seed = None,
) -> None:
    """Fit competing mechanisms, rank them and give a verdict."""
    session.claim()
    from brv_hypo.comparison import CompareConfig
    from brv_hypo.comparison import compare as rank
    from brv_hypo.settings import settings_of

    accepted = {"accept_record": True} if accept_record else {}
    settings = settings_of(CompareConfig, session.config, chosen(mechanisms) | accepted)
    records = [session.load(path) for path in flights]
    with session.progress("comparing", expected_seconds(records, COMPARED)) as progress:
        comparison = rank(records, settings, progress=progress)
    report_comparison(session, comparison, settings)


def report_comparison(session: Session, comparison: Comparison, settings: CompareConfig) -> None:
    """To the terminal, and to JSON, HTML and picture files where they were requested."""
    from brv_hypo.report.comparison import comparison_document

    records = [flight.path for flight in comparison.flights]
    session.deliver(comparison_document(comparison), comparison, settings, records)
    for warning in comparison.warnings if session.quiet or session.json_only else ():
        if "is left out" in warning:
            session.warn(warning)
    if comparison.verdict.outcome == "record fault":
        raise typer.Exit(UnanswerableError.exit_code)


def chosen(mechanisms: str | None) -> dict[str, tuple[str, ...]]:
    """The setting that `--mechanisms` makes: its names; nothing where it was left out. Raises UsageError for none."""
    if mechanisms is None:
        return {}
    names = tuple(name.strip() for name in mechanisms.split(",") if name.strip())
    if not names:
        raise UsageError(
            f"--mechanisms names none ({mechanisms!r}). Give names, as in lag,sticking+bodyfixed, or leave the option "
            "out to compare the five that come along, and those of --plugin."
        )
    return {"mechanisms": names}


@in_session(*ANALYSIS)
def trace(
    session: Session,
    flights: FlightFiles,
    model: Annotated[
        Path | None,
        Option("--model", metavar="MODEL.json", help="Start from a model, or from that of a comparison or trace."),
    ] = None,
    aero: Annotated[
        Path | None,
        Option("--aero", metavar="TABLE", help="Static slope by Mach number and alpha, with its uncertainty (csv)."),
    ] = None,
    mechanism_file: Annotated[
        Path | None,
        Option("--write-mechanism", metavar="FILE.yaml", help="Write what was discovered as a mechanism for compare."),
    ] = None,
    model_file: Annotated[
        Path | None, Option("--write-model", metavar="FILE.yaml", help="Write the whole model, to edit and use again.")
    ] = None,
    seed: Seed = None,
) -> None:
    """Trace the residual of a model to its effects, one by one.

    Several flights share the terms by Mach number and angle of attack; trim and instruments are of each.
    """
    session.claim(mechanism_file, model_file)
    from brv_hypo.mechanisms.yaml_mechanism import mechanism_text
    from brv_hypo.model.aero_table import read_aero_table
    from brv_hypo.model.model import model_text
    from brv_hypo.report.trace import trace_document
    from brv_hypo.settings import settings_of
    from brv_hypo.tracing import TraceConfig
    from brv_hypo.tracing import trace as traced

    chosen: dict[str, Any] = {} if model is None else starting_model(model, session)
    if aero is not None:
        chosen["aero"] = read_aero_table(aero)
    settings = settings_of(TraceConfig, session.config, chosen)
    records = [session.load(path) for path in flights]
    unless = ", a third of that where the residual is noise, twice where much is found"
    with session.progress("tracing", expected_seconds(records, TRACED), unless) as progress:
        result = traced(records, settings, progress=progress)
    session.deliver(trace_document(result), result, settings, [record.path for record in records])
    if model_file is not None:
        write_whole(model_file, model_text(result.model.definition))
        session.show(f"Wrote {model_file}: `brv-hypo predict FLIGHT.h5 --model {model_file}` predicts with it.")
    if mechanism_file is not None:
        if result.discovered is None:
            session.warn(f"no effect beyond what is installed was described, so {mechanism_file} is not written")
        else:
            write_whole(mechanism_file, mechanism_text(result.discovered))
            compared = f"brv-hypo compare FLIGHT.h5 --plugin {mechanism_file}"
            session.show(f"Wrote {mechanism_file}: `{compared}` compares it with the mechanisms.")


def starting_model(path: Path, session: Session) -> dict[str, Any]:
    """Settings of the model in a file of `trace`, or that leads in a comparison's JSON; UsageError for neither."""
    from brv_hypo.model.model import read_structure

    known = read_mapping(path, "what `compare --json` or `trace --json` wrote")
    if known.get("schema") != "brv-hypo/compare/1":
        return {"start": read_structure(path)}
    try:
        start = str(known["verdict"]["winner"] or known["ranking"][0]["mechanism"])
        ranked: dict[str, Any] = next((row for row in known["ranking"] if row["mechanism"] == start), {})
        errors = {term["name"] for term in (ranked.get("ml") or {}).get("instrument", ())}
    except (KeyError, IndexError, TypeError, AttributeError) as error:
        found = f"{path} is no comparison ({type(error).__name__}: {one_line(str(error))})."
        raise UsageError(f"{found} Give what `compare --json` or `trace --json` wrote.") from None
    if errors:
        session.warn(f"estimated anew: {counted(len(errors), 'error')} of the record")
    return {"start": start, "columns": ranked.get("columns", ())}


_REFITTED = (
    "What belongs to this vehicle and is fitted here: mechanisms, coefficients, errors of the record; instruments "
    "stands for all of these."
)


@in_session(*ANALYSIS)
def predict(
    session: Session,
    flight: FlightFile,
    model: Annotated[
        Path, Option("--model", metavar="MODEL", help="The model: what `trace --write-model` or `--json` wrote.")
    ],
    refit: Annotated[str, Option("--refit", metavar="NAME,...", help=_REFITTED)] = "",
) -> None:
    """Predict a flight with a model whose coefficients are frozen."""
    session.claim()
    from brv_hypo.prediction import predict as predicted
    from brv_hypo.report.trace import prediction_document
    from brv_hypo.settings import settings_of
    from brv_hypo.tracing import TraceConfig

    settings = settings_of(TraceConfig, session.config)
    record = session.load(flight)
    with session.progress("predicting") as progress:
        result = predicted(record, model, refit, settings, progress=progress)
    session.deliver(prediction_document(result), result, settings, [flight, model])


@in_session("json", "force", "plugin")
def study(
    session: Session,
    config: Annotated[
        str, Argument(metavar="STUDY.yaml", autocompletion=complete_studies, help="Study, or one that comes along.")
    ],
    output: Annotated[
        Path, Option("-o", "--output", metavar="DIR", help="Folder of the study; an interrupted one goes on there.")
    ],
    jobs: Annotated[int, Option("--jobs", metavar="N", help="Processes at once; -1: one for each processor.")] = -1,
    cluster: Annotated[
        str | None, Option("--cluster", metavar="ADDRESS", help="Dask scheduler whose workers fly, in place of --jobs.")
    ] = None,
    seed: Seed = None,
) -> None:
    """Fly many simulated flights, and judge the verdicts."""
    session.claim()
    from brv_hypo.report.html import page
    from brv_hypo.report.many_flights import study_document
    from brv_hypo.study import read_study, run_study, summarise
    from brv_hypo.study.config import draws
    from brv_hypo.study.run import results_csv

    settings = read_study(config, **({} if seed is None else {"seed": seed}))
    try:
        workers = (cpu_count() or 1) if jobs < 0 else max(jobs, 1)
        with session.progress("flying", COMPARED * len(draws(settings)) / workers) as progress:
            outcomes = run_study(
                settings, output, jobs=jobs, cluster=cluster, overwrite=session.force, progress=progress
            )
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f", and the same command goes on with what {output} holds") from None
    summary = summarise(settings, outcomes)
    document = study_document(summary)
    write_whole(output / "results.csv", results_csv(outcomes))
    write_whole(output / "summary.json", as_json(summary))
    write_whole(output / "report.html", page(document, session.provenance(settings)))
    if not summary.compared:
        first = summary.failures[0]
        raise UnanswerableError(f"none of {summary.flights} flights was compared. {first.draw.key}: {first.reason}")
    session.show(document, conclusion=document.line)
    session.show(f"Wrote results.csv, summary.json and report.html to {output}.")
    session.write_json(summary)
