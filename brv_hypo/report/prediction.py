"""A prediction as a document."""

from __future__ import annotations

from brv_hypo.report.comparison import term_table
from brv_hypo.report.document import Band, Bars, Chart, Document, Line, Panel, Picture, Table, Texts, thinned
from brv_hypo.report.motion_charts import BODY, TIME, scale_of
from brv_hypo.report.style import interval, number
from brv_hypo.report.tables import CONTRADICTED, IN_DOUBT, fault_texts, flight_line
from brv_hypo.residuals.prediction import Prediction

SHOWN_AT_FIRST = 16
"""Coefficients that the terminal shows; all of them with -v and on the page."""
HOLDS_BELOW = 0.5
"""Ratio of mean squares below which the frozen model is said to hold on the flight."""
WHERE_IT_DIFFERS = "Where this flight differs from the frozen model"


def prediction_document(result: Prediction) -> Document:
    """Errors without the model, with it frozen and with it refitted; by region; the coefficients."""
    flight, sound = result.flight, result.record.sound
    found_on = ", ".join(result.model.found_on)
    errors = [(name, number(value), _percent(100.0 * value / result.error.without)) for name, value in _errors(result)]
    regions = [
        (
            interval((region.start_s, region.stop_s)),
            "" if region.mach is None else interval(region.mach),
            _percent(100.0 * region.ratio),
        )
        for region in result.regions
    ]
    subtitle = [flight_line(flight)]
    if found_on:
        subtitle.append(f"model found on {found_on}")
    return Document(
        title=f"Predicted: {flight.title or flight.path}",
        subtitle=subtitle,
        conclusion_title="Prediction" if sound else IN_DOUBT,
        conclusion=result.reason if sound else f"{CONTRADICTED.format(reported='left')} {result.reason}",
        decided=result.ratio < HOLDS_BELOW and sound,
        blocks=(
            Table(("moments less", "mean square", "ratio"), errors, "Mean square of the moment coefficients"),
            Table(("time, s", "Mach", "ratio"), regions, "Frozen model over none, by stretch of time"),
            *_differences(result),
            *(Picture(chart) for chart in prediction_charts(result)),
            term_table("Frozen", result.frozen, "always", most=SHOWN_AT_FIRST),
            term_table("Fitted to this flight", result.refitted, "always", most=SHOWN_AT_FIRST),
            Texts(fault_texts(result.record), "Warnings", warning=True),
            Texts(flight.notes, "Notes", shown="page"),
        ),
    )


def _differences(result: Prediction) -> list[Table]:
    """The change of slope or damping that the flight shows, if any."""
    change = result.local_change
    if change is None:
        return []
    units = "" if change.units == "1" else change.units
    row = (
        change.term,
        interval((change.start_s, change.stop_s)),
        "" if change.mach is None else interval(change.mach),
        number(change.value),
        number(change.std_error, 2),
        units,
        number(change.f_ratio),
    )
    return [Table(("term", "time, s", "Mach", "more by", "+-", "units", "F"), [row], WHERE_IT_DIFFERS)]


def prediction_charts(result: Prediction) -> list[Chart]:
    """Errors as shares of that without a model, over the whole record and by region."""
    known = _errors(result)
    shares = [100.0 * value / result.error.without for _, value in known]
    names = [f"{interval((region.start_s, region.stop_s))} s" for region in result.regions]
    ratios = [100.0 * region.ratio for region in result.regions]
    title = "mean square over that without a model, %"
    return [
        band_chart(result),
        Chart("errors", "Errors of the moments", title, [Panel("", [_bars([name for name, _ in known], shares)])]),
        Chart("regions", "Frozen model, by region", title, [Panel("", [_bars(names, ratios)])]),
    ]


def band_chart(result: Prediction) -> Chart:
    """C_m and C_n as measured, over the band in which the frozen model predicts them, noise included."""
    band, panels = result.band, []
    time = thinned(band.time_s)
    scale = scale_of(*band.measured, *band.predicted)
    for name, measured, predicted, width in zip(
        BODY, band.measured, band.predicted, band.half_width, strict=True
    ):
        centre, half = scale.drawn(thinned(predicted)), scale.drawn(thinned(width))
        panels.append(
            Panel(
                f"{name}{scale.suffix}",
                [
                    Band(time, centre - half, centre + half, f"{100.0 * band.level:.0f} % band", "first"),
                    Line(time, scale.drawn(thinned(measured)), "measured", "measured", dots=True),
                    Line(time, centre, "first", "predicted"),
                ],
            )
        )
    heading = f"Moments in the {100.0 * band.level:.0f} % predictive band ({100.0 * band.inside:.1f} % inside)"
    span = (result.flight.start_s, result.flight.stop_s)
    read = "The band holds the noise, the errors of the coefficients and what the model left where it was found."
    return Chart("band", heading, TIME, panels, over_time=True, range=span, caption=read)


def _bars(names: list[str], percent: list[float]) -> Bars:
    return Bars(names, percent, [_percent(value) for value in percent])


def _percent(value: float) -> str:
    """A share at two digits however small it is: they tell a model's errors apart from the noise's."""
    return f"{number(value, 2)} %"


def _errors(result: Prediction) -> list[tuple[str, float]]:
    error = result.error
    return [
        ("nothing", error.without),
        ("the frozen model", error.frozen),
        ("the model fitted here", error.own),
        ("all but noise", error.noise),
    ]
