"""A prediction as a document."""

from __future__ import annotations

from brv_hypo.report.document import Band, Bars, Chart, Document, Line, Panel, Picture, Table, Texts, thinned
from brv_hypo.report.motion_charts import BODY, TIME, scale_of
from brv_hypo.report.style import interval, number
from brv_hypo.report.tables import CONTRADICTED, IN_DOUBT, fault_texts, flight_line, term_table
from brv_hypo.residuals.prediction import LocalChange, Prediction, Region

SHOWN_AT_FIRST = 16
"""Coefficients that the terminal shows; all of them with -v and on the page."""
HOLDS_BELOW = 0.5
"""Ratio of mean squares below which the frozen model is said to hold on the flight."""
WHERE_IT_DIFFERS = "Where this flight differs from the frozen model"


def prediction_document(result: Prediction) -> Document:
    """Errors without the model, with it frozen and with it refitted; by region; the coefficients."""
    flight, sound = result.flight, result.record.sound
    found_on = ", ".join(result.model.found_on)
    errors = [
        {"moments less": name, "mean square": number(value), "ratio": _percent(value / result.error.without)}
        for name, value in _errors(result).items()
    ]
    regions = [{**_place(region), "ratio": _percent(region.ratio)} for region in result.regions]
    change = result.local_change
    differences = [] if change is None else [
        {
            "term": change.term,
            **_place(change),
            "more by": number(change.value),
            "+-": number(change.std_error, 2),
            "units": "" if change.units == "1" else change.units,
            "F": number(change.f_ratio),
        }
    ]  # fmt: skip
    return Document(
        title=f"Predicted: {flight.title or flight.path}",
        subtitle=[flight_line(flight), *([f"model found on {found_on}"] if found_on else [])],
        conclusion_title="Prediction" if sound else IN_DOUBT,
        conclusion=result.reason if sound else f"{CONTRADICTED} {result.reason}",
        decided=result.ratio < HOLDS_BELOW and sound,
        blocks=(
            Table(errors, "Mean square of the moment coefficients", ("moments less",)),
            Table(regions, "Error with the frozen model over that without a model, by interval of time"),
            Table(differences, WHERE_IT_DIFFERS, ("term", "units")),
            *(Picture(chart) for chart in prediction_charts(result)),
            term_table("Frozen", result.frozen, "always", most=SHOWN_AT_FIRST),
            term_table("Fitted to this flight", result.refitted, "always", most=SHOWN_AT_FIRST),
            Texts(fault_texts(result.record), "Warnings", warning=True),
            Texts(flight.notes, "Notes", shown="page"),
        ),
    )


def prediction_charts(result: Prediction) -> list[Chart]:
    """Errors as shares of that without a model, over the whole record and by region."""
    title = "mean square over that without a model, %"
    errors = {name: value / result.error.without for name, value in _errors(result).items()}
    regions = {f"{interval((region.start_s, region.stop_s))} s": region.ratio for region in result.regions}
    return [
        band_chart(result),
        Chart("errors", "Errors of the moments", title, [_bars(errors)]),
        Chart("regions", "Frozen model, by region", title, [_bars(regions)]),
    ]


def band_chart(result: Prediction) -> Chart:
    """C_m and C_n as measured, over the band in which the frozen model predicts them, noise included."""
    band, panels = result.band, []
    time, percent = thinned(band.time_s), f"{100.0 * band.level:.0f} %"
    scale = scale_of(*band.measured, *band.predicted)
    for name, *histories in zip(BODY, band.measured, band.predicted, band.half_width, strict=True):
        measured, centre, half = (scale.drawn(thinned(values)) for values in histories)
        interval_drawn = Band(time, centre - half, centre + half, f"{percent} prediction interval", "first")
        dots = Line(time, measured, "measured", "measured", dots=True)
        panels.append(Panel(f"{name}{scale.suffix}", [interval_drawn, dots, Line(time, centre, "first", "predicted")]))
    heading = f"Moments in the {percent} prediction interval ({100.0 * band.inside:.1f} % inside)"
    span = (result.flight.start_s, result.flight.stop_s)
    read = (
        "The interval includes the noise, the errors of the coefficients, and the residual of the model on the flights "
        "that it was found on."
    )
    return Chart("band", heading, TIME, panels, over_time=True, range=span, caption=read)


def _bars(shares: dict[str, float]) -> Panel:
    percent = [100.0 * value for value in shares.values()]
    return Panel("", [Bars(list(shares), percent, list(map(_percent, shares.values())))])


def _percent(ratio: float) -> str:
    """A share at two digits however small it is: they distinguish a model's errors from the noise's."""
    return f"{number(100.0 * ratio, 2)} %"


def _place(region: Region | LocalChange) -> dict[str, str]:
    return {
        "time, s": interval((region.start_s, region.stop_s)),
        "Mach": "" if region.mach is None else interval(region.mach),
    }


def _errors(result: Prediction) -> dict[str, float]:
    error = result.error
    return {
        "nothing": error.without,
        "the frozen model": error.frozen,
        "the model fitted here": error.own,
        "all but noise": error.noise,
    }
