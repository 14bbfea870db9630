"""`brv-hypo compare`: competing mechanisms on one flight or several, ranked, with a verdict."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from brv_hypo.cli import completion, options
from brv_hypo.cli.command import in_session
from brv_hypo.cli.session import Session
from brv_hypo.errors import UnanswerableError, UsageError
from brv_hypo.report.chart_names import comparison_names

if TYPE_CHECKING:
    from brv_hypo.ranking import CompareConfig, Comparison

Mechanisms = Annotated[
    str | None,
    typer.Option(
        "--mechanisms",
        metavar="NAME,NAME",
        autocompletion=completion.hypotheses,
        help="Hypotheses, a plus joining several, as in lag,sticking+bodyfixed; all installed if left out.",
    ),
]


@in_session("json", "report", "figures", "force", "plugin")
def compare(
    session: Session,
    flights: options.FlightFiles,
    mechanisms: Mechanisms = None,
    config: options.Config = None,
    start: options.Start = None,
    stop: options.Stop = None,
    instruments: options.Instruments = None,
    accept_record: options.AcceptRecord = False,
    seed: options.Seed = None,
) -> None:
    """Fit competing mechanisms, rank them and give a verdict."""
    session.claim(charts=comparison_names(len(flights)))
    from brv_hypo.flight.sources import flight_as_asked
    from brv_hypo.ranking import CompareConfig
    from brv_hypo.ranking import compare as rank
    from brv_hypo.settings import read_settings

    accepted = {"accept_record": True} if accept_record else {}
    settings = read_settings(CompareConfig, config, **chosen(mechanisms), **accepted)
    records = [flight_as_asked(path, start, stop, instruments) for path in flights]
    with session.progress("comparing") as progress:
        comparison = rank(records, settings, progress=progress)
    report_comparison(session, comparison, settings)


def report_comparison(session: Session, comparison: Comparison, settings: CompareConfig) -> None:
    """To the terminal, and to JSON, HTML and picture files where they were asked for."""
    from brv_hypo.report.compare import comparison_document

    document = comparison_document(comparison)
    session.present(document)
    session.write_json(comparison)
    if session.quiet or session.json_only:
        for warning in comparison.warnings:
            if "is left out" in warning:
                session.warn(warning)
    session.write_report(document, settings, [flight.path for flight in comparison.flights])
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
            "out to compare all that are installed."
        )
    return {"mechanisms": names}
