"""The manual in a terminal, by rich, and as one HTML file that opens offline, with search.

Both show code under the name of the file that it belongs in; in the terminal nothing of a table is cut.
`ManualText` and `manual_page` are the entrances.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import ClassVar

from markdown_it import MarkdownIt
from markdown_it.renderer import RendererHTML
from markdown_it.token import Token
from markdown_it.utils import EnvType, OptionsDict
from rich.console import Console, ConsoleOptions, RenderResult
from rich.markdown import CodeBlock, Markdown, TableElement
from rich.table import Table
from rich.text import Text

from brv_hypo import __version__
from brv_hypo.docs import file_of, text, topics


class _WholeTable(TableElement):
    """A word that is longer than its column goes on in the next line."""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for table in super().__rich_console__(console, options):
            if isinstance(table, Table):
                for column in table.columns:
                    column.overflow = "fold"
            yield table


class _NamedCode(CodeBlock):
    """Code under the name of the file that it belongs in."""

    file = ""

    @classmethod
    def create(cls, markdown: Markdown, token: Token) -> _NamedCode:
        block = super().create(markdown, token)
        assert isinstance(block, cls)
        block.file = file_of(token.info)
        return block

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        if self.file:
            yield Text(f"{self.file}:", "bold")
        yield from super().__rich_console__(console, options)


class ManualText(Markdown):
    """A page of the manual."""

    elements: ClassVar = {**Markdown.elements, "table_open": _WholeTable, "fence": _NamedCode}


# ---- The whole manual as one HTML file that opens offline, with search ----


def manual_page() -> str:
    """Every topic in reading order, a list of them at the side, and a field that searches all of them."""
    from brv_hypo.report.html import render  # NumPy with it, which the terminal does without

    markdown = MarkdownIt("commonmark", {"html": False}).enable("table")
    markdown.add_render_rule("fence", _named_fence)
    known = topics()
    articles = {name: markdown.render(text(name)) for name in known}
    return render("manual.html.j2", version=__version__, topics=known, articles=articles)


def _named_fence(
    renderer: RendererHTML, tokens: Sequence[Token], index: int, options: OptionsDict, env: EnvType
) -> str:
    """Code under the name of the file that it belongs in."""
    file = file_of(tokens[index].info)
    heading = f'<p class="file">{escape(file)}</p>\n' if file else ""
    return heading + renderer.fence(tokens, index, options, env)
