"""`brv-hypo predict`: what a model found on other flights says of this one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from brv_hypo.cli import options
from brv_hypo.cli.command import in_session
from brv_hypo.cli.session import Session
from brv_hypo.report.chart_names import PREDICTION


@in_session("json", "report", "figures", "force", "plugin")
def predict(
    session: Session,
    flight: options.FlightFile,
    model: Annotated[
        Path,
        typer.Option("--model", metavar="MODEL", help="The model: what `trace --write-model` or `--json` wrote."),
    ],
    refit: Annotated[
        str,
        typer.Option(
            "--refit",
            metavar="NAME,...",
            help="What belongs to this vehicle and is fitted here: mechanisms, coefficients, errors of the record; "
            "instruments stands for all of these.",
        ),
    ] = "",
    config: options.Config = None,
    start: options.Start = None,
    stop: options.Stop = None,
    instruments: options.Instruments = None,
) -> None:
    """Predict a flight with a model whose coefficients are frozen."""
    session.claim(charts=PREDICTION)
    from brv_hypo.flight.sources import flight_as_asked
    from brv_hypo.report.prediction import prediction_document
    from brv_hypo.residuals import TraceConfig
    from brv_hypo.residuals import predict as predicted
    from brv_hypo.settings import read_settings

    settings = read_settings(TraceConfig, config)
    names = tuple(name for name in (part.strip() for part in refit.split(",")) if name)
    result = predicted(flight_as_asked(flight, start, stop, instruments), model, names, settings)
    document = prediction_document(result)
    session.present(document)
    session.write_json(result)
    session.write_report(document, settings, [flight, model])
