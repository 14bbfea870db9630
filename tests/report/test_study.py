"""The document of a study: terminal and page have the same, with its charts."""

from __future__ import annotations

import io

import numpy as np
import pytest
from rich.console import Console

from brv_hypo.report.document import Document, Table, Texts, flat
from brv_hypo.report.figures import chart_figure
from brv_hypo.report.html import page
from brv_hypo.report.many_flights import MOST_MISTAKES, study_document
from brv_hypo.report.terminal import terminal_view
from brv_hypo.report.write import RESOLUTION
from brv_hypo.study import StudyConfig, summarise
from tests.study.outcomes import outcome


@pytest.fixture(scope="module")
def document() -> Document:
    right = [outcome("lag", "lag", winner="lag", repeat=i, effect=0.1 + 0.02 * i) for i in range(6)]
    wrong = [outcome("lag", "sticking", winner="sticking", repeat=i) for i in range(20, 40)]
    none = [outcome("none", "none", winner="none", repeat=i) for i in range(6)]
    settings = StudyConfig(title="made up", vehicles=("cone",), planted=("none", "lag"), flights=26)
    return study_document(summarise(settings, (*right, *wrong, *none)))


def printed(document: Document, *, verbose: bool) -> str:
    console = Console(width=80, file=io.StringIO(), highlight=False, markup=False)
    console.print(terminal_view(document, verbose=verbose))
    return console.file.getvalue()


def test_the_terminal_lists_some_mistakes_and_all_of_them_with_verbose(document) -> None:
    for verbose, count in ((False, MOST_MISTAKES), (True, 20)):
        text = printed(document, verbose=verbose)
        mistakes = text.partition("Mistakes (20)")[2].partition("╭")[0]
        assert sum("sticking" in line for line in mistakes.splitlines()) == count
        assert document.conclusion[:40] in text


def test_the_page_shades_the_confusion_and_draws_the_calibration(document) -> None:
    html = page(document)
    assert "rgba(var(--shade), 0.60)" in html
    assert [chart.name for chart in document.charts] == ["calibration"]
    assert all(b"<svg" in chart_figure(chart).content("svg", RESOLUTION) for chart in document.charts)


def test_errors_of_a_share_end_within_0_and_1(document) -> None:
    dots = document.charts[0].panels[0].layers[1]
    below, above = dots.error
    assert np.all(np.asarray(dots.y) + above <= 1.0 + 1e-12)
    assert np.all(np.asarray(dots.y) - below >= -1e-12)


def test_a_study_of_one_vehicle_has_one_row_for_each_mechanism_and_its_columns_are_explained(document) -> None:
    tables = {block.heading: block for block in flat(document.blocks) if isinstance(block, Table)}
    assert [row["vehicle"] for row in tables["Detection limits"].rows] == ["cone"]
    words = " ".join(text for block in flat(document.blocks) if isinstance(block, Texts) for text in block.texts)
    assert "won: the verdict names it too" in words
    assert "false alarms in 0 of 6 flights (95 %: 0 to 46 %) with nothing planted" in document.conclusion
