"""Pages in a browser: every chart is drawn, no script fails, and charts over time keep one zoom."""

from __future__ import annotations

import re
import shutil
import subprocess

import numpy as np
import pytest

import brv_hypo
from brv_hypo.docs.manual import site
from brv_hypo.report.document import Band, Bars, Chart, Document, Line, Mark, Panel, Section, Span
from brv_hypo.report.html import page
from brv_hypo.report.many_flights import study_document
from brv_hypo.report.motion_charts import Setting, attitude_chart, motion_chart
from brv_hypo.report.write import document_of
from brv_hypo.study import StudyConfig, summarise
from tests.chains import compared_sticking, histories, reconstructed, traced_trim, trimmed
from tests.study.outcomes import outcome

BROWSER = shutil.which("chromium") or shutil.which("google-chrome")
FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update", "--virtual-time-budget=10000"),
)
WATCH = """<script>
  const root = document.documentElement;
  onerror = (message) => { root.dataset.failed = message; };
  onunhandledrejection = (event) => { root.dataset.failed = event.reason; };
  console.error = (...said) => { root.dataset.failed = said.join(" "); };
</script>"""
COLOURS = """<script>(async () => {
  while (!root.dataset.drawn) await new Promise((done) => setTimeout(done, 20));
  document.getElementById("unfold")?.click();
  const count = document.querySelectorAll(".chart").length;
  while (Number(root.dataset.drawn) < count) await new Promise((done) => setTimeout(done, 20));
  root.dataset.paper = getComputedStyle(document.body).backgroundColor;
  root.dataset.wide = document.documentElement.scrollWidth > innerWidth;
  root.dataset.ink = document.querySelector(".chart .xtick text").style.fill;
})();</script>"""
SCHEMES = {
    "dark": ("0", "rgb(21, 24, 28)", "rgb(230, 230, 230)"),
    "light": ("1", "rgb(255, 255, 255)", "rgb(26, 26, 26)"),
}
"""By scheme, blink's number of it, and the colours of paper and ink (page.css)."""
ZOOM = """<script>(async () => {
  while (!root.dataset.drawn) await new Promise((done) => setTimeout(done, 20));
  const nodes = document.querySelectorAll(".chart");
  await Plotly.relayout(nodes[0], { "xaxis.range": [1, 2] });
  await new Promise((done) => setTimeout(done, 100));
  root.dataset.zoomed = [...nodes].map((node) => node.layout.xaxis.range.map((x) => x.toFixed(1)).join("-")).join(" ");
})();</script>"""
FOLD = """<script>(async () => {
  while (!root.dataset.drawn) await new Promise((done) => setTimeout(done, 20));
  const nodes = document.querySelectorAll(".chart");
  root.dataset.before = root.dataset.drawn;
  await Plotly.relayout(nodes[0], { "xaxis.range": [1, 2] });
  document.querySelector("nav a[href='#second']").click();
  while (root.dataset.drawn < 2) await new Promise((done) => setTimeout(done, 20));
  root.dataset.zoomed = [...nodes].map((node) => node.layout.xaxis.range.map((x) => x.toFixed(1)).join("-")).join(" ");
})();</script>"""
STRETCHES = """<script>(async () => {
  while (!root.dataset.drawn) await new Promise((done) => setTimeout(done, 20));
  const [time, path] = document.querySelectorAll(".chart");
  const titles = () => path.layout.annotations.map((each) => each.text).join(" | ");
  root.dataset.whole = titles();
  root.dataset.points = path.data.map((trace) => trace.x.length).join(" ");
  await Plotly.relayout(time, { "xaxis.range": [5, 7] });
  await new Promise((done) => setTimeout(done, 300));
  root.dataset.zoomed = titles();
})();</script>"""
PRINT = """<script>(async () => {
  while (!root.dataset.drawn) await new Promise((done) => setTimeout(done, 20));
  dispatchEvent(new Event("beforeprint"));
  await new Promise((done) => setTimeout(done, 300));
  const nodes = [...document.querySelectorAll(".chart")];
  root.dataset.sizes = nodes.map((node) => [node.layout.width, node.layout.height].join("x")).join(" ");
  root.dataset.paper = getComputedStyle(document.body).backgroundColor;
})();</script>"""

LEGEND = """<script>(async () => {
  while (!root.dataset.drawn) await new Promise((done) => setTimeout(done, 20));
  const [legend, bar] = [".legend", ".modebar"].map((name) => document.querySelector(name).getBoundingClientRect());
  root.dataset.apart = legend.bottom <= bar.top;
})();</script>"""

CHART = '<div class="chart"'

pytestmark = [pytest.mark.skipif(BROWSER is None, reason="no chromium is installed"), pytest.mark.thorough]


@pytest.fixture
def shown(tmp_path):
    """The root element's attributes once a page's scripts have run, at a width in pixels."""

    def show(html: str, width: int = 800, scheme: str = "light") -> str:
        file = tmp_path / "page.html"
        file.write_text(html.replace("<head>", f"<head>{WATCH}", 1))
        profile = f"--user-data-dir={tmp_path / 'profile'}"
        options = (f"--window-size={width},900", f"--blink-settings=preferredColorScheme={SCHEMES[scheme][0]}")
        done = subprocess.run(
            [BROWSER, *FLAGS, profile, *options, "--dump-dom", file.as_uri()],
            capture_output=True,
            text=True,
            check=True,
            timeout=120,
        )
        root = re.search(r"<html[^>]*>", done.stdout)
        assert root is not None
        return root[0]

    return show


def charts() -> list[Chart]:
    time = np.linspace(0.0, 5.0, 200)
    wave = [Panel("y", [Band(time, time - 1, time + 1), Line(time, np.sin(time), "first", "a")]) for _ in range(2)]
    extras = {"over_time": True, "range": (0.0, 5.0), "marks": [Mark(2.0, "knot")], "spans": [Span(3.0, 4.0, "masked")]}
    return [
        Chart("one", "One", "time, s", wave, **extras),
        Chart("two", "Two", "time, s", wave[:1], **extras),
        Chart("bars", "Bars", "share", [Panel("", [Bars(["a", "b"], [1.0, 2.0], ["1", "2"])])], range=(0.0, 3.0)),
    ]


def report(extra: str = "") -> str:
    document = Document("t", (), "c", "words", True, charts())
    return page(document).replace("</body>", f"{extra}</body>")


@pytest.mark.parametrize("width", [800, pytest.param(1600, marks=pytest.mark.slow)])
def test_every_chart_is_drawn_without_an_error(shown, width) -> None:
    root = shown(report(), width)
    assert 'data-drawn="3"' in root
    assert "data-failed" not in root


def test_the_buttons_of_a_chart_cover_no_name_of_its_legend(shown) -> None:
    """Which may need all of the upper edge."""
    assert 'data-apart="true"' in shown(report(LEGEND))


@pytest.fixture(scope="module")
def pages() -> dict[str, str]:
    """The pages of real results: flights reconstructed, compared, traced and predicted; and of a study."""
    results = {
        "compare": compared_sticking(),
        "trace": traced_trim(),
        "predict": brv_hypo.predict(trimmed().flight, traced_trim()),
        "reconstruct": reconstructed(),
    }
    drawn = {name: page(document_of(result)) for name, result in results.items()}
    outcomes = [outcome("lag", "lag", winner="lag", repeat=i, effect=0.1 + 0.02 * i) for i in range(6)]
    studied = summarise(StudyConfig(title="made up", vehicles=("cone",), planted=("none", "lag"), flights=6), outcomes)
    return {**drawn, "study": page(study_document(studied))}


@pytest.mark.parametrize(
    ("name", "width", "scheme"),
    [
        *(pytest.param(name, 1600, "dark", marks=pytest.mark.slow) for name in ("compare", "trace", "reconstruct")),
        *(pytest.param(name, 800, "light", marks=pytest.mark.slow) for name in ("predict", "study")),
        *((name, 1600, "dark") for name in ("predict", "study")),
        *((name, 800, "light") for name in ("compare", "trace", "reconstruct")),
    ],
)
def test_pages_of_results_are_drawn_narrow_and_wide_light_and_dark(shown, pages, name, width, scheme) -> None:
    """Every chart, without an error, in the scheme's colours, and no wider than the window."""
    html = pages[name]
    root = shown(html.replace("</body>", f"{COLOURS}</body>"), width, scheme)
    assert "data-failed" not in root
    assert f'data-drawn="{html.count(CHART)}"' in root
    assert 'data-wide="false"' in root
    assert f'data-paper="{SCHEMES[scheme][1]}"' in root
    assert f'data-ink="{SCHEMES[scheme][2]}"' in root


def test_a_folded_chart_is_drawn_at_the_zoom_of_the_others_when_its_section_is_linked_to(shown) -> None:
    one, two, _ = charts()
    document = Document("t", (), "c", "words", True, [Section("First", [one]), Section("Second", [two], folded=True)])
    root = shown(page(document).replace("</body>", f"{FOLD}</body>"))
    assert "data-failed" not in root
    assert 'data-before="1"' in root
    assert 'data-drawn="2"' in root
    assert 'data-zoomed="1.0-2.0 1.0-2.0"' in root


def test_charts_over_time_are_zoomed_together_and_the_others_are_not(shown) -> None:
    assert 'data-zoomed="1.0-2.0 1.0-2.0 0.0-3.0"' in shown(report(ZOOM))


def test_a_path_is_divided_into_the_stretches_of_its_chart_and_anew_by_a_zoom(shown) -> None:
    """Forty turns in 20 s: twelve stretches, of two seconds that charts over time are zoomed to only one."""
    time = np.linspace(0.0, 20.0, 2001)
    setting = Setting((0.0, 20.0))
    alpha = np.full(2001, 0.05)
    path = attitude_chart(setting, histories(time, alpha, -2.0 * np.pi * 2.0 * time))
    charts = (motion_chart(setting, histories(time, alpha, alpha)), path)
    document = Document("t", (), "c", "words", True, charts)
    root = shown(page(document).replace("</body>", f"{STRETCHES}</body>"))
    assert "data-failed" not in root
    titles = " | ".join([*(panel.title for panel in path.panels), "psi, deg", "theta, deg"])
    assert f'data-whole="{titles}"' in root
    sizes = " ".join(f"{len(panel.layers[0].x)} 1" for panel in path.panels)
    assert f'data-points="{sizes}"' in root
    assert 'data-zoomed="5.0–7.0 s | psi, deg | theta, deg"' in root


def test_charts_fit_a_sheet_when_they_are_printed(shown) -> None:
    """On white paper, two charts of two panels on a sheet of 1000 px, and none higher than it."""
    wave = Panel("y", [Line(np.linspace(0.0, 5.0, 50), np.ones(50), "first")])
    tall = Chart("tall", "Tall", "time, s", [wave] * 6)
    document = Document("t", (), "c", "words", True, [*charts(), tall])
    html = page(document).replace("</body>", f"{PRINT}</body>")
    root = shown(html, scheme="dark")
    assert "data-failed" not in root
    sizes = re.search(r'data-sizes="([^"]*)"', root)[1].split()
    assert {size.split("x")[0] for size in sizes} == {"660"}
    two, _, bars, most = (float(size.split("x")[1]) for size in sizes)
    assert two < 430
    assert bars == 133
    assert most < 1000
    assert f'data-paper="{SCHEMES["light"][1]}"' in root


@pytest.fixture(scope="module")
def manual():
    """A function to a page of the manual that is one file, as `shown` takes it."""
    pages = site()

    def of(name, script):
        style = f"<style>{pages['manual.css']}</style>"
        page = pages[name].replace('<link rel="stylesheet" href="manual.css">', style)
        return page.replace('<script src="manual.js"></script>', f"<script>{pages['manual.js']}</script>{script}")

    return of


@pytest.mark.parametrize(
    ("name", "width", "scheme"), [("verdict", 800, "light"), ("own_csv", 1600, "dark"), ("functions", 800, "dark")]
)
def test_the_manual_is_no_wider_than_the_window(shown, manual, name, width, scheme) -> None:
    measure = """<script>document.documentElement.dataset.wide = document.documentElement.scrollWidth > innerWidth;
      document.documentElement.dataset.paper = getComputedStyle(document.body).backgroundColor;</script>"""
    root = shown(manual(f"{name}.html", measure), width, scheme)
    assert "data-failed" not in root
    assert 'data-wide="false"' in root
    assert f'data-paper="{SCHEMES[scheme][1]}"' in root


def test_the_manual_is_searched(shown, manual) -> None:
    search = """<script>field.value = "windward meridian"; field.dispatchEvent(new Event("input"));
      document.documentElement.dataset.said = found.textContent;
      document.documentElement.dataset.first = results.querySelector("a").getAttribute("href");</script>"""
    root = shown(manual("start.html", search))
    assert "data-failed" not in root
    count, sections = map(int, re.search(r'data-said="(\d+) of (\d+) sections"', root).groups())
    assert 0 < count < sections
    assert re.search(r'data-first="\w+\.html#?[\w-]*"', root)
