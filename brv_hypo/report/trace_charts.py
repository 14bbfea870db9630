"""The charts of a trace: the moments with the model, the residual before and after, the motion."""

from __future__ import annotations

import numpy as np

from brv_hypo.report.attitude import attitude_chart
from brv_hypo.report.chart import Band, Chart, Layer, Line, Panel, Role, Values
from brv_hypo.report.frames import cut_text, framed
from brv_hypo.report.motion_charts import (
    BODY,
    TIME,
    Drawn,
    Setting,
    caption,
    difference,
    knots_of,
    moment_chart,
    motion_chart,
    residual_chart,
    spectrum_chart,
    turning_rates,
)
from brv_hypo.residuals.result import StaticSlope, Trace


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
        *(static_slope_chart(slope, len(result.static_slopes)) for slope in result.static_slopes),
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


def static_slope_chart(slope: StaticSlope, flights: int) -> Chart:
    """The slope of the static moment by Mach number, or by time where that is not known or stays the same."""
    by_mach = bool(np.all(np.isfinite(slope.mach))) and np.ptp(slope.mach) > 0.0
    x = np.array(slope.mach if by_mach else slope.time_s)
    order = np.argsort(x, kind="stable")
    layers = [
        *_estimate(x[order], np.array(slope.at_flown)[order], np.array(slope.at_flown_std_error)[order], "second",
                   "at the angle flown"),
        *_estimate(x[order], np.array(slope.at_zero)[order], np.array(slope.at_zero_std_error)[order], "first",
                   "at no angle of attack"),
    ]  # fmt: skip
    panels = [framed(Panel("C<sub>N</sub>′ by alpha, 1/rad", layers))]
    suffix, which = ("", "") if flights == 1 else (f"-{slope.flight + 1}", f", flight {slope.flight + 1}")
    read = "Negative is stable. Bands: two standard deviations of the coefficients."
    return Chart(
        f"static-slope{suffix}",
        f"Slope of the static moment{which}",
        "Mach number" if by_mach else TIME,
        panels,
        caption=caption(read, cut_text(panels)),
    )


def _estimate(x: Values, value: np.ndarray, sigma: np.ndarray, role: Role, name: str) -> list[Layer]:
    """A line within two standard deviations."""
    return [Band(x, value - 2.0 * sigma, value + 2.0 * sigma, "", role), Line(x, value, role, name)]
