"""A document for the terminal: nothing is cut, at whatever width; no text acts as more; the conclusion comes last."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from rich import box
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, Group, JustifyMethod, RenderableType, RenderResult
from rich.panel import Panel
from rich.segment import Segment
from rich.table import Table as Grid
from rich.text import Text

from brv_hypo.io.text import printable
from brv_hypo.report.document import Block, Chart, Document, Table, Texts, flat

_BETWEEN = 2  # characters between columns
_LEAST_TEXT = 12  # characters below which a column of words is not folded further


def terminal_view(document: Document, *, verbose: bool = False) -> RenderableType:
    """What the terminal shows of a document; `verbose` adds every detail."""
    shown = ("always", "verbose") if verbose else ("always",)
    parts: list[Block] = []
    late = [block for block in document.beside if block.shown in shown]
    for block in flat((*document.ahead, *document.blocks)):
        if block.shown in shown:
            (late if isinstance(block, Texts) and block.warning else parts).append(block)
    title, style = document.conclusion_title, "green" if document.decided else "yellow"
    panel = Panel(Text(document.conclusion), title=title, title_align="left", border_style=style, expand=False)
    return Group(*map(Text, document.subtitle), blocks_view(parts, verbose), Text(), panel, blocks_view(late, verbose))


def blocks_view(blocks: Sequence[Block], verbose: bool) -> Group:
    """Tables and texts, each under its heading, without those that are empty."""
    return Group(*(line for block in flat(blocks) for line in _lines(block, verbose)))


def _lines(block: Block, verbose: bool) -> Iterator[RenderableType]:
    if isinstance(block, Chart):
        return
    if isinstance(block, Texts) and block.bullets:
        texts = list(dict.fromkeys(block.texts))
        more = 0 if verbose or block.most is None else max(len(texts) - block.most, 0)
        style = "yellow" if block.warning else "dim"
        grid = Grid.grid(padding=(0, 1))
        for text in (*texts[: len(texts) - more], *([f"and {more} more: add -v"] if more else [])):
            grid.add_row(" -", text, style=style)
        yield from (Text(block.heading, style), grid)
        return
    if block.heading or isinstance(block, Table):
        yield Text(f"\n{block.heading}" if block.heading else "", "bold")
    if isinstance(block, Texts):
        yield from (Text(text, "bold" if block.strong else "") for text in block.texts)
        return
    shown = block.rows if verbose else block.rows[: block.most]
    yield FittingTable(replace(block, rows=shown))
    if len(shown) < len(block.rows):
        yield Text(f"and {len(block.rows) - len(shown)} more: add -v", "dim")


class FittingTable:
    """A table that fits the console: columns move together, then words fold, then it goes on below itself."""

    def __init__(self, block: Table) -> None:
        self.block = block
        cells = {name: (name, *(row[name] for row in block.rows)) for name in block.headings}
        self.widest = {name: max(map(cell_len, texts)) for name, texts in cells.items()}

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """The table, in as many parts as it takes."""
        first, *others = self.block.headings
        parts = [[first]]
        for name in others:
            least = sum(self._least_width(each) + 1 for each in (*parts[-1], name)) - 1
            if len(parts[-1]) > 1 and least > options.max_width:
                parts.append([first])
            parts[-1].append(name)
        yield from (self._part(names, options.max_width, plain=not console.is_terminal) for names in parts)

    def _part(self, names: Sequence[str], room: int, *, plain: bool) -> RenderableType:
        marks = [" •" if index in self.block.marked else "  " for index in range(len(self.block.rows))]
        marks = marks if plain and self.block.marked else [""] * len(marks)
        unfolded = sum(self.widest[name] + _BETWEEN for name in names) + max(map(len, marks), default=0) - _BETWEEN
        between = 0 if unfolded > room else 1
        table = Grid(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, between, 0, 0))
        for name in names:
            words, least = name in self.block.words, self._least_width(name)
            justify: JustifyMethod = "left" if words else "right"
            table.add_column(name, justify=justify, no_wrap=not words, overflow="fold", min_width=least)
        for index, row in enumerate(self.block.rows):
            last = f"{row[names[-1]]}{marks[index]}"
            table.add_row(*(row[name] for name in names[:-1]), last, style="bold" if index in self.block.marked else "")
        return table

    def _least_width(self, name: str) -> int:
        """The width below which the column is not readable."""
        widest = self.widest[name]
        return min(widest, max(_LEAST_TEXT, cell_len(name))) if name in self.block.words else widest


class PlainConsole(Console):
    """Standard output for readers, on which no text, wherever it comes from, is markup or acts as a control code."""

    def __init__(self) -> None:
        super().__init__(highlight=False, markup=False)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterator[Segment]:
        """As the base class, each piece of text made printable."""
        for text, style, control in super().render(renderable, options):
            yield Segment(text if control else printable(text), style, control)
