"""The gallery executed anew, outputs kept: `python -m tests.docs.gallery [NAME ...]`.

Each notebook runs in an empty folder, with one thread and without progress bars; its outputs then replace those
in `brv_hypo/docs/notebooks`. Seconds of CPU of each are printed.
"""

from __future__ import annotations

import os
import resource
import sys
import tempfile
from pathlib import Path
from typing import Any

import nbclient
import nbformat

BOOKS = Path(__file__).resolve().parents[2] / "brv_hypo" / "docs" / "notebooks"
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def executed(text: str, folder: Path) -> Any:
    """The notebook with the outputs that its cells gave in `folder`; a cell that fails raises CellExecutionError."""
    book = nbformat.reads(text, as_version=4)
    nbformat.validate(book)
    place = {"metadata": {"path": str(folder)}}
    # A cell's print may come in pieces, on a busy machine in more of them: they are one output.
    options = {"timeout": 300, "kernel_name": "python3", "record_timing": False, "coalesce_streams": True}
    return nbclient.NotebookClient(book, resources=place, **options).execute()


def main(names: list[str]) -> None:
    """Execute the notebooks of these names, or all, and write them."""
    os.environ.update(ONE_THREAD)
    for path in sorted(BOOKS.glob("*.ipynb")):
        if names and path.stem not in names:
            continue
        before = _seconds()
        with tempfile.TemporaryDirectory() as folder:
            book = executed(path.read_text(encoding="utf-8"), Path(folder))
        book.metadata = {"kernelspec": book.metadata.kernelspec, "language_info": {"name": "python"}}
        path.write_text(nbformat.writes(book, indent=1) + "\n", encoding="utf-8")
        print(f"{path.stem:20} {_seconds() - before:5.1f} s of CPU, {path.stat().st_size / 1e3:.0f} kB", flush=True)


def _seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main(sys.argv[1:])
