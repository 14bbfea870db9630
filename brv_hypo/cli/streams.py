"""The standard streams of any shell, and what long work shows on standard error while it lasts.

`ready` makes the streams fit for any text: what was closed swallows it, and characters that the encoding lacks are
written as plain ones. `shown` is a bar on a terminal, a line now and then elsewhere.
"""

from __future__ import annotations

import codecs
import io
import os
import sys
import threading
import time
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager

from brv_hypo.errors import UsageError
from brv_hypo.io.text import printable
from brv_hypo.progress import Report, report_to, silent

PLAIN = str.maketrans("–—−─━⁻│┃×·•≤≥…‘’“”", "------||x.*<>.''\"\"") | dict.fromkeys(range(0x250C, 0x2574), "+")
"""Characters that some encodings lack, as ASCII has them; of others, what is left without accents."""
_closed: set[str] = set()
"""Streams that the shell had closed."""


def ready() -> None:
    """Make the standard streams fit for any text: to be called once, before anything is printed or opened."""
    codecs.register_error("brv_hypo.plain", _plain)
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:  # closed: the next file that is opened would get its number, and what is printed
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number, which is this one
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, os.fdopen(number, "r" if name == "stdin" else "w", encoding="utf-8", closefd=False))
            _closed.add(name)
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="brv_hypo.plain")


def _plain(error: UnicodeError) -> tuple[str, int]:
    """What is written in place of characters that the encoding lacks; a raised one has a ^ before it."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    written, raised = "", False
    for each in error.object[error.start : error.end]:
        before, raised = raised, unicodedata.decomposition(each).startswith("<super>")
        near = unicodedata.normalize("NFKD", each.translate(PLAIN)).encode("ascii", "ignore").decode() or "?"
        written += f"^{near}" if raised and not before else near
    return written, error.end


def require_output(what: str) -> None:
    """Raise UsageError where standard output, which `what` needs, was closed by the shell."""
    if "stdout" in _closed:
        raise UsageError(f"{what} writes to standard output, which is closed (>&-). Open it, or name a file.")


# ---- What long work shows while it lasts ----

LINE_SECONDS = 2.0
"""Between lines where standard error is no terminal, at least; work of hours has fewer."""


@contextmanager
def shown(title: str, *, quiet: bool) -> Iterator[Report]:
    """What to call with a fraction and a text: it moves a bar on a terminal, and elsewhere now and then adds a line."""
    if quiet:
        yield silent
    elif sys.stderr.isatty():
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

        words = TextColumn("{task.description}", markup=False)
        columns = (BarColumn(bar_width=24), TaskProgressColumn(), TimeElapsedColumn(), words)
        with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
            bar.add_task(title, total=None)
            yield report_to(bar)
    else:
        reached, finished = [title], threading.Event()
        writer = threading.Thread(target=_write_lines, args=(reached, finished), daemon=True)  # a stage takes minutes
        writer.start()
        try:
            yield lambda fraction, text: reached.append(text if fraction is None else f"{text}, {fraction:.0%} done")
        finally:
            finished.set()
            writer.join()


def _write_lines(reached: list[str], finished: threading.Event) -> None:
    """Write the last of what was reached, where it is new."""
    begun, written = time.monotonic(), ""
    while not finished.wait(max(LINE_SECONDS, (time.monotonic() - begun) / 30.0)):
        if reached[-1] != written:
            written = reached[-1]
            print(f"{time.monotonic() - begun:.0f} s: {printable(written)}", file=sys.stderr, flush=True)
