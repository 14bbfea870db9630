"""What charts show, and how pages and picture files draw it."""

from __future__ import annotations

import base64
import io
import json
import re
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from brv_hypo.comparison import CompareConfig, Comparison, compare
from brv_hypo.comparison.result import NetInterval
from brv_hypo.docs import text
from brv_hypo.io.text import hypothesis
from brv_hypo.report.comparison import comparison_document
from brv_hypo.report.document import (
    LARGE,
    MOST_POINTS,
    Band,
    Bars,
    Chart,
    Document,
    Line,
    Mark,
    Panel,
    Span,
    Table,
    Texts,
    wrapped_degrees,
)
from brv_hypo.report.figures import chart_figure
from brv_hypo.report.html import page, plotly_chart
from brv_hypo.report.motion_charts import STATIC, Setting, attitude_chart, derivative_chart, process_chart, scale_of
from brv_hypo.report.reconstruction import reconstruction_charts, record_charts
from brv_hypo.report.terminal import terminal_view
from brv_hypo.report.write import RESOLUTION, draw_into
from brv_hypo.simulation import load_config, simulate
from tests.chains import compared_sticking, histories, reconstructed
from tests.flights import nominal

ZERO = SimpleNamespace(value=0.0, std_error=0.0)


@pytest.fixture(scope="module")
def comparison() -> Comparison:
    cone = load_config("research_cone").model_copy(update={"duration": 2.0, "sample_rate": 100.0, "step": 0.01})
    flights = [simulate(cone, seed=seed).flight for seed in (5, 6)]
    return compare(flights, CompareConfig(mechanisms=("bodyfixed",), knot_count=3, maximum_likelihood="none"))


@pytest.fixture(scope="module")
def planted() -> Comparison:
    return compared_sticking()


@pytest.fixture(scope="module")
def planted_charts(planted) -> dict[str, Chart]:
    return {chart.name: chart for chart in comparison_document(planted).charts}


@pytest.fixture(scope="module")
def charts(comparison) -> dict[str, Chart]:
    return {chart.name: chart for chart in comparison_document(comparison).charts}


def values(packed) -> np.ndarray:
    return np.frombuffer(base64.b64decode(packed["bdata"]), dtype="<f4")


def test_every_flight_has_its_histories(charts) -> None:
    for name in ("moments", "residuals", "motion", "theta-psi", "spectrum", "moment-by-alpha"):
        assert {f"{name}-1", f"{name}-2"} <= set(charts)


def test_best_by_size_begin_with_the_baseline_and_have_the_definition_of_cp(comparison, charts) -> None:
    """C_p of the baseline only is that of the ranking; a term more lowers the residual, and counts twice."""
    sized = comparison.best_by_size
    none = next(row for row in comparison.ranking if row.mechanism == "none")
    assert [each.n_terms for each in sized] == sorted({each.n_terms for each in sized})
    assert (sized[0].n_terms, sized[0].terms) == (0, ())
    assert sized[0].cp == pytest.approx(none.cp, rel=1e-9)
    assert all(after.cp <= before.cp + 2.0 * (after.n_terms - before.n_terms) for before, after in pairwise(sized))
    line, best, *dots = charts["cp"].panels[0].layers
    assert list(line.x) == list(line.y)
    assert list(best.x) == [each.n_coefficients for each in sized]
    lines = {part for each in dots for label in each.labels for part in label.split("\n") if part}
    assert lines == {part for row in comparison.ranking for part in hypothesis(row.mechanism).split(" ")}


def cone(cycles: float) -> Chart:
    """Pitch against yaw of a body that cones `cycles` times in 20 s, at 3 deg, and does not roll."""
    time = np.linspace(0.0, 20.0, 2001)
    meridian = -2.0 * np.pi * cycles * time / 20.0
    return attitude_chart(Setting((0.0, 20.0)), histories(time, np.full(2001, np.radians(3.0)), meridian))


@pytest.mark.parametrize(("cycles", "stretches"), [(0.4, 1), (4, 1), (8, 2), (20, 8), (90, 16)])
def test_pitch_against_yaw_is_drawn_a_few_cycles_at_a_time(cycles, stretches) -> None:
    """Stretches follow each other without a gap, each with its times above it and its first point marked."""
    panels = cone(cycles).panels
    assert len(panels) == stretches
    ends = [panel.title.removesuffix(" s").split("–") for panel in panels]
    assert (ends[0][0], ends[-1][1]) in {("0", "20"), ("0.0", "20.0"), ("0.00", "20.00")}
    assert [stop for _, stop in ends[:-1]] == [start for start, _ in ends[1:]]
    paths = [panel.layers[0] for panel in panels]
    assert sum(len(path.x) for path in paths) == 2001 + stretches - 1
    assert all((path.x[-1], path.y[-1]) == (after.x[0], after.y[0]) for path, after in pairwise(paths))
    assert all(list(panel.layers[1].x) == [path.x[0]] for panel, path in zip(panels, paths, strict=True))
    np.testing.assert_allclose([np.hypot(path.x, path.y).max() for path in paths], 3.0)


def test_stretches_of_a_path_are_squares_at_one_scale_in_a_picture() -> None:
    figure = chart_figure(cone(90))
    assert len({(*axes.get_xlim(), *axes.get_ylim()) for axes in figure.axes}) == 1
    assert figure.axes[0].get_xlim() == pytest.approx((-3.15, 3.15))
    assert [axes.get_title() for axes in figure.axes] == [panel.title for panel in cone(90).panels]


def test_the_likeliest_mechanism_alone_is_drawn_against_the_angle_of_attack(comparison, charts) -> None:
    rest, made, _ = comparison.series[0].alone
    below, above = charts["excess-by-alpha-1"].panels[1].layers
    factor, suffix = scale_of(np.array(rest), np.array(made))
    np.testing.assert_allclose(above.y, factor * np.array(rest[1]))
    np.testing.assert_allclose(below.y, factor * np.array(made[1]))
    assert charts["excess-by-alpha-1"].panels[1].title.endswith(suffix)
    assert above.size < below.size
    assert "cancel the moment" in charts["excess-by-alpha-1"].caption


def test_the_leader_is_drawn_as_it_was_judged(planted) -> None:
    """A baseline that leads by a process would seem refuted without it: that line is hidden until it is wanted."""
    series, name = planted.series[0], planted.ranking[0].mechanism
    measured = np.array(series.measured)
    far = series.model_copy(update={"fitted": dict.fromkeys(series.fitted, tuple(map(tuple, measured + 1.0)))})
    drawn = {c.name: c for c in comparison_document(planted.model_copy(update={"series": (far,)})).charts}
    for plane, panel in enumerate(drawn["moments"].panels):
        lines = {layer.name: layer for layer in panel.layers if isinstance(layer, Line) and not layer.dots}
        assert [each.hidden for each in lines.values()] == [False, False, True]
        assert np.nanmax(np.abs(np.array(lines[name].y) - 1e3 * measured[plane])) < 1.0
        assert np.nanmin(np.array(lines["no processes"].y) - 1e3 * measured[plane]) > 999.0
    traces = {each["name"]: each for each in plotly_chart(drawn["moments"])["traces"]}
    assert traces["no processes"]["visible"] == "legendonly"
    _, names = chart_figure(drawn["moments"]).axes[0].get_legend_handles_labels()
    assert "no processes" not in names


def test_the_overview_has_the_moment_without_the_rest_and_the_leaders_fit(planted, planted_charts) -> None:
    """Both differ by noise, and where the leader does not act both are zero; its onset and end are marked."""
    measured, made, summed = (np.array(each) for each in planted.series[0].alone)
    time, known = np.array(planted.series[0].time_s), np.isfinite(measured[0])
    marks = {mark.name: mark.at for mark in planted_charts["overview"].marks if mark.name}
    assert set(marks) <= {"onset", "end"}
    before, after = known & (time < marks["onset"] - 0.1), known & (time > marks["onset"] + 0.1)
    size = np.sqrt(np.mean(made[1, after] ** 2))
    for some in (before, after):
        assert np.sqrt(np.mean((measured - made)[1, some] ** 2)) < 0.2 * size
    assert np.sqrt(np.mean(measured[1, before] ** 2)) < 0.2 * size
    dots, whole, line = planted_charts["overview"].panels[1].layers[1:]
    np.testing.assert_allclose(dots.y, 1e3 * measured[1])
    np.testing.assert_allclose(line.y, 1e3 * made[1])
    np.testing.assert_allclose(whole.y, 1e3 * summed[1])
    assert np.nanmax(np.abs(summed - made)) < 0.2 * size  # no process is large here


def test_the_overview_is_that_of_a_leader_that_is_undecided_too_and_no_chart_is_drawn_twice(planted) -> None:
    undecided = planted.verdict.model_copy(update={"winner": None, "outcome": "undecided"})
    baseline = planted.ranking[0].model_copy(update={"n_terms": 0, "mechanism": "none"})
    led = planted.model_copy(update={"ranking": (baseline, *planted.ranking)})
    for result, first in ((planted.model_copy(update={"verdict": undecided}), "overview"), (led, "moments")):
        charts = comparison_document(result).charts
        assert charts[0].name == first
        assert ("cancel the moment" in charts[0].caption) == (first == "overview")
        names = [chart.name for chart in charts]
        assert len(names) == len(set(names))
        assert "moments" in names


def test_histories_of_processes_are_drawn_in_the_units_of_the_table(planted) -> None:
    """Every shape or channel; a history's rms is at most about the size in the table: that of its splines'
    coefficients."""
    known, histories = planted.verdict.processes, planted.series[0].histories
    drawn = process_chart(Setting((0.0, 1.0)), histories, {each.name: each.units for each in known}, "processes", "All")
    titles = [panel.title.partition(",")[0].replace("<br>", "") for panel in drawn.panels]
    assert titles == [each.name for each in known]
    for each, panel in zip(known, drawn.panels, strict=True):
        lines = [layer.y for layer in panel.layers if isinstance(layer, Line)]
        assert len(lines) == len(histories[each.name])
        assert np.sqrt(np.mean(np.square(lines))) <= 1.5 * each.size


@pytest.mark.parametrize(
    ("largest", "factor", "suffix"),
    [
        (9.0, 1.0, ""),
        (0.4, 1.0, ""),
        (0.03, 1e3, " · 10³"),
        (2e-4, 1e3, " · 10³"),
        (3e-6, 1e6, " · 10⁶"),
        (0.0, 1.0, ""),
    ],
)
def test_an_axis_is_scaled_so_that_its_largest_value_is_legible(largest: float, factor: float, suffix: str) -> None:
    found = scale_of(np.array([np.nan, -largest]), np.zeros(0))
    assert found == (factor, suffix)
    assert not 0.0 < found[0] * largest < 0.1


def test_a_record_that_is_refused_is_not_said_to_be_without_fault() -> None:
    flight = nominal().flight
    refused = compare(replace(flight, q=-flight.q))
    assert refused.verdict.outcome == "record fault"
    assert "shows no fault" not in page(comparison_document(refused))


def test_the_manual_names_a_file_for_every_figure_of_the_report(charts) -> None:
    page = text("verdict").partition("### Figures of the report")[2]
    rows = [line.strip("|").split("|") for line in page.splitlines() if re.match(r"\| 5\.", line)]
    figures = {figure.strip() for row in rows for figure in row[0].split(",")}
    assert figures == {f"5.{number}" for number in range(1, 21)}
    files = {name for row in rows for name in re.findall(r"`([a-z-]+)`", row[2])} - {"reconstruct"}
    drawn_of_motion = {chart.name for chart in reconstruction_charts(reconstructed())}
    assert {name for name in files if f"{name}-1" not in charts} <= drawn_of_motion


def test_a_record_is_drawn_as_it_was_measured() -> None:
    """The nose turned by the rates: about the axis of the first sample's y it pitches, without end it yaws."""
    flight = nominal().flight
    time, zero = flight.time, np.zeros(flight.samples)
    still = replace(flight, p=zero, q=zero + 0.1, r=zero)
    drawn = {chart.name: chart for chart in record_charts(Setting((time[0], time[-1])), still)}
    pitch, yaw = (panel.layers[0].y for panel in drawn["integrated-attitude"].panels)
    np.testing.assert_allclose(pitch, np.degrees(0.1 * (time - time[0])), atol=1e-9)
    np.testing.assert_allclose(yaw, 0.0, atol=1e-9)
    np.testing.assert_allclose(drawn["rates"].panels[1].layers[0].y, np.degrees(0.1))
    np.testing.assert_allclose(drawn["accelerations"].panels[0].layers[0].y, flight.ax)


def test_the_leader_is_drawn_last(charts) -> None:
    for chart in (charts["moments-1"], charts["residuals-1"]):
        for panel in chart.panels:
            lines = [layer for layer in panel.layers if isinstance(layer, Line) and not (layer.dots or layer.hidden)]
            assert [layer.name for layer in lines] == ["bodyfixed", "baseline only"]


def test_coefficients_are_the_net_values_between_knots(planted, planted_charts) -> None:
    """And zero where nothing acts."""
    row = planted.ranking[0]
    (panel,) = planted_charts[f"coefficients-{row.mechanism}"].panels
    band, line = panel.layers
    known = [(value.value, value.std_error) for each in row.intervals for value in each.values or (ZERO,)]
    assert ZERO.value in line.y
    np.testing.assert_allclose(line.x, [end for each in row.intervals for end in (each.start_s, each.stop_s)])
    np.testing.assert_allclose(line.y, np.repeat([value for value, _ in known], 2))
    np.testing.assert_allclose(band.high - line.y, np.repeat([2.0 * sigma for _, sigma in known], 2))


def test_a_ramp_is_drawn_as_one(planted) -> None:
    """From the value before it to that after it, through the mean that the result has; thousandths if small."""
    row, units = planted.ranking[0], {"units": "1/rad"}
    term = row.terms[0].model_copy(update={"name": "ramp in C", "region_s": (1.0, 3.0), **units})
    means = ((0.0, 1.0, 0.0, 0.0), (1.0, 3.0, 2e-3, 1e-4), (3.0, 4.0, 4e-3, 2e-4))
    spans = [
        NetInterval(start_s=start, stop_s=stop, values=(term.model_copy(
            update={"name": "C", "value": mean, "std_error": sigma, "region_s": (start, stop)}),) if mean else ())
        for start, stop, mean, sigma in means
    ]  # fmt: skip
    for intervals in (spans, spans[:2]):
        ramp = row.model_copy(update={"terms": (term,), "intervals": tuple(intervals)})
        document = comparison_document(planted.model_copy(update={"ranking": (ramp, *planted.ranking[1:])}))
        chart = next(chart for chart in document.charts if chart.name == f"coefficients-{row.mechanism}")
        (panel,), count = chart.panels, 2 * len(intervals)
        band, line = panel.layers
        assert panel.title == "C · 10³, 1/rad"
        np.testing.assert_allclose(line.x, [0.0, 1.0, 1.0, 3.0, 3.0, 4.0][:count])
        np.testing.assert_allclose(line.y, [0.0, 0.0, 0.0, 4.0, 4.0, 4.0][:count])
        np.testing.assert_allclose(band.high - line.y, [0.0, 0.0, 0.0, 0.4, 0.4, 0.4][:count], atol=1e-12)


def test_a_band_is_two_standard_deviations_to_either_side(planted) -> None:
    """At the angle flown; at alpha = 0 dots with bars where samples are near it, elsewhere a dotted line without."""
    (known,) = planted.functions["C_malpha"]
    near = [(0.0 if k % 2 else high, high) for k, (_, high) in enumerate(known.alpha_ends_rad)]
    known = known.model_copy(update={"alpha_ends_rad": tuple(near)})
    band, flown, dotted, zero = derivative_chart(known, 1, *STATIC).panels[0].layers
    measured = ~np.array(known.extrapolated)
    assert dotted.dashed
    np.testing.assert_allclose(dotted.y, known.at_zero)
    np.testing.assert_allclose(zero.y, np.array(known.at_zero)[measured])
    np.testing.assert_allclose(zero.error, [2.0 * np.array(known.at_zero_std_error)[measured]] * 2)
    for edge in (band.high - flown.y, flown.y - band.low):
        np.testing.assert_allclose(edge, 2.0 * np.array(known.at_flown_std_error))


def test_the_moment_is_drawn_at_no_angle_of_attack_alone(planted, planted_charts) -> None:
    """At the angle flown it goes up and down with that."""
    (known,) = planted.functions["C_m0"]
    for layer in planted_charts["static-offset"].panels[0].layers:
        assert np.all(np.isin(layer.y, known.at_zero))


def test_a_meridian_is_wrapped_with_a_break_where_it_passes_the_end() -> None:
    turning = np.linspace(0.0, -100.0 * np.pi, 4001)
    degrees = wrapped_degrees(turning)
    known = np.isfinite(degrees)
    assert np.nanmax(np.abs(degrees)) <= 180.0
    assert 49 <= np.count_nonzero(~known) <= 51
    np.testing.assert_allclose(np.cos(np.radians(degrees[known])), np.cos(turning[known]), atol=1e-9)


def test_charts_over_time_share_the_span_of_the_record(comparison, charts) -> None:
    flight = comparison.flights[0]
    over_time = [chart for chart in charts.values() if chart.over_time and "-1" in chart.name]
    assert len(over_time) >= 4
    assert {chart.range for chart in over_time} == {(flight.start_s, flight.stop_s)}


class TestPlotlyChart:
    @pytest.mark.parametrize("time", [np.linspace(2.0, 5.0, 301), np.array([0.0, 1.0, 5.0])], ids=["even", "uneven"])
    def test_a_line_has_its_values_in_single_precision(self, time) -> None:
        (trace,) = plotly_chart(Chart("c", "h", "t", [Panel("y", [Line(time, time**2, "first", "a")])]))["traces"]
        np.testing.assert_allclose(values(trace["x"]), time, rtol=1e-6)
        np.testing.assert_allclose(values(trace["y"]), time**2, rtol=1e-6)

    def test_a_long_history_is_thinned(self) -> None:
        long = np.linspace(0.0, 1.0, 50_000)
        (trace,) = plotly_chart(Chart("c", "h", "t", [Panel("y", [Line(long, long, "first")])]))["traces"]
        assert MOST_POINTS // 2 < values(trace["y"]).size <= MOST_POINTS

    def test_a_name_is_in_the_legend_once(self) -> None:
        line = Line([0.0, 1.0], [0.0, 1.0], "first", "model")
        chart = plotly_chart(Chart("c", "h", "t", [Panel("a", [line]), Panel("b", [line])]))
        assert [trace["showlegend"] for trace in chart["traces"]] == [True, False]

    def test_a_band_with_breaks_is_closed_areas(self) -> None:
        low = np.array([0.0, 0.0, np.nan, 1.0, 1.0])
        (trace,) = plotly_chart(Chart("c", "h", "t", [Panel("y", [Band(np.arange(5.0), low, low + 1.0)])]))["traces"]
        assert trace["fill"] == "toself"
        np.testing.assert_allclose(values(trace["y"]), [0, 0, 1, 1, np.nan, 1, 1, 2, 2, np.nan])

    def test_a_logarithmic_axis_of_many_decades_has_ticks_at_powers_of_ten_alone(self) -> None:
        def ticks(highest: float) -> object:
            line = Line([1.0, 2.0, 3.0], [1.0, 2.0, highest], "first")
            return plotly_chart(Chart("c", "h", "t", [Panel("y", [line], log=True)]))["layout"]["yaxis"].get("dtick")

        assert ticks(5.0) is None
        assert ticks(1e3) == 1.0
        assert ticks(1e9) == 2.0

    def test_marks_are_drawn_below_their_names_and_spans_named_once_in_the_legend(self) -> None:
        """Names above spans would lie over those of marks, and over each other."""
        panels = [Panel("y", [Line([0.0, 9.0], [0.0, 1.0], "first")])]
        spans = [Span(3, 4, "masked"), Span(5, 6, "masked")]
        drawn = plotly_chart(Chart("c", "h", "t", panels, marks=[Mark(2.0, "knot")], spans=spans))
        layout = drawn["layout"]
        assert [(s["type"], s["x0"], s["x1"]) for s in layout["shapes"]] == [
            *(("rect", 3, 4), ("rect", 5, 6), ("line", 2.0, 2.0))
        ]
        assert [a["text"] for a in layout["annotations"]] == ["knot"]
        assert [trace["name"] for trace in drawn["traces"]] == ["", "masked"]


def test_pages_of_results_have_links_that_resolve_and_ids_given_once(comparison, planted) -> None:
    for one in (comparison, planted):
        html = page(comparison_document(one))
        ids, links = (re.findall(pattern, html) for pattern in (r' id="([^"]*)"', r' href="#([^"]*)"'))
        assert len(set(ids)) == len(ids)
        assert set(links) <= set(ids)
        assert html.count("<table>") == html.count('class="csv"') > 3
        assert re.search(r'<details>\s*<summary>\s*<h2 id="air-data-and-motion">', html)


def test_a_comparison_is_one_screen_of_80_columns(planted) -> None:
    console = Console(width=80, file=io.StringIO(), highlight=False, markup=False)
    console.print(terminal_view(comparison_document(planted)))
    lines = console.file.getvalue().splitlines()
    assert len(lines) <= 40
    assert max(map(len, lines)) <= 80


def test_the_residual_is_white_where_all_is_explained(planted, planted_charts) -> None:
    """Within its band in nine of ten lags, and along the line; the channels as measured are those of the model."""
    band, *lines = planted_charts["autocorrelation"].panels[0].layers
    inside = [np.mean(np.abs(line.y) < 1.5 * band.high) for line in lines]
    assert min(inside) > 0.8
    for line in planted_charts["quantiles"].panels[0].layers[1:]:
        assert np.polyfit(line.x, line.y, 1)[0] == pytest.approx(1.0, abs=0.2)
    for measured, modelled in planted.series[0].channels.values():
        assert np.std(np.subtract(measured, modelled)) < 0.05 * np.std(measured)


def test_functions_are_the_planted_ones(planted) -> None:
    """C_malpha and C_mq of the research cone, at no angle of attack."""
    for name, true in (("C_malpha", -0.0883), ("C_mq", -1.0)):
        (known,) = planted.functions[name]
        off = (np.array(known.at_zero) - true) / np.array(known.at_zero_std_error)
        assert np.sqrt(np.mean(off**2)) < 3.0


class TestPage:
    def test_it_says_where_it_came_from(self, comparison) -> None:
        html = page(
            comparison_document(comparison),
            {"made by": "brv-hypo compare f.h5", "settings": "{knot_count: 5}", "record f.h5": "SHA-256 ab12"},
        )
        for expected in ("brv-hypo compare f.h5", "{knot_count: 5}", "SHA-256 ab12", "<dt>version</dt>"):
            assert expected in html
        assert len(html) < 1_500_000

    def test_a_document_without_charts_needs_no_script(self) -> None:
        html = page(Document("t", (), "c", "words", True, [Texts(("said",))]))
        assert 'id="library"' not in html
        assert len(html) < 20_000

    def test_what_belongs_together_is_in_one_section(self) -> None:
        """A step's sentence, its table and its outcome; a chart and a heading begin anew."""
        chart = Chart("c", "h", "t", [Panel("y", [Line([0.0, 1.0], [0.0, 1.0], "first")])])
        blocks = (
            Texts(("residual",), "Step 1"), Table([{"effect": "lag"}]), Texts(("added",)), chart,
            Texts(("loose",)), Texts(("mind",), "Warnings", warning=True),
        )  # fmt: skip
        html = page(Document("t", (), "c", "words", True, blocks))
        sections = re.findall(r"<section[^>]*>(.*?)</section>", html, flags=re.DOTALL)
        assert len(sections) == 4
        assert all(word in sections[0] for word in ("Step 1", "lag", "added"))
        assert '<div class="warning">' in sections[3]
        assert 'class="warning"' not in sections[0]

    def test_text_is_escaped(self) -> None:
        table = Table([{"term": "<b>", "value": "1 & 2"}], "a < b")
        html = page(Document("<t>", ("<s>",), "c", "<c>", True, [table, Texts(("<x>",))]), {"made by": "<cmd>"})
        assert not any(tag in html for tag in ("<b>", "<s>", "<c>", "<x>", "<cmd>", "<t>"))
        assert "&lt;b&gt;" in html

    def test_charts_have_no_number_that_json_lacks(self, charts) -> None:
        for chart in charts.values():
            json.dumps(plotly_chart(chart), allow_nan=False)


class TestDrawing:
    @pytest.fixture
    def plain(self) -> Chart:
        time = np.linspace(0.0, 1.0, 50)
        dots = Line(time, time, "measured", "b", dots=True, size=LARGE, labels=["x"] * 50, error=(time, time))
        panels = [
            Panel("∂C<sub>N</sub>′/∂α", [Band(time, time, time + 1), Line(time, time, "first", "a")]),
            Panel("y", [dots]),
        ]
        return Chart("two panels", "h", "t", panels, marks=[Mark(0.5, "knot")], spans=[Span(0.1, 0.2)])

    @pytest.mark.thorough
    def test_the_same_chart_gives_the_same_bytes(self, plain) -> None:
        assert chart_figure(plain).content("svg", RESOLUTION) == chart_figure(plain).content("svg", RESOLUTION)
        assert chart_figure(plain).content("png", RESOLUTION).startswith(b"\x89PNG")

    @pytest.mark.thorough
    def test_files_are_named_by_the_chart_and_not_overwritten(self, plain, tmp_path) -> None:
        from brv_hypo.errors import UsageError

        bars = Chart("bars", "h", "x", [Panel("", [Bars(["a", "b"], [1.0, 2.0], ["one", "two"])])])
        written = draw_into(tmp_path / "figures", [plain, bars])
        assert sorted(path.name for path in written) == [
            "bars.png", "bars.svg", "two-panels.png", "two-panels.svg"
        ]  # fmt: skip
        assert b"<svg" in (tmp_path / "figures" / "two-panels.svg").read_bytes()
        with pytest.raises(UsageError, match="exists"):
            draw_into(tmp_path / "figures", [plain])

    def test_a_folder_that_cannot_be_made_is_refused(self, plain, tmp_path) -> None:
        from brv_hypo.errors import UsageError

        (tmp_path / "file").write_text("")
        with pytest.raises(UsageError, match="A file stands where a folder is needed"):
            draw_into(tmp_path / "file" / "figures", [plain])

    def test_a_result_without_charts_leaves_no_folder(self, tmp_path) -> None:
        assert draw_into(tmp_path / "figures", []) == ()
        assert not (tmp_path / "figures").exists()

    @pytest.mark.thorough
    def test_every_chart_of_a_comparison_can_be_drawn(self, charts) -> None:
        assert all(
            b"<svg" in chart_figure(chart).content("svg", RESOLUTION)
            for name, chart in charts.items()
            if name.endswith("-1")
        )

    def test_without_matplotlib_it_says_how_to_install_it(self, plain, tmp_path, monkeypatch) -> None:
        from brv_hypo.errors import UsageError
        from brv_hypo.report import write

        monkeypatch.setattr(write, "find_spec", lambda name: None)
        with pytest.raises(UsageError, match=r"pip install -e '.\[figures\]'"):
            draw_into(tmp_path, [plain])


def test_a_block_without_content_is_left_out() -> None:
    empty = (Table([]), Texts(()), Chart("c", "h", "x", ()))
    html = page(Document("t", (), "c", "words", True, empty))
    assert "<section" not in html
