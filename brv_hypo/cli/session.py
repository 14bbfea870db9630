"""Where a command's results go: the terminal, JSON, an HTML report, files.

Outputs are claimed before any work starts, so that a long run never ends in a refusal, and are written
whole or not at all. With `--json -` standard output holds JSON and nothing else.
"""

from __future__ import annotations

import json as json_format
import os
import shlex
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TextIO

from brv_hypo.errors import UsageError
from brv_hypo.files.printed import printable
from brv_hypo.files.whole import check_target, write_whole

if TYPE_CHECKING:
    from pydantic import BaseModel

    from brv_hypo.report.blocks import Document
    from brv_hypo.report.provenance import Provenance

STANDARD_OUTPUT = "-"


class Progress(Protocol):
    """Reports the stage that long work has reached and, where known, the fraction (0 to 1) done."""

    def __call__(self, stage: str, fraction: float | None = None) -> None:
        """Show the stage."""


@dataclass(frozen=True)
class Session:
    """How one command talks: what was asked of the common options."""

    json: str | None = None
    report: Path | None = None
    figures: Path | None = None
    force: bool = False
    quiet: bool = False
    verbose: bool = False
    stdout: TextIO = field(default_factory=lambda: sys.stdout)

    @property
    def json_only(self) -> bool:
        """True where standard output belongs to JSON."""
        return self.json == STANDARD_OUTPUT

    def claim(self, *files: Path | None, charts: Sequence[str] = ()) -> None:
        """Refuse now what could not be written later: `files`, the report, the JSON file, pictures of `charts`.

        Raises UsageError where a file exists and `--force` was not given, or cannot be written.
        """
        json_file = None if self.json is None or self.json_only else Path(self.json)
        wanted = [file for file in (*files, self.report, json_file) if file is not None]
        resolved = [file.resolve() for file in wanted]
        for file in wanted:
            if resolved.count(file.resolve()) > 1:
                raise UsageError(f"{file} was given for two outputs. Give each output a file of its own.")
            self._claim_one(file)
        if self.figures is not None:
            self._claim_figures(self.figures, charts)

    def _claim_figures(self, folder: Path, charts: Sequence[str]) -> None:
        if folder.exists() and not folder.is_dir():
            raise UsageError(f"--figures {folder} is a file. Give a folder, which need not exist yet.")
        standing = next(each for each in (folder.absolute(), *folder.absolute().parents) if each.exists())
        if not standing.is_dir() or not os.access(standing, os.W_OK):
            raise UsageError(f"--figures {folder} cannot be made: no permission in {standing}. Choose another place.")
        from brv_hypo.report.drawing import check_pictures, require_matplotlib

        require_matplotlib()
        check_pictures(folder, charts, overwrite=self.force)

    def _claim_one(self, file: Path) -> None:
        check_target(file, overwrite=self.force)
        folder = Path(os.path.realpath(file)).parent
        if not folder.is_dir():
            raise UsageError(
                f"{file} cannot be written: {folder} does not exist. Create it, or choose another."
            )
        if not os.access(folder, os.W_OK):
            raise UsageError(f"{file} cannot be written: no permission in {folder}. Choose another place.")

    def show(self, *renderables: Any) -> None:
        """Print for a human reader; silent with -q or where standard output belongs to JSON."""
        if not self.quiet:
            self._print(*renderables)

    def present(self, document: Document) -> None:
        """Print a document; with -q its conclusion alone; nothing where standard output belongs to JSON."""
        if self.quiet:
            self._print(document.conclusion)
            return
        from brv_hypo.report.terminal import terminal_view

        self._print(terminal_view(document, verbose=self.verbose))

    def tell(self, view: Any, conclusion: str) -> None:
        """Print a view that is no document; with -q the conclusion alone."""
        self._print(conclusion if self.quiet else view)

    def _print(self, *renderables: Any) -> None:
        if self.json_only:
            return
        from brv_hypo.report.style import plain_console

        console = plain_console()
        for renderable in renderables:
            console.print(renderable)

    def warn(self, message: str) -> None:
        """One line on standard error."""
        print(f"brv-hypo: {printable(message)}", file=sys.stderr)

    def write_json(self, result: Any) -> None:
        """The result as JSON, where it was asked for; what is not finite becomes null."""
        if self.json is None:
            return
        text = as_json(result, left_out())
        if self.json_only:
            self.stdout.write(text)
        else:
            write_whole(Path(self.json), text)
            self.show(f"Wrote {self.json}.")

    def write_report(
        self, document: Document, settings: BaseModel | None = None, records: Iterable[str | Path] = ()
    ) -> None:
        """The HTML report and the picture files, where they were asked for."""
        if self.report is not None:
            from brv_hypo.report.pages import page

            write_whole(self.report, page(document, self.provenance(settings, records)))
            self.show(f"Wrote {self.report}.")
        if self.figures is not None:
            from brv_hypo.report.drawing import draw_into

            written = draw_into(self.figures, document.charts, overwrite=self.force)
            self.show(
                f"Wrote {len(written)} files to {self.figures}."
                if written
                else "The result has no charts: no picture files were written."
            )

    @staticmethod
    def provenance(settings: BaseModel | None = None, records: Iterable[str | Path] = ()) -> Provenance:
        """Version, settings, digests of the records, and the command line that this process was given."""
        from brv_hypo.report.provenance import provenance

        return provenance(shlex.join(["brv-hypo", *sys.argv[1:]]), settings, records)

    @contextmanager
    def progress(self, title: str) -> Iterator[Progress]:
        """A bar on standard error that a `Progress` moves; drawn only on a terminal, and never with -q."""
        if self.quiet or not sys.stderr.isatty():
            yield _silent
            return
        from rich.console import Console
        from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
        from rich.progress import Progress as Bar

        columns = (
            BarColumn(bar_width=24),
            TimeElapsedColumn(),
            TextColumn("{task.description}", markup=False),
        )
        with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task(title, total=None)

            def advance(stage: str, fraction: float | None = None) -> None:
                bar.update(
                    task, description=stage, total=None if fraction is None else 1.0, completed=fraction
                )

            yield advance


def _silent(stage: str, fraction: float | None = None) -> None:
    """No bar."""


def left_out() -> tuple[str, ...]:
    """Why plugins were left out, where any were loaded."""
    if "brv_hypo.mechanisms" not in sys.modules:
        return ()
    from brv_hypo.mechanisms import left_out as reasons

    return reasons()


def as_json(result: Any, warnings: tuple[str, ...] = ()) -> str:
    """JSON text of a result: models and dataclasses by field, arrays as lists, NaN and infinity as null.

    `warnings` are added to those that it holds.
    """
    from pydantic_core import to_json

    text = to_json(result, by_alias=True, indent=2, inf_nan_mode="null", fallback=_plain)
    if warnings:
        content = json_format.loads(text)
        content["warnings"] = [*content.get("warnings", ()), *warnings]
        text = json_format.dumps(content, indent=2, ensure_ascii=False).encode()
    return text.decode() + "\n"


def _plain(value: Any) -> Any:
    """A NumPy array or scalar as Python numbers."""
    return value.tolist()
