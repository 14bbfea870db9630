"""Charts of a motion and of moments over time, angle of attack and frequency, for whatever result has them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.signal import welch
from scipy.special import ndtri

from brv_hypo.arrays import FloatArray
from brv_hypo.comparison.result import MotionHistories, RecordError, TermEstimate
from brv_hypo.flight.record import RecordFault
from brv_hypo.inference.derivatives import Derivative
from brv_hypo.io.text import RAISED
from brv_hypo.likelihood.statistics import whiteness
from brv_hypo.linearisation.nuisance import beyond_level
from brv_hypo.report import document
from brv_hypo.report.document import LARGE, Band, Bars, Chart, Layer, Line, Mark, Panel, Role, Span, Values

_BULK = (0.01, 0.99)  # quantiles of the values that a frame always holds
_FAR = 3.0  # times the width of the bulk that all values take, beyond which the rest of them lies outside the frame
_BESIDE = 0.5  # widths of the bulk that are shown on both sides of it then
_FAR_WIDER = 5.0
"""Times the width of histories that their noise's band takes, beyond which they would be a flat line before it."""
IN_PLANE, OUT_OF_PLANE = "in plane<br>C<sub>m,in</sub>", "out of plane<br>C<sub>n,side</sub>"  # a panel is no longer
BODY = ("pitch, C<sub>m</sub>", "yaw, C<sub>n</sub>")
TIME = "time, s"
_GYROS = "Band: white noise of the gyros; compare judges by the noise that the record shows, which may be larger."
COLOURED = " Neighbouring rows are not independent: standard errors and evidence count fewer, independent ones."
_SHARE, _MARGIN = 0.98, 2.0
"""A spectrum is shown up to this multiple of the frequency below which this share of its first history's power lies."""
_WHOLE = 0.99  # share of the record from which on a fault is one of the record as such, and no part of it is masked
_NARROWEST = 0.003  # share of the record that a shaded interval takes at least, to be visible
_APART = 0.01  # share of the record that lies between two knots at least: nearer, two dashed lines look like one
_ONE_MACH = 0.05  # range of Mach numbers over the largest, below which a flight has one, and is drawn over time
_ERRORS = 12  # of the record, that are drawn
_LAGS, _QUANTILES = 40, 200  # of a residual, that are drawn
_MIDDLE = 5.0  # px: of dots that show around small ones on them, or have errors
_SHADED = "masked or replaced"  # samples, in the legend
_SEGMENT = 512  # samples of a segment of a spectrum, at most
STATIC = (
    *("static-slope", "Slope of the static moment", "C<sub>m,in</sub> by alpha, 1/rad"),
    "Of model and processes together. Quote it at the angle flown: where no sample is near alpha = 0 (dotted), it is "
    "extrapolated, and compare and trace may differ.",
)
DAMPING = ("damping", "Damping, processes included", "C<sub>mq</sub>, 1/rad")


def framed(panel: Panel, floor: float = -np.inf) -> Panel:
    """The panel, with a range where outliers or a wide band would flatten its histories; nothing lies below `floor`."""
    shown, edges = _values(panel, Line), _values(panel, Band)
    if not shown.size:
        return panel
    low, high = _of_bulk(shown)
    width = high - low
    if edges.size and np.ptp(edges) > _FAR_WIDER * width > 0.0:
        return replace(panel, range=(max(low - width, floor), high + width))
    if (low, high) != (np.min(shown), np.max(shown)):
        return replace(panel, range=(max(low, floor), high))
    return panel


def cut_text(panels: Sequence[Panel]) -> str:
    """What lies beyond the frames, in a sentence; empty where nothing does."""
    few = "A few values far from all others lie beyond the frame."
    for kind, said in ((Line, few), (Band, "The band goes beyond the frame.")):
        for panel in panels:
            low, high = panel.range or (-np.inf, np.inf)
            if np.any((values := _values(panel, kind)) < low) or np.any(values > high):
                return said
    return ""


def _of_bulk(values: FloatArray) -> tuple[float, float]:
    """Least and greatest of the values; where a few are far from all others, of the bulk with some room beside it."""
    low, high = float(np.min(values)), float(np.max(values))
    first, last = (float(edge) for edge in np.quantile(values, _BULK))
    width = last - first
    if not high - low > _FAR * width > 0.0:
        return low, high
    return max(low, first - _BESIDE * width), min(high, last + _BESIDE * width)


def _values(panel: Panel, kind: type[Line] | type[Band]) -> FloatArray:
    """The finite values of the panel's lines, or of the edges of its bands."""
    layers = [layer for layer in panel.layers if isinstance(layer, kind) and not getattr(layer, "hidden", False)]
    sides = [side for each in layers for side in ((each.y,) if isinstance(each, Line) else (each.low, each.high))]
    values: FloatArray = np.concatenate([np.zeros(0), *(np.asarray(side, dtype=float) for side in sides)])
    return values[np.isfinite(values)]


def scale_of(*moments: FloatArray) -> tuple[float, str]:
    """Factor and suffix of an axis, powers of a thousand, with which the largest of the values is from 0.1 to 100."""
    size = max((float(np.nanmax(np.abs(values))) for values in moments if np.any(np.isfinite(values))), default=0.0)
    power = 3 * max(math.ceil(-(1.0 + math.log10(size or 1.0)) / 3.0), 0)
    return 10.0**power, f" · 10{str(power).translate(RAISED)}" if power else ""


@dataclass(frozen=True)
class Setting:
    """What all charts over time of one flight share."""

    span: tuple[float, float]  # of the record, s
    knots: Sequence[float] = ()  # to mark, s
    shaded: Sequence[Span] = ()
    suffix: str = ""  # of file names, which distinguishes the flights of one result
    which: str = ""  # the same in headings

    def chart(self, name: str, heading: str, panels: Sequence[Panel], *read: str) -> Chart:
        """A chart over this flight's time."""
        return Chart(
            f"{name}{self.suffix}",
            f"{heading}{self.which}",
            TIME,
            panels,
            over_time=True,
            range=self.span,
            marks=[Mark(knot) for knot in self.knots],
            spans=self.shaded,
            caption=" ".join(filter(None, read)),
            dashed="knots" if self.knots else "",
        )


@dataclass(frozen=True)
class Drawn:
    """One model's moments (2, n) in a chart, in plane and out of it, or pitch and yaw; `hidden` as that of a `Line`."""

    name: str
    moments: FloatArray
    role: Role
    hidden: bool = False


def moment_chart(
    setting: Setting,
    time: Values,
    sigma: Values,
    models: Sequence[Drawn],
    measured: FloatArray | None = None,
    titles: Sequence[str] = (IN_PLANE, OUT_OF_PLANE),
    caption: str = "",
    dots: str = "measured",
) -> Chart:
    """Models, the last one on top, over measured moments within two standard deviations; else residuals by noise."""
    panels = _panels(titles, time, models, measured, sigma, named=dots)
    cut = cut_text(panels)
    if measured is None:
        return setting.chart("residuals", "Residual moments", panels, caption, _GYROS, cut)
    heading = "Moments, measured and modelled" if models else "Moments"
    return setting.chart("moments", heading, panels, caption, cut)


def moment_by_alpha_chart(
    setting: Setting,
    alpha: Values,
    measured: FloatArray,
    models: Sequence[Drawn],
    name: str = "moment-by-alpha",
    heading: str = "Moments",
) -> Chart:
    """Moments over the angle of attack: what a static moment makes a line, hysteresis makes a loop."""
    panels = _panels((IN_PLANE, OUT_OF_PLANE), np.degrees(alpha), models, measured, dots=True)
    title = f"{heading} against angle of attack{setting.which}"
    return Chart(f"{name}{setting.suffix}", title, "angle of attack, deg", panels, caption=cut_text(panels))


def _panels(
    titles: Sequence[str],
    x: Values,
    models: Sequence[Drawn],
    measured: FloatArray | None = None,
    sigma: Values | None = None,
    dots: bool = False,
    named: str = "measured",
) -> list[Panel]:
    """A panel for each moment: the measured one, if any, within its noise, and the models: below it as `dots`."""
    known = np.zeros((2, 0)) if measured is None else measured
    factor, suffix = scale_of(known, *(m.moments for m in models if not m.hidden))
    panels, size = [], _MIDDLE if dots else document.SMALL
    for k, title in enumerate(titles):
        layers: list[Layer] = []
        if sigma is not None:
            centre = np.zeros(len(x)) if measured is None else factor * measured[k]
            wide = 2.0 * (factor * np.asarray(sigma))
            layers.append(Band(x, centre - wide, centre + wide, "noise, ± 2 sigma"))
        layers += [Line(x, factor * m.moments[k], m.role, m.name, dots, size=size, hidden=m.hidden) for m in models]
        if measured is not None:  # above dots, below lines
            place = len(layers) if dots else len(layers) - len(models)
            layers.insert(place, Line(x, factor * measured[k], "measured", named, dots=True))
        panels.append(framed(Panel(f"{title}{suffix}", layers)))
    return panels


def spectrum_chart(setting: Setting, kept: MotionHistories, histories: Sequence[Drawn]) -> Chart:
    """Spectra of moments, both planes together, with the median frequencies of roll and meridian."""
    sample_rate = 1.0 / float(np.median(np.diff(kept.time_s)))
    moments = np.stack([each.moments for each in histories])
    moments = moments[:, :, np.all(np.isfinite(moments), axis=(0, 1))]
    frequency, spectra = welch(moments, fs=sample_rate, nperseg=min(_SEGMENT, moments.shape[2]))
    frequency = frequency[1:]  # from above zero
    powers = np.maximum(spectra.sum(axis=1), np.finfo(float).tiny)[:, 1:]
    most = float(frequency[np.searchsorted(np.cumsum(powers[0]), _SHARE * np.sum(powers[0]))])
    rates = {"roll": kept.roll_rate_rad_s, "meridian": kept.windward_meridian_rate_rad_s}
    marks = {name: float(np.median(np.abs(rate))) / (2.0 * np.pi) for name, rate in rates.items()}
    highest = min(_MARGIN * max([most, *marks.values()]), 0.5 * sample_rate)
    shown = frequency <= highest
    drawn = zip(histories, powers, strict=True)
    layers = [Line(frequency[shown], power[shown], each.role, each.name) for each, power in drawn]
    named = f"spectrum{setting.suffix}", f"Spectrum{setting.which}", "frequency, Hz"
    panels, lines = [Panel("power density, 1/Hz", layers, log=True)], [Mark(at, name) for name, at in marks.items()]
    read = "Measured moments and residuals, both planes together, Welch's method. Marked: medians of both rates."
    return Chart(*named, panels, range=(0.0, highest), marks=lines, caption=read)


def whiteness_charts(setting: Setting, whitened: Mapping[str, Values]) -> list[Chart]:
    """Autocorrelation and quantiles of a residual at unit noise by channel; nothing where it is not known."""
    known = {name: np.asarray(values, dtype=float) for name, values in whitened.items() if len(values) > _LAGS}
    if not known:
        return []
    wide = np.full(_LAGS, 2.0 / np.sqrt(min(values.size for values in known.values())))
    lags, shares = np.arange(1.0, _LAGS + 1.0), (np.arange(_QUANTILES) + 0.5) / _QUANTILES
    correlations: list[Layer] = [Band(lags, -wide, wide, "± 2 sigma")]
    quantiles: list[Layer] = [Line([-3.0, 3.0], [-3.0, 3.0], "guide", "normal", dashed=True)]
    roles: tuple[Role, ...] = ("measured", "first", "second", "third")
    for (name, values), role in zip(known.items(), roles, strict=False):
        products = np.correlate(values, values, "full")[values.size - 1 :]
        correlations.append(Line(lags, products[1 : _LAGS + 1] / products[0], role, name))
        quantiles.append(Line(ndtri(shares), np.quantile(values, shares), role, name, dots=True))
    coloured = [name for name, each in known.items() if not whiteness([each[np.newaxis]], _LAGS)[0].white]
    read = "Whitened residual of all that is fitted, processes included, in axes that do not roll."
    found = f" Band: of one lag; one in twenty is outside by chance. {_LAGS} lags together (Ljung-Box, 1 %), not white"
    found += f": {', '.join(coloured) or 'none'}.{COLOURED if coloured else ''}"
    named = {
        "autocorrelation": ("Autocorrelation of the residual", "lag, rows", Panel("correlation", correlations), found),
        "quantiles": ("Quantiles of the residual", "quantile of normal noise", Panel("over the noise", quantiles), ""),
    }
    return [
        Chart(f"{name}{setting.suffix}", f"{heading}{setting.which}", x, [panel], caption=read + more)
        for name, (heading, x, panel, more) in named.items()
    ]


def errors_chart(errors: Sequence[RecordError]) -> Chart:
    """Errors of record and vehicle in units of their tolerances, the largest first."""
    known = sorted(errors[:_ERRORS], key=lambda each: -abs(each.tolerances))
    values, wide = [e.tolerances for e in known], [2.0 * e.std_error / e.tolerance for e in known]
    dots = Line(values, range(len(known)), "first", "± 2 sigma", dots=True, size=LARGE, spread=wide)
    panels = [Panel("", [dots], categories=[each.name for each in known])] if known else []
    beyond = beyond_level(len(errors))
    most = 1.1 * max([beyond, *(abs(v) + s for v, s in zip(values, wide, strict=True))])
    marks = [Mark(side * beyond) for side in (-1.0, 1.0)]
    read = (
        f"As fitted with model and processes; reconstruct fits them without. The largest of {len(errors)} seldom "
        f"exceeds {beyond:.1f} tolerances, or less where the data hardly determine it: those beyond are named above."
    )
    named, ends = ("errors", "Largest errors", "error over its tolerance"), (-most, most)
    dashed = f"{beyond:.1f} tolerances"
    return Chart(*named, panels, range=ends, marks=marks, caption=read, dashed=dashed)


def process_chart(
    setting: Setting, histories: Mapping[str, Any], units: Mapping[str, str], name: str, heading: str
) -> Chart:
    """Processes over time, those that have `units`, in their order; `histories` as `Series` has them."""
    roles: tuple[Role, ...] = ("first", "second", "third")
    panels = []
    for process, unit in units.items() if histories else ():
        layers: list[Layer] = []
        for (value, sigma), role in zip(histories[process], roles, strict=False):
            time, nth = np.linspace(*setting.span, len(value)), f"{role} shape or channel"
            layers += estimate(time, np.array(value), np.array(sigma), role, nth)
        title = process.replace("_change", "<br>_change") + ("" if unit == "1" else f", {unit}")
        panels.append(framed(Panel(title, layers)))
    return setting.chart(name, heading, panels, "Moments by the rms of their shape. Bands: 2 sigma.")


def shaded(faults: Iterable[RecordFault], length: float, gaps: Iterable[tuple[float, float]]) -> list[Span]:
    """Gaps, and intervals of faults; of single samples the first and the last; of what is of the whole record none."""
    narrow, found = _NARROWEST * length, [Span(*gap, "gap") for gap in gaps]
    for fault in faults:
        if fault.of_single_samples:
            found += [Span(at - 0.5 * narrow, at + 0.5 * narrow, _SHADED) for at in {fault.start_s, fault.stop_s}]
        elif fault.stop_s - fault.start_s < _WHOLE * length:
            found.append(Span(fault.start_s, max(fault.stop_s, fault.start_s + narrow), _SHADED))
    return sorted(found, key=lambda each: each.start)


def knots_of(terms: Iterable[TermEstimate], start: float, stop: float) -> list[float]:
    """Times inside the record at which coefficients begin, change or end, as far as a chart shows them apart."""
    edges = {edge for term in terms if term.region_s is not None for edge in term.region_s}
    found: list[float] = []
    for edge in sorted(edge for edge in edges if start < edge < stop):
        if not found or edge - found[-1] >= _APART * (stop - start):
            found.append(edge)
    return found


def estimate(
    x: Values, value: FloatArray, sigma: FloatArray, role: Role = "first", name: str = "estimate", band: str = ""
) -> list[Band | Line]:
    """An estimate within two standard deviations, whose band has a name of its own where it is in the legend."""
    return [Band(x, value - 2.0 * sigma, value + 2.0 * sigma, band, role), Line(x, value, role, name)]


def derivative_chart(slope: Derivative, flights: int, anchor: str, heading: str, axis: str, read: str = "") -> Chart:
    """The moment or a derivative of it by Mach number, or by time where that is not known or stays about the same."""
    by_mach = bool(np.all(np.isfinite(slope.mach))) and np.ptp(slope.mach) > _ONE_MACH * max(slope.mach)
    x = np.array(slope.mach if by_mach else slope.time_s)
    order = np.argsort(x, kind="stable")
    flown, flown_sigma = np.array([slope.at_flown, slope.at_flown_std_error])[:, order]
    value, sigma = np.array([slope.at_zero, slope.at_zero_std_error])[:, order]
    by_angle = axis.endswith("1/rad")  # the moment itself goes up and down with the angle flown
    layers: list[Layer] = []
    if by_angle:
        layers += estimate(x[order], flown, flown_sigma, "second", "at the angle flown", "± 2 sigma")
    if np.any(beyond := np.array(slope.extrapolated)[order]):
        layers.append(Line(x[order], value, "first", "extrapolated to alpha = 0", dashed=True))
    if np.any(near := ~beyond):  # which may be one place alone
        at, wide = x[order][near], 2.0 * sigma[near]
        layers.append(Line(at, value[near], "first", "at alpha = 0", dots=True, size=_MIDDLE, error=(wide, wide)))
    panel = Panel(axis, layers)
    edges = _values(panel, Band if by_angle else Line)
    panels = [panel if _of_bulk(edges) == (edges.min(), edges.max()) else replace(panel, range=_of_bulk(edges))]
    suffix, which = ("", "") if flights == 1 else (f"-{slope.flight + 1}", f", flight {slope.flight + 1}")
    stable = "Negative is stable." if by_angle else ""
    read = " ".join(filter(None, (read, stable, "Bands and bars: two standard deviations.", cut_text(panels))))
    return Chart(f"{anchor}{suffix}", f"{heading}{which}", "Mach number" if by_mach else TIME, panels, caption=read)


def flight_charts(setting: Setting, kept: MotionHistories) -> list[Chart]:
    """Air data, where Mach numbers are known, motion and attitude."""
    pressure = Line(kept.time_s, 1e-3 * np.array(kept.dynamic_pressure_pa), "measured")
    panels = [Panel("Mach number", [Line(kept.time_s, kept.mach, "measured")]), Panel("q<sub>∞</sub>, kPa", [pressure])]
    known = [setting.chart("air", "Mach number and dynamic pressure", panels)] if np.all(np.isfinite(kept.mach)) else []
    return [*known, motion_chart(setting, kept), attitude_chart(setting, kept)]


def motion_chart(setting: Setting, kept: MotionHistories) -> Chart:
    """Angle of attack and windward meridian, within two standard deviations."""
    degrees, wrapped = np.degrees(kept.alpha_rad), document.wrapped_degrees(kept.windward_meridian_rad)
    wide, turn = (2.0 * np.degrees(each) for each in (kept.alpha_sigma_rad, kept.windward_meridian_sigma_rad))
    turn = np.minimum(turn, 180.0)  # an angle that is not determined lies anywhere, and no further
    alpha, meridian = (Line(kept.time_s, values, "measured", "estimate") for values in (degrees, wrapped))
    band = Band(kept.time_s, np.maximum(degrees - wide, 0.0), np.minimum(degrees + wide, 180.0))
    turning: list[Layer] = [Band(kept.time_s, wrapped - turn, wrapped + turn), meridian]
    panels = [framed(Panel("α, deg", [band, alpha]), 0.0), Panel("φ<sub>w</sub>, deg", turning, range=(-190.0, 190.0))]
    ends = "The line of the meridian, from -180 to 180 deg, breaks where it passes from one end to the other."
    return setting.chart("motion", "Angle of attack and windward meridian", panels, ends, cut_text(panels))


def attitude_chart(setting: Setting, kept: MotionHistories) -> Chart:
    """Pitch against yaw angle in axes that do not roll: theta = alpha cos(lambda), psi = alpha sin(lambda). lambda =
    phi - phi_w, with the roll angle phi integrated from the roll rate (Eq. 2.7, small psi), from nought where the
    record begins, be it before the histories. One panel for every few cycles, in order of time and at one scale.
    """
    t, amplitude = np.array(kept.time_s), np.degrees(kept.alpha_rad)
    before = kept.roll_rate_rad_s[0] * (t[0] - setting.span[0])
    turned = before + cumulative_trapezoid(kept.roll_rate_rad_s, t, initial=0) - np.array(kept.windward_meridian_rad)
    theta, psi = amplitude * np.cos(turned), amplitude * np.sin(turned)
    # how often the path goes round: its length over the circumference of a circle of its size
    length, size = np.sum(np.hypot(np.diff(theta), np.diff(psi))), np.sqrt(np.mean(theta**2 + psi**2))
    cycles = max(float(length / (2.0 * np.pi * size)), 1.0) if size > 0.0 else 1.0
    path, panels = document.PlanePath(t, psi, theta, "theta, deg", cycle=float(t[-1] - t[0]) / cycles), []
    edges = np.linspace(t[0], t[-1], path.intervals + 1)
    digits = max(0, 1 - int(np.floor(np.log10((edges[1] - edges[0]) or 1.0))))
    for start, stop in pairwise(edges):  # each up to where the next begins
        inside = slice(int(np.searchsorted(t, start)), int(np.searchsorted(t, stop)) + 1)
        line = Line(psi[inside], theta[inside], "measured", "path")
        first = Line(line.x[:1], line.y[:1], "second", "start", dots=True, size=LARGE)
        panels.append(Panel(f"{start:.{digits}f}–{stop:.{digits}f} s", [line, first]))
    read = (
        "Attitude to the wind in axes that do not roll; the roll angle counts from the start. A circle is coning, a "
        "line planar motion, a centre off the middle a trim that does not roll."
    )
    read += " Each interval begins at the dot." if len(panels) > 1 else ""
    named = f"theta-psi{setting.suffix}", f"Pitch against yaw{setting.which}", "psi, deg"
    return Chart(*named, panels, path=path, caption=read)


def share_bars(shares: Mapping[str, float], written: Callable[[float], str], roles: Mapping[str, Role]) -> list[Panel]:
    """Bars of those that are known, in percent, of the first role unless `roles` says; nothing where none is."""
    known = {name: value for name, value in shares.items() if np.isfinite(value)}
    bars = [Bars([name], [100.0 * each], [written(each)], roles.get(name, "first")) for name, each in known.items()]
    return [Panel("", bars)] if bars else []
