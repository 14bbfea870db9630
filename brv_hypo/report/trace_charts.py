"""The charts of a trace: the moments with the model, the residual before and after, the motion."""

from __future__ import annotations

from brv_hypo.report.attitude import attitude_chart
from brv_hypo.report.chart import Chart
from brv_hypo.report.motion_charts import (
    BODY,
    Drawn,
    Setting,
    difference,
    knots_of,
    moment_chart,
    motion_chart,
    residual_chart,
    spectrum_chart,
    turning_rates,
)
from brv_hypo.residuals.result import Trace


def trace_charts(result: Trace) -> list[Chart]:
    """Every chart that the trace has the data for; none where the residual was not kept."""
    picture = result.picture
    if picture is None:
        return []
    span = (result.flight.start_s, result.flight.stop_s)
    setting = Setting(span, knots_of(result.model.terms, *span))
    models = [Drawn("before", picture.before, "second"), Drawn("after", picture.after, "first")]
    heading = "Residual moments, before and after"
    rates = turning_rates(picture.roll_rate_rad_s, picture.windward_meridian_rate_rad_s)
    model = Drawn("model", difference(picture.measured, picture.after), "first")
    charts = [
        moment_chart(setting, picture.time_s, picture.measured, picture.sigma, [model], BODY),
        residual_chart(setting, picture.time_s, picture.sigma, models, BODY, heading),
        spectrum_chart(
            setting,
            picture.time_s,
            {
                "measured": (picture.measured, "measured"),
                "before": (picture.before, "second"),
                "after": (picture.after, "first"),
            },
            rates,
        ),
    ]
    if picture.alpha_rad:
        angles = (picture.alpha_rad, picture.windward_meridian_rad)
        sigmas = (picture.alpha_sigma_rad, picture.windward_meridian_sigma_rad)
        charts.append(motion_chart(setting, picture.time_s, *angles, *sigmas))
        charts.append(attitude_chart(setting, picture.time_s, *angles, picture.roll_rate_rad_s))
    return charts
