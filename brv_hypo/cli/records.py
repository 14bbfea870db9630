"""`brv-hypo inspect` and `brv-hypo import`: what a record holds; how a foreign one is brought in."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from brv_hypo.cli import options
from brv_hypo.cli.command import in_session
from brv_hypo.cli.session import Session


@in_session("json", "force")
def inspect(
    session: Session,
    flight: options.FlightFile,
    start: options.Start = None,
    stop: options.Stop = None,
) -> None:
    """Show channels, units, rates, gaps, noise, faults of the record, and what is usable."""
    session.claim()
    from brv_hypo.flight import inspect_flight, load_flight
    from brv_hypo.motion import try_record
    from brv_hypo.report.flight import inspection_data, inspection_line, inspection_view

    windowed = start is not None or stop is not None
    loaded = load_flight(flight, start=start, stop=stop)
    inspection = inspect_flight(loaded if windowed else flight)
    trial = try_record(loaded)[1]
    session.tell(inspection_view(inspection, trial), conclusion=inspection_line(inspection))
    session.write_json(inspection_data(inspection, trial))


@in_session("force")
def import_(
    session: Session,
    data: Annotated[Path, typer.Argument(metavar="DATA", help="Foreign record: csv, parquet or mat.")],
    mapping: Annotated[
        Path, typer.Option("--map", metavar="MAP.yaml", help="Which column is which channel, in what units.")
    ],
    output: options.Output,
) -> None:
    """Bring a foreign record in, through a map of its names and units."""
    session.claim(output)
    from brv_hypo.flight import import_record, save_flight
    from brv_hypo.report.style import bullets

    flight = import_record(data, mapping)
    save_flight(flight, output, overwrite=session.force)
    session.show(bullets(flight.notes, "Notes"))
    session.show(f"Wrote {output}: {flight.samples} samples at {flight.sample_rate:.4g} Hz.")
