"""How far long work has come: `progress(fraction, text)`, one form for every public function.

`fraction` (0 to 1) of the work is done, None where that is not known; `text` is what comes next. `progress=` takes any
such callable, a rich `Progress` (its last task is moved), or a tqdm bar (not installed along). The log `brv_hypo` has
it at the level INFO.

>>> from brv_hypo.progress import report_to
>>> report_to(print)(0.25, "fitting lag")
0.25 fitting lag
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any, Protocol

from brv_hypo.errors import UsageError

log = logging.getLogger("brv_hypo")
log.addHandler(logging.NullHandler())

Report = Callable[[float | None, str], object]


class Bar(Protocol):
    """rich.progress.Progress or tqdm.tqdm."""

    @property
    def update(self) -> Any:
        """Moves it."""


Progress = Report | Bar


def silent(fraction: float | None, text: str) -> None:
    """Report nothing."""


def report_to(progress: Progress | None) -> Report:
    """A callable that reports to `progress`, whatever it is, and to the log."""
    bar: Any = progress
    move: Report = silent if progress is None else bar  # a tqdm bar without a total has no truth value
    if hasattr(bar, "add_task"):
        task = bar.task_ids[-1] if bar.task_ids else bar.add_task("", total=None)

        def move(fraction: float | None, text: str) -> None:
            bar.update(task, description=text, total=None if fraction is None else 1.0, completed=fraction)

    elif hasattr(bar, "set_description_str"):

        def move(fraction: float | None, text: str) -> None:
            bar.total = bar.total or 1.0
            bar.n = bar.n if fraction is None else fraction * bar.total
            bar.set_description_str(text)

    elif not callable(move):
        expected = "a function of fraction and text, such as print, a rich Progress or a tqdm bar"
        raise UsageError(f"got progress of type {type(progress).__name__}, expected {expected}.")

    def report(fraction: float | None, text: str) -> None:
        log.info(text if fraction is None else f"{text} ({100.0 * fraction:.0f} % done)")
        move(fraction, text)

    return report


def stages(report: Report, starts: Mapping[str, float]) -> Callable[[str], None]:
    """A callable for stages that are only named: `starts` has the fraction that is done where a name so begins."""
    done = [0.0]

    def say(text: str) -> None:
        done[0] = max(done[0], *(fraction for name, fraction in starts.items() if text.startswith(name)), 0.0)
        report(done[0] if starts else None, text)

    return say
