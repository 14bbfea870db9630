"""A document as one HTML file that opens offline, in light, dark and print; plotly's script is in it once, packed.

The script is plotly.js (basic), MIT licence: `page/plotly-basic.min.js.gz`, packed as its distribution has it.
"""

from __future__ import annotations

import base64
import gzip
import json
import re
from collections.abc import Sequence
from html import escape
from importlib.resources import files

from brv_hypo.report.blocks import TEXT_COLUMNS, Block, Document, Picture, Table, Texts
from brv_hypo.report.chart import Chart
from brv_hypo.report.plotly_chart import chart_height, plotly_chart
from brv_hypo.report.provenance import Provenance

_FOLDER = "page"
_WHOLE = 9
"""A table of more columns takes the whole width of the page."""
_ROW, _LINE = 380, 32
"""Heights (px) of a row of sections, and of a line of a table: a section that is several rows high has as many sections
beside it, and no empty space."""
_CODE = re.compile(r"`([^`]+)`|(?<![\w-])(--[a-z][a-z-]*)")
"""What is typed as it stands: text between backticks, and options."""


def page(document: Document, provenance: Provenance) -> str:
    """The whole file: conclusion first, blocks, and at the foot where it came from and how to make it again."""
    style, stretches, script = (resource(name).decode() for name in ("page.css", "stretches.js", "page.js"))
    subtitle = "<br>".join(map(escape, document.subtitle))
    settled = " settled" if document.settled else ""
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(document.title)}</title>\n<style>{style}</style>\n</head>\n<body>\n"
        f'<h1>{escape(document.title)}</h1>\n<p class="quiet">{subtitle}</p>\n'
        f'<p class="verdict{settled}">{_text(document.conclusion)}</p>\n'
        f"<main>\n{_sections(document.blocks)}\n</main>\n{_footer(provenance)}\n"
        f"{_charts(document.charts)}<script>{stretches}{script}</script>\n</body>\n</html>\n"
    )


def resource(name: str) -> bytes:
    """A file that pages are made of."""
    return (files("brv_hypo.report") / _FOLDER / name).read_bytes()


def _sections(blocks: Sequence[Block]) -> str:
    return "\n".join(_section(group) for group in _groups(blocks))


def _groups(blocks: Sequence[Block]) -> list[list[Block]]:
    """Blocks that belong together: one without a heading goes with what stands before it, unless that is a chart."""
    groups: list[list[Block]] = []
    for block in blocks:
        if block.empty:
            continue
        alone = block.heading or isinstance(block, Picture)
        if alone or not groups or isinstance(groups[-1][-1], Picture):
            groups.append([block])
        else:
            groups[-1].append(block)
    return groups


def _section(group: Sequence[Block]) -> str:
    wide = any(isinstance(block, Table) and len(block.headings) > _WHOLE for block in group)
    rows = max(1, round(sum(map(_height, group)) / _ROW))
    span = f' style="grid-row: span {rows}"' if rows > 1 else ""
    return f'<section class="{"whole" if wide else ""}"{span}>{"".join(map(_content, group))}</section>'


def _height(block: Block) -> int:
    """About what the block takes, px."""
    if isinstance(block, Picture):
        return chart_height(block.chart)
    return _LINE * len(block.rows if isinstance(block, Table) else block.texts)


def _content(block: Block) -> str:
    heading = f"<h2>{escape(block.heading)}</h2>\n" if block.heading else ""
    if isinstance(block, Table):
        return heading + _table(block)
    if isinstance(block, Picture):
        return heading + _figure(block.chart)
    return f'{heading}<div class="{"warning" if block.warning else "texts"}">{_texts(block)}</div>'


def _figure(chart: Chart) -> str:
    caption = f"<figcaption>{escape(chart.caption)}</figcaption>" if chart.caption else ""
    return f'<figure><div class="chart" role="img" aria-label="{escape(chart.heading)}"></div>{caption}</figure>'


def _texts(block: Texts) -> str:
    items = list(dict.fromkeys(map(_text, block.texts)))
    if block.bullets:
        return "<ul>" + "".join(f"<li>{item}</li>" for item in items) + "</ul>"
    return "".join(f"<p>{item}</p>" for item in items)


def _text(words: str) -> str:
    """Text as HTML, with what is typed in one piece."""
    return _CODE.sub(lambda found: f"<code>{found[1] or found[2]}</code>", escape(words))


def _table(block: Table) -> str:
    """Numbers to the right; marked rows bold."""

    def cells(tag: str, values: Sequence[str], shades: Sequence[float]) -> str:
        return "".join(
            f"<{tag}{' class=text' if heading in TEXT_COLUMNS else ''}{_shade(shade)}>{escape(value)}</{tag}>"
            for heading, value, shade in zip(block.headings, values, shades, strict=True)
        )

    plain = [0.0] * len(block.headings)
    body = "\n".join(
        f"<tr{' class=stands' if i in block.marked else ''}>"
        f"{cells('td', line, block.shades[i] if block.shades else plain)}</tr>"
        for i, line in enumerate(block.rows)
    )
    return f'<div class="wide"><table><tr>{cells("th", block.headings, plain)}</tr>\n{body}</table></div>'


def _shade(share: float) -> str:
    return f' style="background: rgba(var(--shade), {0.6 * share:.2f})"' if share > 0.0 else ""


def _footer(provenance: Provenance) -> str:
    rows = "".join(f"<dt>{escape(name)}</dt><dd><code>{escape(value)}</code></dd>" for name, value in provenance.rows)
    return f"<footer><dl>{rows}</dl></footer>"


def _charts(charts: Sequence[Chart]) -> str:
    """The script and what it draws, packed; nothing where there is nothing to draw."""
    if not charts:
        return ""
    data = json.dumps([plotly_chart(chart) for chart in charts], separators=(",", ":"), allow_nan=False)
    library = base64.b64encode(resource("plotly-basic.min.js.gz")).decode("ascii")
    packed = base64.b64encode(gzip.compress(data.encode(), mtime=0)).decode("ascii")
    return (
        f'<script type="text/plain" id="library">{library}</script>\n'
        f'<script type="text/plain" id="charts">{packed}</script>\n'
    )
