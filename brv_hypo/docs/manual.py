"""The manual in a terminal, by rich, and as HTML pages that open offline, with search.

Both show code under the name of the file that it belongs in; in the terminal nothing of a table is cut.
`ManualText` and `site` are the entrances. The hosted manual has the same sources (`.github/manual`).
"""

from __future__ import annotations

import inspect
import json
import re
import textwrap
from collections.abc import Sequence
from html import escape
from importlib import import_module
from itertools import pairwise
from operator import attrgetter
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
from brv_hypo.docs import file_of, notebooks, text, topics


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


# ---- The manual as pages that open offline, with search: topics, gallery, functions ----

_FUNCTIONS = {
    "brv_hypo": "load_flight reconstruct compare trace predict simulate run_study plot_compare",
    "brv_hypo.report.write": "write_report write_figures",
    "brv_hypo.flight": "Flight.save Flight.plot",
    "brv_hypo.ranking": "Comparison.to_dataframe Comparison.to_json Comparison.from_json",
    "brv_hypo.subset": "best_subsets",
    "brv_hypo.likelihood": "fit",
}
"""By module; of what every result has, those of one."""
REFERENCE = "functions"  # the page of all functions
_HEADINGS = ("h1", "h2")  # with anchors; what is searched lies below each
_OF_FENCE = "output"  # a fence that is HTML already


def site() -> dict[str, str]:
    """Every page of the manual by the name of its file, and the style and the search that they share."""
    from brv_hypo.report.html import render, resource  # NumPy with it, which the terminal does without

    books = {name.removesuffix(".ipynb"): _book_text(content) for name, content in notebooks().items()}
    sources = {**{name: text(name) for name in topics()}, **books, REFERENCE: _reference()}
    titles = {name: source.partition("\n")[0].removeprefix("# ") for name, source in sources.items()}
    groups = {"The manual": [*topics()], "Gallery": [*books], "Python": [REFERENCE]}
    lists = (f"## {group}\n" + "\n".join(f"- [{titles[n]}]({n}.html)" for n in names) for group, names in groups.items())
    sources = {"index": "# The manual\n\n" + "\n\n".join(lists), **sources}
    markdown = MarkdownIt("commonmark", {"html": False}).enable("table")
    markdown.add_render_rule("fence", _fence)
    markdown.add_render_rule("code_inline", _code)
    written, sections = {}, []
    for name, source in sources.items():
        tokens = markdown.parse(source)
        headings: list[tuple[str, str]] = []
        for token, following in pairwise(tokens):
            if token.type == "heading_open" and token.tag in _HEADINGS:
                title = following.content.replace("`", "")
                anchor = re.sub(r"\W+", "-", title.lower()).strip("-")
                token.attrSet("id", anchor)
                headings.append((anchor, title))
                sections.append({"page": name, "anchor": anchor, "title": title, "text": ""})
            elif token.content and token.info != _OF_FENCE:
                sections[-1]["text"] += f" {re.sub(r'[(]data:[^)]*[)]', '', token.content)}"
        article = markdown.renderer.render(tokens, markdown.options, {})
        about = {"name": name, "titles": titles, "groups": groups, "headings": headings[1:], "version": __version__}
        written[f"{name}.html"] = render("manual.html.j2", article=article, **about)
    style = "".join(resource(name).decode() for name in ("page.css", "manual.css"))
    data = f"const titles = {json.dumps(titles)};\nconst sections = {json.dumps(sections)};\n"
    return {**written, "manual.css": style, "manual.js": data + resource("manual.js").decode()}


def _fence(renderer: RendererHTML, tokens: Sequence[Token], index: int, options: OptionsDict, env: EnvType) -> str:
    """Code under the name of the file that it belongs in; an output of a notebook as it is."""
    token = tokens[index]
    if token.info == _OF_FENCE:
        return f'<div class="output">{token.content}</div>\n'
    file = file_of(token.info)
    heading = f'<p class="file">{escape(file)}</p>\n' if file else ""
    return heading + renderer.fence(tokens, index, options, env)


def _code(renderer: RendererHTML, tokens: Sequence[Token], index: int, options: OptionsDict, env: EnvType) -> str:
    """Code within a line; what opens a topic in the terminal is a link to it."""
    code = f"<code>{escape(tokens[index].content)}</code>"
    topic = re.fullmatch(r"(?:brv-hypo )?docs (\w+)", tokens[index].content)
    return f'<a href="{topic[1]}.html">{code}</a>' if topic else code


def _book_text(book: str) -> str:
    """A notebook as Markdown: each cell, and of what it gave a picture, a table or a text."""
    parts = []
    for cell in json.loads(book)["cells"]:
        source = "".join(cell["source"])
        parts.append(source if cell["cell_type"] == "markdown" else f"```python\n{source}\n```")
        for output in cell.get("outputs", ()):
            data = output.get("data", {"text/plain": output.get("text", "")})
            if "image/png" in data:
                parts.append(f"![figure](data:image/png;base64,{''.join(data['image/png'].split())})")
            elif "text/html" in data:
                parts.append(f"~~~{_OF_FENCE}\n{''.join(data['text/html'])}\n~~~")
            else:
                parts.append(f"~~~text\n{''.join(data['text/plain'])}\n~~~")
    return "\n\n".join(parts)


def _reference() -> str:
    """The docstrings of the public functions as Markdown."""
    parts = ["# Functions"]
    for place, name in ((place, name) for place, names in _FUNCTIONS.items() for name in names.split()):
        function = attrgetter(name)(import_module(place))
        declared = inspect.signature(function)
        bare = [each.replace(annotation=each.empty) for each in declared.parameters.values()]
        signature = f"{place}.{name}{declared.replace(parameters=bare, return_annotation=declared.empty)}"
        text, *sections = re.split(r"\n(.+)\n---+\n", inspect.getdoc(function) or "")
        for title, content in zip(sections[::2], sections[1::2], strict=True):
            named = re.sub(r"^(\w.*?)(?: : (.+))?$", r"- `\1` \2", content, flags=re.MULTILINE)
            listed = re.sub(r"\n    (?=\S)", r"  \n    ", named)
            text += f"\n\n**{title}**\n\n" + (f"```python\n{content}\n```" if title == "Examples" else listed)
        parts.append(f"## {name}\n\n```python\n{textwrap.fill(signature, 100, subsequent_indent='    ')}\n```\n\n{text}")
    return "\n\n".join(parts)
