"""Reports as one HTML file that opens offline: plotly's script is in it, once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import plotly.graph_objects as go
from plotly.io import to_html
from plotly.offline import get_plotlyjs

from brv_hypo.report.figures import FONT
from brv_hypo.report.rows import TEXT_COLUMNS

_STYLE = f"""
body {{ font: 16px/1.5 {FONT}; color: #1a1a1a; max-width: 60rem; margin: 2.5rem auto;
  padding: 0 1.25rem; }}
h1 {{ font-size: 1.5rem; font-weight: 600; margin-bottom: .25rem; }}
h2 {{ font-size: 1.1rem; font-weight: 600; margin: 2.25rem 0 .5rem; }}
.quiet {{ color: #595959; font-size: .9rem; }}
.verdict {{ border-left: 4px solid #0072B2; padding: .4rem 1rem; margin: 1.25rem 0; font-size: 1.1rem; }}
.wide {{ overflow-x: auto; }}
table {{ border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .92rem; }}
th, td {{ text-align: right; padding: .25rem .9rem .25rem 0; white-space: nowrap; }}
th {{ font-weight: 600; border-bottom: 1px solid #1a1a1a; }}
td.text, th.text {{ text-align: left; }}
tr.stands td {{ font-weight: 600; }}
"""


@dataclass(frozen=True)
class Block:
    """One headed part of a page, in HTML."""

    heading: str
    content: str


def page(title: str, subtitle: str, verdict: str, blocks: Sequence[Block]) -> str:
    """The whole document."""
    body = "\n".join(
        f"<section><h2>{escape(block.heading)}</h2>\n{block.content}</section>"
        for block in blocks
        if block.content
    )
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n<script>{get_plotlyjs()}</script>\n</head>\n<body>\n"
        f'<h1>{escape(title)}</h1>\n<p class="quiet">{escape(subtitle)}</p>\n'
        f'<p class="verdict">{escape(verdict)}</p>\n{body}\n</body>\n</html>\n'
    )


def drawn(figure: go.Figure) -> str:
    """A figure as HTML that relies on the page's script."""
    return str(
        to_html(
            figure,
            full_html=False,
            include_plotlyjs=False,
            config={"displayModeBar": "hover", "displaylogo": False},
        )
    )


def table(headings: Sequence[str], lines: Sequence[Sequence[str]], *, marked: Sequence[int] = ()) -> str:
    """A table, numbers to the right; the rows `marked` are bold."""

    def cells(tag: str, values: Sequence[str]) -> str:
        return "".join(
            f"<{tag}{' class=text' if heading in TEXT_COLUMNS else ''}>{escape(value)}</{tag}>"
            for heading, value in zip(headings, values, strict=True)
        )

    body = "\n".join(
        f"<tr{' class=stands' if i in marked else ''}>{cells('td', line)}</tr>"
        for i, line in enumerate(lines)
    )
    return f'<div class="wide"><table><tr>{cells("th", headings)}</tr>\n{body}</table></div>'


def bullets(messages: Sequence[str]) -> str:
    """A list; nothing where there are none."""
    items = "".join(f"<li>{escape(message)}</li>" for message in dict.fromkeys(messages))
    return f"<ul>{items}</ul>" if items else ""
