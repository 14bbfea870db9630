"""A result as one document of blocks; `terminal.py` and `pages.py` render the same document.

A block without content is left out. `shown` says where it appears: "always", with -v in the terminal ("verbose"),
or on the page alone ("page"); a page shows everything.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from brv_hypo.report.chart import Chart

Shown = Literal["always", "verbose", "page"]


@dataclass(frozen=True)
class Table:
    """Rows of text under headings; the rows `marked` stand out. Text columns are those that `TEXT_COLUMNS` names.

    The terminal shows the first `most` rows, and all of them with -v. A page shades the cells by `shades`, 0 to 1.
    """

    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    heading: str = ""
    marked: Sequence[int] = ()
    most: int | None = None
    shades: Sequence[Sequence[float]] = ()
    shown: Shown = "always"

    @property
    def empty(self) -> bool:
        """True where there is no row."""
        return not self.rows


@dataclass(frozen=True)
class Texts:
    """Sentences: a list where `bullets`, paragraphs otherwise; warnings stand out."""

    texts: Sequence[str]
    heading: str = ""
    bullets: bool = True
    warning: bool = False
    strong: bool = False
    shown: Shown = "always"

    @property
    def empty(self) -> bool:
        """True where nothing is said."""
        return not self.texts


@dataclass(frozen=True)
class Picture:
    """A chart, for pages and picture files; a terminal leaves it out."""

    chart: Chart
    shown: Shown = "page"

    @property
    def empty(self) -> bool:
        """True where nothing would be drawn."""
        return not self.chart.panels

    @property
    def heading(self) -> str:
        """The chart's."""
        return self.chart.heading


Block = Table | Texts | Picture

TEXT_COLUMNS = frozenset(
    (
        *("mechanism", "criterion", "term", "plane", "unit", "effect", "kind", "near-equals", "moments less"),
        *("planted", "vehicle", "parameter", "status", "flight", "ranked first", "verdict", "reason", "history"),
    )
)
"""Headings of columns that hold words; every other column holds numbers."""


@dataclass(frozen=True)
class Document:
    """What a command has to say: title, a line or more on the record, the conclusion, and the blocks.

    `settled` is True where the conclusion names something. The terminal shows the conclusion last, a page first.
    """

    title: str
    subtitle: Sequence[str]
    conclusion_title: str
    conclusion: str
    settled: bool
    blocks: Sequence[Block]

    @property
    def charts(self) -> tuple[Chart, ...]:
        """The charts that have something to show."""
        return tuple(block.chart for block in self.blocks if isinstance(block, Picture) and not block.empty)
