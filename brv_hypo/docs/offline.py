"""The whole manual as one HTML file that opens offline, with search."""

from __future__ import annotations

from html import escape

from markdown_it import MarkdownIt

from brv_hypo.docs import text, topics
from brv_hypo.report.pages import resource
from brv_hypo.version import version


def manual_page() -> str:
    """Every topic in reading order, a list of them at the side, and a field that searches all of them."""
    markdown = MarkdownIt("commonmark", {"html": False}).enable("table")
    known = topics()
    links = "".join(f'<li><a href="#{name}">{escape(title)}</a></li>' for name, title in known.items())
    articles = "\n".join(f'<article id="{name}">{markdown.render(text(name))}</article>' for name in known)
    style, own, script = (resource(name).decode() for name in ("page.css", "manual.css", "manual.js"))
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>brv-hypo {escape(version())}: the manual</title>\n<style>{style}{own}</style>\n</head>\n<body>\n"
        '<nav><label for="search">Search</label><input id="search" type="search" autocomplete="off">'
        f'<p id="found" class="quiet" role="status"></p><ul>{links}</ul></nav>\n'
        f'<div class="manual">\n{articles}\n'
        f'<footer class="quiet">brv-hypo {escape(version())}</footer>\n</div>\n'
        f"<script>{script}</script>\n</body>\n</html>\n"
    )
