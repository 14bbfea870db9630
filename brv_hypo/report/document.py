"""What a result is shown as: one document of tables, texts and charts.

A `Chart` is what is drawn, apart from how: panels of lines, bands and bars over a common axis, with marks and shaded
spans. Colours go by role, so that light, dark and print have their own; later layers lie on top of earlier ones.

A `Document` is title, conclusion and blocks (`Table`, `Texts`, `Chart`), in sections that a page folds. `terminal`,
`html` and `figures` render the same document. A block without content is left out; `shown` says where it appears:
"always", with -v in the terminal ("verbose"), or on the page alone ("page"). A page shows everything.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from brv_hypo.arrays import FloatArray

Role = Literal["measured", "first", "second", "third", "none", "guide"]
Values = Sequence[float] | FloatArray

MOST_POINTS = 2500  # points drawn of a history; a longer one is thinned evenly, which no screen shows
MOST_OF_A_PATH = 6000  # the same of a path, whose intervals are side by side
SMALL, LARGE = 2.6, 8.0  # px: of dots that are many, and few


@dataclass(frozen=True)
class Line:
    """A history, or dots."""

    x: Values
    y: Values
    role: Role
    name: str = ""  # in the legend; "" for none
    dots: bool = False
    dashed: bool = False
    size: float = SMALL  # of dots, px
    hidden: bool = False  # until its name in a page's legend is clicked; picture files leave it out
    labels: Sequence[str] = ()  # to the right of each dot; of a line or more
    error: tuple[Values, Values] | None = None  # how far y may lie below and above
    spread: Values | None = None  # how far x may lie to either side


@dataclass(frozen=True)
class Band:
    """The area between `low` and `high` over `x`."""

    x: Values
    low: Values
    high: Values
    name: str = "± 2 sigma"
    role: Role = "measured"


@dataclass(frozen=True)
class Bars:
    """Horizontal bars, the first on top, each with its text."""

    names: Sequence[str]
    values: Values
    texts: Sequence[str] = ()
    role: Role = "first"
    name: str = ""  # in the legend; "" for none
    error: tuple[Values, Values] | None = None  # how far each may end below and above


Layer = Line | Band | Bars


@dataclass(frozen=True)
class Mark:
    """A vertical dashed line at `at`, such as a knot; `name` is written beside it, else the chart's legend has one."""

    at: float
    name: str = ""


@dataclass(frozen=True)
class Span:
    """A part of the horizontal axis that is shaded, as samples that are masked; the legend has its name."""

    start: float
    stop: float
    name: str = ""
    role: Literal["masked", "first"] = "masked"


@dataclass(frozen=True)
class Panel:
    """Layers over one pair of axes."""

    title: str  # of the vertical axis
    layers: Sequence[Layer]
    log: bool = False
    range: tuple[float, float] | None = None
    categories: Sequence[str] = ()  # texts at the ticks 0, 1, ... of the vertical axis


@dataclass(frozen=True)
class PlanePath:
    """A curve in a plane over time (s), drawn interval by interval at one scale, `columns` beside each other."""

    time: Values
    x: Values
    y: Values
    y_title: str
    cycle: float  # time in which it goes round once, s

    cycles: ClassVar[int] = 4  # of an interval: few enough to follow the line, enough to see it turn and grow
    columns: ClassVar[int] = 4
    most: ClassVar[int] = 16  # intervals at most, which is what a column of a page holds legibly

    @property
    def intervals(self) -> int:
        """How many intervals there are: in full rows where there is more than one row."""
        count = min(max(round((self.time[-1] - self.time[0]) / (self.cycle * self.cycles)), 1), self.most)
        return count if count < self.columns else -(-count // self.columns) * self.columns


@dataclass(frozen=True)
class Chart:
    """Panels, one below the other, over a common horizontal axis."""

    name: str  # stem of picture files
    heading: str
    x: str  # title of the horizontal axis
    panels: Sequence[Panel]  # of a `path` its intervals, with their titles above them
    over_time: bool = False  # charts over time share their axis with each other
    path: PlanePath | None = None
    log: bool = False
    range: tuple[float, float] | None = None
    marks: Sequence[Mark] = ()
    spans: Sequence[Span] = ()
    caption: str = ""
    counted: bool = False  # whether the horizontal axis has whole numbers alone
    dashed: str = ""  # what the marks without names are, in the legend

    shown: ClassVar[Literal["page"]] = "page"  # and picture files; a terminal leaves it out

    @property
    def columns(self) -> int:
        """Panels beside each other."""
        return 1 if self.path is None else min(len(self.panels), self.path.columns)

    @property
    def rows(self) -> int:
        """Panels below each other."""
        return -(-len(self.panels) // self.columns)

    @property
    def named(self) -> bool:
        """Whether names of marks are written above the frame."""
        return any(mark.name for mark in self.marks)

    @property
    def lines(self) -> int:
        """Bars and categories, each of which takes a line of the chart's height."""
        bars = (layer for panel in self.panels for layer in panel.layers if isinstance(layer, Bars))
        return sum(len(layer.names) for layer in bars) + sum(len(panel.categories) for panel in self.panels)


def named(marks: Sequence[Mark]) -> list[tuple[Mark, int]]:
    """Marks with a name, from left to right, each with the line above the frame of its name: neighbours' alternate."""
    shown = sorted((mark for mark in marks if mark.name), key=lambda mark: mark.at)
    return [(mark, (len(shown) - 1 - i) % 2) for i, mark in enumerate(shown)]


def thinned(values: Values, most: int = MOST_POINTS) -> FloatArray:
    """At most so many of the values, evenly."""
    return np.asarray(values, dtype=np.float64)[:: max(1, -(-len(values) // most))]


def wrapped_degrees(angle: Values) -> FloatArray:
    """An angle (rad) in degrees within half a turn, with a break (NaN) wherever it passes from one end to the other."""
    degrees = (np.degrees(np.asarray(angle, dtype=np.float64)) + 180.0) % 360.0 - 180.0
    return np.where(np.abs(np.diff(degrees, prepend=degrees[:1])) > 180.0, np.nan, degrees)


Shown = Literal["always", "verbose", "page"]


@dataclass(frozen=True)
class Table:
    """Rows of text: each maps the heading of a column to the text in it, and all have the same columns."""

    rows: Sequence[Mapping[str, str]]
    heading: str = ""
    words: Collection[str] = ()  # columns that hold words; all others hold numbers, aligned to the right
    marked: Collection[int] = ()  # rows that are highlighted
    most: int | None = None  # rows that the terminal shows; all of them with -v
    shades: Sequence[Mapping[str, float]] = ()  # how dark (0 to 1) a page shades cells, by row and heading
    shown: Shown = "always"

    @property
    def headings(self) -> tuple[str, ...]:
        """Those of the columns."""
        return tuple(self.rows[0]) if self.rows else ()


@dataclass(frozen=True)
class Texts:
    """Sentences: a list where `bullets`, paragraphs otherwise."""

    texts: Sequence[str]
    heading: str = ""
    bullets: bool = True
    warning: bool = False  # warnings are highlighted
    strong: bool = False
    most: int | None = None  # bullets that the terminal shows; all of them with -v
    shown: Shown = "always"


Block = Table | Texts | Chart


@dataclass(frozen=True)
class Section:
    """Blocks under one heading, which a page folds; `folded`: as it is opened."""

    heading: str
    blocks: Sequence[Block]
    folded: bool = False


def flat(blocks: Sequence[Block | Section]) -> Iterator[Block]:
    """The blocks of all sections that have something to show: a row, a sentence, a panel."""
    held = {Table: lambda b: b.rows, Texts: lambda b: b.texts, Chart: lambda b: b.panels}
    for block in blocks:
        if isinstance(block, Section):
            yield from flat(block.blocks)
        elif held[type(block)](block):
            yield block


@dataclass(frozen=True)
class Document:
    """What a command has to say."""

    title: str
    subtitle: Sequence[str]  # a line or more on the record
    conclusion_title: str
    conclusion: str  # the terminal shows it last, a page first
    decided: bool  # whether the conclusion names something
    blocks: Sequence[Block | Section]
    beside: Sequence[Block] = ()  # what belongs to the conclusion, and follows it
    ahead: Sequence[Block] = ()  # what a page shows right after the conclusion, a terminal before it
    brief: str = ""  # what one line has of the conclusion; else its first sentence

    @property
    def line(self) -> str:
        """Title, and what is brief of the conclusion, for one line."""
        sentence = re.split(r"(?<=\.) (?=[A-Z`])|\n", self.conclusion, maxsplit=1)[0]
        return ": ".join(filter(None, (self.conclusion_title, self.brief or sentence)))

    @property
    def charts(self) -> tuple[Chart, ...]:
        """The charts that have something to show, in the order of a page."""
        return tuple(block for block in flat((*self.ahead, *self.beside, *self.blocks)) if isinstance(block, Chart))
