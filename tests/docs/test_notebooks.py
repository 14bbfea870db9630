"""The notebooks that come along run from beginning to end, as they are written."""

from __future__ import annotations

import pytest

from brv_hypo.docs import notebooks

pytestmark = pytest.mark.thorough

nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")


@pytest.fixture(params=sorted(notebooks()))
def executed(request, tmp_path):
    """A notebook with what its cells returned; a cell that fails raises CellExecutionError."""
    book = nbformat.reads(notebooks()[request.param], as_version=4)
    nbformat.validate(book)
    place = {"metadata": {"path": tmp_path}}
    return nbclient.NotebookClient(book, timeout=300, kernel_name="python3", resources=place).execute()


def test_every_cell_runs_and_figures_and_tables_are_shown(executed) -> None:
    outputs = [output for cell in executed.cells for output in cell.get("outputs", ())]
    kinds = {kind for output in outputs for kind in output.get("data", {})}
    assert {"image/png", "text/html"} <= kinds
    assert not [output for output in outputs if output["output_type"] == "error"]
    assert not [output for output in outputs if output.get("name") == "stderr"]


def test_there_are_two_without_outputs_of_their_own() -> None:
    books = [nbformat.reads(text, as_version=4) for text in notebooks().values()]
    assert len(books) == 2
    assert not any(cell.get("outputs") for book in books for cell in book.cells)


def test_the_command_writes_them(tmp_path) -> None:
    from typer.testing import CliRunner

    from brv_hypo.cli.main import app

    runner = CliRunner()
    assert runner.invoke(app, ["docs", "--notebooks", str(tmp_path / "books")]).exit_code == 0
    assert {path.name: path.read_text() for path in (tmp_path / "books").iterdir()} == notebooks()
