"""`brv-hypo study`: how often is a planted mechanism found?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from brv_hypo.cli import options
from brv_hypo.cli.session import Progress, Session, as_json, in_session
from brv_hypo.errors import UnanswerableError
from brv_hypo.io.atomic import write_whole

if TYPE_CHECKING:
    from brv_hypo.study import Outcome, StudySummary
    from brv_hypo.study.run import Progress as StudyProgress

RESULTS, SUMMARY, REPORT = "results.csv", "summary.json", "report.html"


@in_session("json", "force", "plugin")
def study(
    session: Session,
    config: Annotated[
        str,
        typer.Argument(
            metavar="STUDY.yaml",
            autocompletion=options.studies,
            help="Study, or the name of one that comes along.",
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "-o", "--output", metavar="DIR", help="Folder of the study; an interrupted one goes on there."
        ),
    ],
    jobs: Annotated[
        int, typer.Option("--jobs", metavar="N", help="Processes at once; -1: one for each processor.")
    ] = -1,
    cluster: Annotated[
        str | None,
        typer.Option("--cluster", metavar="ADDRESS", help="Dask scheduler whose workers fly, in place of --jobs."),
    ] = None,
    seed: options.Seed = None,
) -> None:
    """Fly many simulated flights, and judge the verdicts."""
    session.claim()
    from brv_hypo.report.html import page
    from brv_hypo.report.many_flights import study_document
    from brv_hypo.study import read_study, run_study, summarise

    settings = read_study(config, **({} if seed is None else {"seed": seed}))
    try:
        with session.progress("flying") as progress:
            outcomes = run_study(
                settings,
                output,
                jobs=jobs,
                cluster=cluster,
                overwrite=session.force,
                progress=_advance(progress),
            )
    except KeyboardInterrupt as interrupt:
        raise type(interrupt)(f", and the same command goes on with what {output} holds") from None
    summary = summarise(settings, outcomes)
    document = study_document(summary, outcomes)
    _write(output, outcomes, summary, page(document, session.provenance(settings)))
    if not summary.compared:
        first = summary.failures[0]
        raise UnanswerableError(
            f"none of {summary.flights} flights was compared. {first.key}: {first.reason}"
        )
    session.present(document)
    session.show(f"Wrote {RESULTS}, {SUMMARY} and {REPORT} to {output}.")
    session.write_json(summary)


def _advance(progress: Progress) -> StudyProgress:
    def advance(done: int, total: int, latest: Outcome) -> None:
        progress(f"{done} of {total} flights, last {latest.draw.key}", done / total)

    return advance


def _write(folder: Path, outcomes: tuple[Outcome, ...], summary: StudySummary, page: str) -> None:
    from brv_hypo.study.store import results_csv

    write_whole(folder / RESULTS, results_csv(outcomes))
    write_whole(folder / SUMMARY, as_json(summary))
    write_whole(folder / REPORT, page)
