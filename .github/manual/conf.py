"""The manual as a site: `sphinx-build -W .github/manual site`. Its text, notebooks and docstrings are the package's."""

import re
import shutil
from pathlib import Path

from sphinx.application import Sphinx

from brv_hypo import __version__, docs
from brv_hypo.docs.manual import generated

# Sphinx reads below this folder alone.
shutil.copytree(
    Path(docs.__file__).parent,
    Path(__file__).parent / "topics",
    ignore=shutil.ignore_patterns("*.py", "__pycache__"),
    dirs_exist_ok=True,
)
(Path(__file__).parent / "topics" / "results.md").write_text(generated("results"), encoding="utf-8")
project, release = "brv-hypo", __version__
copyright = "the owner: all rights are reserved"
extensions = ["sphinx.ext.autodoc", "sphinx.ext.napoleon", "myst_nb"]
html_theme = "furo"
html_title = f"brv-hypo {release}"
html_copy_source = html_show_sphinx = html_show_search_summary = False  # summaries need a server
autodoc_typehints = "none"  # types are in the docstrings, for readers
napoleon_google_docstring = False
nb_execution_mode = "off"  # outputs are kept in the notebooks
nb_ipywidgets_js: dict[str, dict[str, str]] = {}  # the site loads nothing from the network


def linked(app: Sphinx, document: str, source: list[str]) -> None:
    """Make a link of `brv-hypo docs TOPIC` and `docs TOPIC` in a topic."""
    names = "|".join((*docs.topics(), "results"))
    if document.startswith("topics/"):
        source[0] = re.sub(rf"(?<!`)`((?:brv-hypo )?docs ({names}))`(?!`)", r"{doc}`\1 <\2>`", source[0])


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("source-read", linked)
