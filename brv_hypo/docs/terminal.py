"""The manual in a terminal: rich's Markdown, with tables of which nothing is cut, and files with their names."""

from __future__ import annotations

from typing import ClassVar

from markdown_it.token import Token
from rich.console import Console, ConsoleOptions, RenderResult
from rich.markdown import CodeBlock, Markdown, TableElement
from rich.table import Table
from rich.text import Text

from brv_hypo.docs import file_of


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
