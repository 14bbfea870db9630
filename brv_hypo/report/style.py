"""The one look of tables, and how numbers are written."""

from __future__ import annotations

import math
from collections.abc import Iterable

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

NOT_A_NUMBER = "–"


def plain_table(title: str | None = None) -> Table:
    """An empty table in the house style: rules above and below the heading, no other lines."""
    return Table(
        title=title,
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD,
        show_edge=False,
        pad_edge=False,
        padding=(0, 1, 0, 0),
    )


def number(value: float | None, digits: int = 3) -> str:
    """At `digits` significant digits, without an exponent below a million; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return NOT_A_NUMBER
    return f"{float(f'{value:.{digits}g}'):.{max(digits, 6)}g}"


def percent(value: float | None) -> str:
    """A share as whole percent, never rounded to certainty."""
    if value is None or not math.isfinite(value):
        return NOT_A_NUMBER
    if 0.995 <= value < 1.0:
        return ">99 %"
    if 0.0 < value < 0.005:
        return "<1 %"
    return f"{100.0 * value:.0f} %"


def interval(region: tuple[float, float] | None) -> str:
    """A region of time; a dash where it is the whole."""
    return NOT_A_NUMBER if region is None else f"{region[0]:.2f}–{region[1]:.2f}"


def bullets(messages: Iterable[str], heading: str, style: str = "dim") -> RenderableType:
    """The messages as a list under a heading; nothing where there are none."""
    grid = Table.grid(padding=(0, 1))
    for message in dict.fromkeys(messages):
        grid.add_row(" -", message, style=style)
    return Group(Text(heading, style), grid) if grid.row_count else Group()


def warning_list(messages: Iterable[str]) -> RenderableType:
    """What limits the result."""
    return bullets(messages, "Warnings", "yellow")
