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
from pydoc import locate
from typing import Any, ClassVar

from markdown_it import MarkdownIt
from markdown_it.renderer import RendererHTML
from markdown_it.token import Token
from markdown_it.utils import EnvType, OptionsDict
from rich.console import Console, ConsoleOptions, RenderResult
from rich.markdown import CodeBlock, Markdown, TableElement
from rich.table import Table
from rich.text import Text

from brv_hypo import __all__, __version__
from brv_hypo.docs import GENERATED, file_of, notebooks, text, topics


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

_FUNCTIONS = (
    *(f"brv_hypo.{name}" for name in __all__),
    *(f"brv_hypo.report.write.{name}" for name in ("write_report", "write_figures")),
    *map("brv_hypo.comparison.Comparison.{}".format, ("to_dataframe", "to_xarray", "plot", "to_json", "from_json")),
    *("brv_hypo.flight.Flight.save", "brv_hypo.subset.best_subsets", "brv_hypo.likelihood.fit"),
)
RESULTS = {
    "compare": "comparison.Comparison",
    "trace": "tracing.Trace",
    "predict": "prediction.Prediction",
    "study": "study.statistics.StudySummary",
}
FIRST = "start"  # the page that opens first


def site() -> dict[str, str]:
    """Every page of the manual by the name of its file, and the style and the search that they share."""
    from markupsafe import Markup

    from brv_hypo.report.html import render, resource  # NumPy with it, which the terminal does without

    markdown = MarkdownIt("commonmark", {"html": False}).enable("table")
    markdown.add_render_rule("fence", _fence)
    markdown.add_render_rule("code_inline", _code)
    books = {name.removesuffix(".ipynb"): json.loads(content)["cells"] for name, content in notebooks().items()}
    articles = {name: markdown.render(text(name)) for name in topics()}
    articles |= {name: render("book.html.j2", cells=cells, markdown=markdown.render) for name, cells in books.items()}
    articles |= {name: markdown.render(generated(name)) for name in GENERATED}
    titles = {name: article.partition("<h1>")[2].partition("</h1>")[0] for name, article in articles.items()}
    groups = {"The manual": [*topics()], "Gallery": [*books], "Python": [*GENERATED]}
    written, sections = {}, []
    for name, article in articles.items():
        first, *rest = re.split("<h2>(.*?)</h2>", article)
        pairs = zip(rest[::2], rest[1::2], strict=True)
        parts = [(re.sub(r"\W+", "-", title.lower()), title, body) for title, body in pairs]
        about = {"name": name, "titles": titles, "groups": groups, "version": __version__}
        written[f"{name}.html"] = render("manual.html.j2", first=first, parts=parts, **about)
        sections += [(name, *part[:2], Markup(part[2]).striptags()) for part in (("", titles[name], first), *parts)]
    style = "".join(resource(name).decode() for name in ("page.css", "manual.css"))
    data = f"const titles = {json.dumps(titles)};\nconst sections = {json.dumps(sections)};\n"
    return {**written, "manual.css": style, "manual.js": data + resource("manual.js").decode()}


def _fence(renderer: RendererHTML, tokens: Sequence[Token], index: int, options: OptionsDict, env: EnvType) -> str:
    """Code under the name of the file that it belongs in."""
    file = file_of(tokens[index].info)
    heading = f'<p class="file">{escape(file)}</p>\n' if file else ""
    return heading + renderer.fence(tokens, index, options, env)


def _code(renderer: RendererHTML, tokens: Sequence[Token], index: int, options: OptionsDict, env: EnvType) -> str:
    """Code within a line; what opens a topic in the terminal is a link to it."""
    code = f"<code>{escape(tokens[index].content)}</code>"
    topic = re.fullmatch(r"(?:brv-hypo )?docs (\w+)", tokens[index].content)
    return f'<a href="{topic[1]}.html">{code}</a>' if topic else code


def generated(topic: str) -> str:
    """One of `GENERATED` as Markdown."""
    return {"functions": _functions, "results": _results}[topic]()


def _results() -> str:
    """Every key of what `--json` writes, of the descriptions of the fields."""
    parts = {"": "# Results in JSON\n\nA key's type is in parentheses where it holds keys of its own, a table below."}
    for command, name in RESULTS.items():
        model: Any = locate(f"brv_hypo.{name}")
        schema = model.model_json_schema(by_alias=True, mode="serialization")
        for title, part in {command: schema, **schema["$defs"]}.items():
            rows = ["| key | holds |", "|---|---|"]
            for key, field in part["properties"].items():
                held = ", ".join(dict.fromkeys(re.findall(r"#/\$defs/(\w+)", json.dumps(field))))
                rows.append(f"| `{key}` | {field['description'].rstrip('.')}{f' ({held})' if held else ''} |")
            parts.setdefault(title, f"## {title}\n\n{part.get('description', '')}\n\n" + "\n".join(rows))
    return "\n\n".join(parts.values())


def _functions() -> str:
    """The docstrings of the public functions as Markdown."""
    parts = ["# Functions"]
    for name in _FUNCTIONS:
        function: Any = locate(name)
        declared = inspect.signature(function)
        bare = [each.replace(annotation=each.empty) for each in declared.parameters.values()]
        signature = f"{name}{declared.replace(parameters=bare, return_annotation=declared.empty)}"
        text, *sections = re.split(r"\n(.+)\n---+\n", inspect.getdoc(function) or "")
        for title, content in zip(sections[::2], sections[1::2], strict=True):
            named = re.sub(r"^(\w.*?)(?: : (.+))?$", r"- `\1` \2", content, flags=re.MULTILINE)
            listed = re.sub(r"\n    (?=\S)", r"  \n    ", named)
            text += f"\n\n**{title}**\n\n" + (f"```python\n{content}\n```" if title == "Examples" else listed)
        wrapped = textwrap.fill(signature, 100, subsequent_indent="    ")
        parts.append(f"## {name.rpartition('.')[2]}\n\n```python\n{wrapped}\n```\n\n{text}")
    return "\n\n".join(parts)
