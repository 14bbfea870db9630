"""A document for the terminal: nothing is cut, at whatever width; the conclusion comes last."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.panel import Panel
from rich.text import Text

from brv_hypo.report.document import TEXT_COLUMNS, Block, Document, Picture, Table, Texts
from brv_hypo.report.style import bullets, plain_table

_BETWEEN = 2
"""Characters between columns."""
_LEAST_TEXT = 12
"""Characters below which a column of words is not folded further."""


def terminal_view(document: Document, *, verbose: bool = False) -> RenderableType:
    """What the terminal shows of a document; `verbose` adds every detail."""
    shown = ("always", "verbose") if verbose else ("always",)
    parts: list[RenderableType] = [Text(line) for line in document.subtitle]
    late: list[RenderableType] = []
    for block in document.blocks:
        if block.shown in shown and not block.empty and not isinstance(block, Picture):
            (late if _warns(block) else parts).extend(_lines(block, verbose))
    panel = Panel(
        Text(document.conclusion),
        title=document.conclusion_title,
        title_align="left",
        border_style="green" if document.decided else "yellow",
        expand=False,
    )
    return Group(*parts, Text(), panel, *late)


def _warns(block: Block) -> bool:
    return isinstance(block, Texts) and block.warning


def _lines(block: Table | Texts, verbose: bool) -> Iterator[RenderableType]:
    if isinstance(block, Table):
        yield Text(f"\n{block.heading}" if block.heading else "", "bold")
        shown = block.rows if verbose else block.rows[: block.most]
        yield Fitted(replace(block, rows=shown))
        if len(shown) < len(block.rows):
            yield Text(f"and {len(block.rows) - len(shown)} more: -v", "dim")
    elif block.bullets:
        yield bullets(block.texts, block.heading, "yellow" if block.warning else "dim")
    else:
        if block.heading:
            yield Text(f"\n{block.heading}", "bold")
        yield from (Text(text, "bold" if block.strong else "") for text in block.texts)


class Fitted:
    """A table that fits the console: columns move together, then words fold, then it goes on below itself."""

    def __init__(self, block: Table) -> None:
        self.block = block
        self.room = 0  # characters of the console, known when rendered

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """The table, in as many parts as it takes."""
        self.room = options.max_width
        kept = [0]
        parts = []
        for column in range(1, len(self.block.headings)):
            if len(kept) > 1 and self._least([*kept, column]) > options.max_width:
                parts.append(kept)
                kept = [0]
            kept.append(column)
        for columns in (*parts, kept):
            yield self._part(columns)

    def _part(self, columns: Sequence[int]) -> RenderableType:
        table = plain_table(close=self._wide(columns) > self.room)
        for column in columns:
            heading = self.block.headings[column]
            words = heading in TEXT_COLUMNS
            table.add_column(
                heading,
                justify="left" if words else "right",
                no_wrap=not words,
                overflow="fold",
                min_width=self._width(column),
            )
        for index, row in enumerate(self.block.rows):
            table.add_row(*(row[c] for c in columns), style="bold" if index in self.block.marked else "")
        return table

    def _wide(self, columns: Sequence[int]) -> int:
        """The width that the columns take with nothing folded."""
        cells = ((self.block.headings[c], *(row[c] for row in self.block.rows)) for c in columns)
        return sum(max(cell_len(text) for text in column) + _BETWEEN for column in cells) - _BETWEEN

    def _least(self, columns: Sequence[int]) -> int:
        return sum(self._width(column) + 1 for column in columns) - 1

    def _width(self, column: int) -> int:
        """The width below which the column is not readable."""
        heading = self.block.headings[column]
        widest = max(cell_len(text) for text in (heading, *(row[column] for row in self.block.rows)))
        return min(widest, max(_LEAST_TEXT, cell_len(heading))) if heading in TEXT_COLUMNS else widest
