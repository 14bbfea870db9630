"""The gallery: executed notebooks that keep their outputs, and run from beginning to end as they are written."""

from __future__ import annotations

import json
import re

import pytest

from brv_hypo.docs import notebooks
from tests.docs.gallery import BOOKS as GALLERY
from tests.docs.gallery import executed

BOOKS = {name: json.loads(content)["cells"] for name, content in notebooks().items()}
QUICK = ("kernels_alone.ipynb",)
"""Executed with the thorough tests; the others, up to twenty seconds each, with the slow ones."""


def outputs(cells):
    return [output for cell in cells for output in cell.get("outputs", ())]


@pytest.mark.parametrize("cells", BOOKS.values(), ids=BOOKS)
class TestKept:
    def test_it_is_a_question_with_tables_and_charts(self, cells):
        title, *_ = "".join(cells[0]["source"]).splitlines()
        assert re.match(r"# \w", title)
        kinds = {kind for output in outputs(cells) for kind in output.get("data", {})}
        assert kinds & {"image/png", "text/html"}

    def test_every_cell_ran_in_order_without_complaint(self, cells):
        counts = [cell["execution_count"] for cell in cells if cell["cell_type"] == "code"]
        assert counts == [*range(1, len(counts) + 1)]
        assert not [output for output in outputs(cells) if "error" in (output["output_type"], output.get("name"))]
        assert not [output for output in outputs(cells) if output.get("name") == "stderr"]

    def test_it_names_no_place_of_a_machine(self, cells):
        said = json.dumps([(cell["source"], cell.get("outputs", ())) for cell in cells])
        assert not re.findall(r"/(?:home|root|tmp|work|usr|opt)/", said)


def test_there_are_ten_and_all_are_in_the_gallery():
    assert len(BOOKS) == 10
    assert {path.name for path in GALLERY.glob("*.ipynb")} == BOOKS.keys()


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.thorough if name in QUICK else pytest.mark.slow) for name in BOOKS]
)
def test_it_gives_what_it_shows(name, tmp_path):
    """The same kinds of output in every cell: tables, charts, texts."""
    book = executed(notebooks()[name], tmp_path)
    for cell, kept in zip(book.cells, BOOKS[name], strict=True):
        again, shown = ([sorted(o.get("data", {"stream": 0})) for o in c.get("outputs", ())] for c in (cell, kept))
        assert again == shown, cell.source


def test_the_command_writes_them(tmp_path) -> None:
    from typer.testing import CliRunner

    from brv_hypo.cli.main import app

    runner = CliRunner()
    assert runner.invoke(app, ["docs", "--notebooks", str(tmp_path / "books")]).exit_code == 0
    assert {path.name: path.read_text() for path in (tmp_path / "books").iterdir()} == notebooks()
