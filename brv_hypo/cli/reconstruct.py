"""`brv-hypo reconstruct`: wind-relative motion and moments, with their uncertainty."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from brv_hypo.cli import options
from brv_hypo.cli.command import in_session
from brv_hypo.cli.session import Session
from brv_hypo.report.chart_names import RECONSTRUCTION


class Method(StrEnum):
    """The report's methods 3, 1 and 2, and Appendix A's."""

    JOINT = "joint"
    VELOCITY = "velocity"
    RATES = "rates"
    POLAR = "polar"


@in_session("json", "report", "figures", "force")
def reconstruct(
    session: Session,
    flight: options.FlightFile,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="motion.h5", help="Write the histories as HDF5.")
    ] = None,
    method: Annotated[
        Method | None, typer.Option("--method", help="How to find the wind; joint if left out.")
    ] = None,
    config: options.Config = None,
    start: options.Start = None,
    stop: options.Stop = None,
    instruments: options.Instruments = None,
) -> None:
    """Find wind-relative motion and moments, with uncertainty."""
    session.claim(output, charts=RECONSTRUCTION)
    from brv_hypo.flight.sources import flight_as_asked
    from brv_hypo.model.reconstruction import reconstruct as reconstructed
    from brv_hypo.motion import ReconstructionConfig, write_motion
    from brv_hypo.report.reconstruction import reconstruction_data, reconstruction_document
    from brv_hypo.settings import read_settings

    chosen = {} if method is None else {"method": method.value}
    settings = read_settings(ReconstructionConfig, config, **chosen)
    result = reconstructed(flight_as_asked(flight, start, stop, instruments), settings)
    if output is not None:
        write_motion(result, output, overwrite=session.force)
    document = reconstruction_document(result)
    session.present(document)
    session.write_json(reconstruction_data(result))
    session.write_report(document, settings, [result.flight.path])
