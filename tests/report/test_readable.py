"""What makes charts and pages readable: nothing hides a name, and nothing drawn flattens what is beside it."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import replace
from urllib.parse import unquote

import numpy as np
import pytest

from brv_hypo.flight.record import RecordFault, RecordTrial
from brv_hypo.report.comparison import comparison_document
from brv_hypo.report.document import Band, Bars, Chart, Document, Line, Mark, Panel, Section, Span, Table, Texts, flat
from brv_hypo.report.figures import SMALLEST_DOT, chart_figure
from brv_hypo.report.html import page, plotly_chart, resource
from brv_hypo.report.motion_charts import (
    Drawn,
    Setting,
    attitude_chart,
    knots_of,
    moment_by_alpha_chart,
    moment_chart,
    shaded,
    whiteness_charts,
)
from brv_hypo.report.trace import trace_document
from tests.chains import compared_nominal, compared_sticking, histories, traced_trim

TIME = np.linspace(0.0, 5.0, 200)
WAVE = np.sin(TIME) / 1e3
SETTING = Setting((0.0, 5.0))


def sizes(least: float) -> Chart:
    """C_p over size of three near each other and one far below, of one size, and one of another."""
    comparison = compared_nominal()
    row = comparison.ranking[0]
    cps = {"a": (3, least), "b": (3, 9e3), "c": (3, 1e4), "d": (3, 1.1e4), "e": (4, 1e4)}
    rows = tuple(row.model_copy(update={"mechanism": name, "n_terms": n, "cp": cp}) for name, (n, cp) in cps.items())
    charts = comparison_document(comparison.model_copy(update={"ranking": rows, "series": ()})).charts
    return next(chart for chart in charts if chart.name == "cp")


def test_names_of_dots_near_each_other_are_in_one_label() -> None:
    """Beside the middle one, from top to bottom as they are."""
    for least in (1.0, -2e3):
        _, _, *dots = sizes(least).panels[0].layers
        assert [list(each.labels) for each in dots] == [["", "d\nc\nb", ""], ["a"], ["e"]]


def test_a_negative_criterion_is_drawn_where_it_is() -> None:
    (panel,) = sizes(-2e3).panels
    assert not panel.log
    assert [list(each.y) for each in panel.layers[3:4]] == [[-2e3]]
    assert "Below zero" in sizes(-2e3).caption
    assert sizes(1.0).panels[0].log
    assert "Below zero" not in sizes(1.0).caption


def test_what_is_correlated_beyond_the_band_is_named_with_what_that_means() -> None:
    rng = np.random.default_rng(5)
    white = {name: rng.standard_normal(600) for name in ("q", "r")}
    coloured = white | {"r": np.convolve(white["r"], np.ones(4))[:600]}
    for known, said in ((white, "none"), (coloured, "r")):
        autocorrelation, quantiles = whiteness_charts(SETTING, known)
        assert f"40 lags together (Ljung-Box, 1 %), not white: {said}." in autocorrelation.caption
        assert ("not independent" in autocorrelation.caption) == (said == "r")
        assert "band" not in quantiles.caption


def test_pitch_against_yaw_is_the_same_where_its_history_begins_later() -> None:
    time = np.linspace(0.0, 5.0, 501)
    parts = [histories(time[k:], np.full(501 - k, 0.05), 3.0 * time[k:]) for k in (0, 50)]
    rolling = [each.model_copy(update={"roll_rate_rad_s": np.full(len(each.time_s), 2.0)}) for each in parts]
    whole, later = (attitude_chart(SETTING, each).path for each in rolling)
    np.testing.assert_allclose(later.x, whole.x[50:], atol=1e-9)
    np.testing.assert_allclose(later.y, whole.y[50:], atol=1e-9)


def test_every_hypothesis_has_its_own_knots_marked() -> None:
    comparison = compared_nominal()
    rows = {row.mechanism: row for row in comparison.ranking}
    flight = comparison.flights[0]
    charts = [c for c in comparison_document(comparison).charts if c.name.startswith("coefficients-") and c.over_time]
    checked = 0
    for chart in charts:
        row = rows.get(chart.name.removeprefix("coefficients-"))
        if row is not None:
            checked += 1
            assert [mark.at for mark in chart.marks] == knots_of(row.terms, flight.start_s, flight.stop_s)
    assert checked >= 1


def test_dashed_lines_without_a_name_are_in_the_legend() -> None:
    line = Line([0.0, 4.0], [1.0, 2.0], "first", "estimate")
    chart = Setting((0.0, 4.0), [1.0, 2.0]).chart("moments", "Moments", [Panel("y", [line])])
    assert [trace["name"] for trace in plotly_chart(chart)["traces"] if trace["showlegend"]] == ["estimate", "knots"]
    (legend,) = chart_figure(chart).legends
    assert [text.get_text() for text in legend.get_texts()] == ["estimate", "knots"]


def test_knots_that_a_chart_cannot_show_apart_are_one_line() -> None:
    pulse = compared_nominal().baseline.terms[0].model_copy(update={"region_s": (2.0, 2.02)})
    wide = pulse.model_copy(update={"region_s": (3.0, 4.0)})
    assert knots_of([pulse, wide], 0.0, 6.0) == [2.0, 3.0, 4.0]


def test_terms_are_counted_in_whole_numbers() -> None:
    dots = Panel("y", [Line([0, 1], [2.0, 1.0], "first", dots=True)])
    chart = Chart("cp", "C_p", "terms", [dots], range=(-0.5, 2.0), counted=True)
    assert plotly_chart(chart)["layout"]["xaxis"]["dtick"] == 1
    assert all(at == round(at) for at in chart_figure(chart).axes[0].get_xticks())


def test_noise_that_is_far_wider_than_the_moments_does_not_flatten_them() -> None:
    large, quiet = np.linspace(1e-3, 1.0, 200), np.full(200, 1e-4)
    models = [Drawn("model", (WAVE, WAVE), "first")]
    for drawn in (moment_chart(SETTING, TIME, large, models, (WAVE, WAVE)), moment_chart(SETTING, TIME, large, models)):
        for panel in drawn.panels:
            low, high = panel.range
            assert low < -1.0 < 1.0 < high  # thousandths: all of the moments
            assert high - low < 10.0
        assert "beyond the frame" in drawn.caption
    assert all(panel.range is None for panel in moment_chart(SETTING, TIME, quiet, models, (WAVE, WAVE)).panels)


def test_a_fault_of_the_whole_record_is_not_shaded_as_masked() -> None:
    faults = [
        RecordFault(channel="p, q, r", fault="axes", start_s=0.0, stop_s=5.0, action=""),
        RecordFault(channel="q", fault="stuck", start_s=1.0, stop_s=2.0, action=""),
    ]
    assert shaded(faults, 5.0, [(3.0, 3.5)]) == [Span(1.0, 2.0, "masked or replaced"), Span(3.0, 3.5, "gap")]


def test_numbers_of_an_axis_have_an_exponent_where_they_need_one() -> None:
    """Below 1e-4 and from 1e5; powers of ten on a logarithmic axis of values are such numbers too."""
    layout = plotly_chart(Chart("c", "h", "t", [Panel("y", [Line(TIME, TIME, "first")])]))["layout"]
    for axis in (layout["xaxis"], layout["yaxis"]):
        assert (axis["exponentformat"], axis["minexponent"]) == ("power", 4)


def test_the_texts_of_bars_have_room_beside_them() -> None:
    bars = Bars(["a", "b"], [0.0, 3e-6], ["0 %", "3e-6 %"])
    chart = plotly_chart(Chart("c", "h", "share", [Panel("", [bars])]))
    assert chart["traces"][0]["textposition"] == "outside"
    axis = chart["layout"]["xaxis"]
    assert axis["range"][1] > 1.1 * 3e-6
    assert axis["exponentformat"] == "power"


def test_names_of_marks_are_above_the_frame_each_on_a_line_of_its_own() -> None:
    line = Panel("y", [Line(TIME, TIME, "first")])
    chart = plotly_chart(Chart("c", "h", "f", [line], marks=[Mark(1.2, "roll"), Mark(1.0, "meridian")]))
    names = {each["text"]: each for each in chart["layout"]["annotations"]}
    assert names["meridian"]["yshift"] > names["roll"]["yshift"] >= 0
    assert {each["xanchor"] for each in names.values()} == {"left"}


def test_names_of_marks_do_not_meet_in_a_figure() -> None:
    line = Panel("y", [Line(TIME, TIME, "first")])
    drawn = chart_figure(Chart("c", "h", "f", [line], marks=[Mark(1.0, "meridian"), Mark(1.1, "roll")]))
    drawn.canvas.draw()
    first, second = (text.get_window_extent() for text in drawn.axes[0].texts)
    assert not first.overlaps(second)


def test_panels_are_as_far_apart_however_many_there_are() -> None:
    def gap(count: int) -> float:
        chart = plotly_chart(Chart("c", "h", "t", [Panel("y", [Line(TIME, TIME, "first")])] * count))
        layout = chart["layout"]
        return (layout["yaxis"]["domain"][0] - layout["yaxis2"]["domain"][1]) * 190 * count

    assert gap(2) == pytest.approx(gap(5), rel=1e-6)


def test_small_dots_are_large_enough_in_the_legend_of_a_figure() -> None:
    dots = Line(TIME, TIME, "measured", "measured", dots=True)
    (legend,) = chart_figure(Chart("c", "h", "t", [Panel("y", [dots])])).legends
    assert legend.legend_handles[0].get_markersize() >= SMALLEST_DOT


class TestPage:
    def test_sections_flow_in_as_many_columns_as_their_blocks_allow(self) -> None:
        """Three of small blocks, two where one is wide or there are two, and one for words alone."""
        chart = Chart("c", "h", "t", [Panel("y", [Line([0.0, 1.0], [0.0, 1.0], "first")])])
        small, wide = chart, replace(chart, over_time=True)
        words, columns = Texts(("few",), "Notes"), Table([dict.fromkeys("abcdefghijk", "1")], "many")
        parts = {
            "three": [small] * 3,
            "two": [small] * 2,
            "half": [wide, small, small],
            "one": [words],
            "all": [columns],
        }
        html = page(Document("t", (), "c", "words", True, [Section(*part) for part in parts.items()]))
        assert re.findall(r'<div class="grid\s*(\w*)"', html) == ["narrow", "", "", "single", "single"]
        assert html.count('<section class="whole">') == 1

    def test_sections_fold_and_contents_lead_to_them(self) -> None:
        """Empty ones are left out; every link resolves, and no id is given twice."""
        chart = Chart("c", "h", "t", [Panel("y", [Line([0.0, 1.0], [0.0, 1.0], "first")])])
        table = Table([{"term": "a, b", "value": "1"}], "C_p <and> size")
        sections = [Section("Moments", [chart, table]), Section("All of it", [table], folded=True), Section("No", [])]
        html = page(Document("t", (), "c", "words", True, sections))
        assert re.findall(r"<details( open)?>", html) == [" open", ""]
        contents = re.search(r"<nav.*?</nav>", html, re.DOTALL)[0]
        assert re.findall(r'<a href="#([^"]*)">([^<]*)</a>', contents) == [
            ("moments", "Moments"), ("all-of-it", "All of it"),
        ]  # fmt: skip
        ids = re.findall(r' id="([^"]*)"', html)
        assert len(set(ids)) == len(ids)
        assert set(re.findall(r' href="#([^"]*)"', html)) <= set(ids)

    def test_every_table_is_a_csv_file(self) -> None:
        rows = [{"term": 'a, "b"', "value": "1"}, {"term": "<c>", "value": "–"}]
        html = page(Document("t", (), "c", "words", True, [Table(rows, "Terms", ("term",))]))
        assert 'download="table.csv"' in page(Document("t", (), "c", "words", True, [Table(rows)]))
        (content,) = re.findall(r'download="terms.csv" href="data:text/csv;charset=utf-8,([^"]*)"', html)
        assert list(csv.DictReader(io.StringIO(unquote(content)))) == rows

    def test_text_to_type_is_code_in_one_piece(self) -> None:
        words = "Check the tolerances (--instruments), or look with `brv-hypo trace`; free-form -- as <it> is."
        html = page(Document("t", (), "c", words, True, [Texts((words,))]))
        expected = (
            "Check the tolerances (<code>--instruments</code>), or look with <code>brv-hypo trace</code>; "
            "free-form -- as &lt;it&gt; is."
        )
        assert html.count(expected) == 2


class TestTrace:
    def test_the_model_is_drawn_over_the_measured_moments(self) -> None:
        result = traced_trim()
        charts = {chart.name: chart for chart in trace_document(result).charts}
        assert {"moments", "residuals", "spectrum", "motion", "theta-psi"} <= set(charts)
        model = charts["moments"].panels[0].layers[-1]
        picture = result.picture
        np.testing.assert_allclose(model.y, 1e3 * np.subtract(picture.measured[0], picture.after[0]))
        assert all(isinstance(panel.layers[0], Band) for panel in charts["motion"].panels)

    def test_a_record_that_contradicts_itself_is_reported_before_findings(self) -> None:
        sound = traced_trim()
        assert sound.record.sound
        fault = RecordFault(channel="q", fault="sign", start_s=0.0, stop_s=1.0, action="turn q over")
        doubted = sound.model_copy(update={"record": RecordTrial(sound=False, faults=(fault,))})
        document = trace_document(doubted)
        assert document.conclusion_title == "Record in doubt"
        assert document.conclusion.startswith("The record contradicts itself")
        assert not document.decided
        warnings = next(block for block in flat(document.blocks) if isinstance(block, Texts) and block.warning)
        assert "turn q over" in warnings.texts[0]


class TestContrast:
    """Of text 4.5 to 1 and of what is drawn 3 to 1 (WCAG 2.1), against the paper, in either scheme."""

    @staticmethod
    def schemes() -> list[dict[str, str]]:
        style = resource("page.css").decode()
        light, dark = re.findall(r":root[^{]*\{([^}]*)\}", style)[:2]
        return [dict(re.findall(r"--([a-z]+): (#[0-9a-f]{6})", each)) for each in (light, dark)]

    @staticmethod
    def luminance(colour: str) -> float:
        parts = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
        linear = np.where(parts <= 0.03928, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
        return float(linear @ [0.2126, 0.7152, 0.0722])

    @pytest.mark.parametrize("scheme", [0, 1])
    def test_everything_has_contrast_with_the_paper(self, scheme: int) -> None:
        colours = self.schemes()[scheme]
        paper = self.luminance(colours["paper"])
        text, drawn = ("ink", "quiet", "accent", "caution"), ("measured", "first", "second", "third", "none", "mark")
        for name in (*text, *drawn):
            brighter, darker = sorted((self.luminance(colours[name]), paper), reverse=True)
            assert (brighter + 0.05) / (darker + 0.05) >= (4.5 if name in text else 3.0), name


@pytest.mark.parametrize(("times", "factor", "suffix"), [(1.0, 1e3, " · 10³"), (2e4, 1.0, "")])
def test_coefficients_of_one_and_more_are_not_drawn_in_thousandths(times, factor, suffix) -> None:
    large = times * WAVE
    models = [Drawn("model", (large, large), "first")]
    for drawn in (
        moment_chart(SETTING, TIME, np.full(200, 1e-4), models, (large, large)),
        moment_chart(SETTING, TIME, np.full(200, 1e-4), models),
        moment_by_alpha_chart(SETTING, TIME, (large, large), models),
    ):
        for panel in drawn.panels:
            assert panel.title.endswith(f"</sub>{suffix}")
            np.testing.assert_allclose(panel.layers[-1].y, factor * large)


def test_when_the_leader_acts_is_shaded_and_what_is_unexplained_without_it_can_be_shown() -> None:
    found = compared_sticking()
    charts = {chart.name: chart for chart in comparison_document(found).charts}
    (acts,) = charts["overview"].spans
    assert (acts.name, acts.role) == ("sticking acts", "first")
    assert (acts.start, acts.stop) == pytest.approx((1.0, 2.5), abs=0.05)
    assert charts["moments"].spans == charts["residuals"].spans == [acts]
    assert not charts["motion"].spans
    layers = {layer.name: layer for layer in charts["residuals"].panels[1].layers}  # out of plane
    without, leader = layers["without sticking"], layers["sticking"]
    assert without.hidden
    assert np.nanstd(without.y) > 10.0 * np.nanstd(leader.y)
    fills = {shape.get("fillcolor") for shape in plotly_chart(charts["overview"])["layout"]["shapes"]}
    assert fills == {None, "--first-band"}
