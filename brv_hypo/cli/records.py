"""`brv-hypo inspect` and `brv-hypo import`: what a record holds; how a foreign one is brought in."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from brv_hypo.cli import options
from brv_hypo.cli.command import in_session
from brv_hypo.cli.session import Session
from brv_hypo.errors import UsageError


@in_session("json", "force")
def inspect(
    session: Session,
    flight: options.FlightFile,
    start: options.Start = None,
    stop: options.Stop = None,
) -> None:
    """Show what a record holds, its faults, and what is usable."""
    session.claim()
    from brv_hypo.flight import inspect_flight, load_flight
    from brv_hypo.motion import try_record
    from brv_hypo.report.flight import inspection_data, inspection_line, inspection_view

    windowed = start is not None or stop is not None
    loaded = load_flight(flight, start=start, stop=stop)
    inspection = inspect_flight(loaded if windowed else flight)
    trial = try_record(loaded)[1]
    session.tell(inspection_view(inspection, trial, verbose=session.verbose), conclusion=inspection_line(inspection))
    session.write_json(inspection_data(inspection, trial))


@in_session("force")
def import_(
    session: Session,
    data: Annotated[
        list[Path],
        typer.Argument(
            metavar="DATA", help="Foreign record: csv, parquet or mat. With --guess, other recorders' files after it."
        ),
    ],
    mapping: Annotated[
        Path | None,
        typer.Option("--map", metavar="MAP.yaml", help="Which column is which channel, in what units."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help="Record to write; with --guess, the map."),
    ] = None,
    guess: Annotated[
        bool, typer.Option("--guess", help="Write a commented map, from names and physics, instead.")
    ] = False,
) -> None:
    """Bring a foreign record in by a map; --guess writes one."""
    if guess == (mapping is not None):
        raise UsageError(
            "import needs either --map MAP.yaml, which says what the columns are, or --guess, which writes such a map."
        )
    if guess:
        _write_guess(session, data, output or Path(f"{data[0].stem}.map.yaml"))
    elif len(data) > 1:
        raise UsageError(
            f"import --map brings in one file, got {len(data)}: the map names the others under recorders and vehicle. "
            "Only --guess takes several."
        )
    elif mapping is None or output is None:
        raise UsageError("import --map needs the record to write: -o flight.h5.")
    else:
        _bring_in(session, data[0], mapping, output)


def _write_guess(session: Session, data: Sequence[Path], output: Path) -> None:
    session.claim(output)
    from brv_hypo.files.whole import write_whole
    from brv_hypo.flight.guess import guess_map
    from brv_hypo.report.style import bullets

    found = guess_map(*data)
    write_whole(output, found.text, overwrite=session.force)
    session.show(bullets(found.unsure, "Missing or unsure", "yellow"))
    session.show(
        f"Wrote {output}. Read it, fill in the vehicle, then:\n"
        f"  brv-hypo import {data[0]} -o flight.h5 \\\n    --map {output}"
    )


def _bring_in(session: Session, data: Path, mapping: Path, output: Path) -> None:
    session.claim(output)
    from brv_hypo.flight import bring_in, save_flight
    from brv_hypo.report.flight import phase_texts
    from brv_hypo.report.style import bullets

    found = bring_in(data, mapping)
    flight = found.flight
    save_flight(flight, output, raw=found.raw, overwrite=session.force)
    session.show(bullets(flight.notes, "Notes"))
    session.show(bullets(phase_texts(found.phases), "Phases (a map's window names one)"))
    session.show(f"Wrote {output}: {flight.samples} samples at {flight.sample_rate:.4g} Hz.")
