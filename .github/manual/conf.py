"""The manual as a site: `sphinx-build -W .github/manual site`. Its text, notebooks and docstrings are the package's."""

import re

from sphinx.application import Sphinx

from brv_hypo import __version__
from brv_hypo.docs import topics

project, release, copyright = "brv-hypo", __version__, "the owner: all rights are reserved"
extensions = ["sphinx.ext.autodoc", "sphinx.ext.napoleon", "myst_nb"]
exclude_patterns = ["topics/*.py", "topics/__pycache__"]
html_theme = "furo"
html_title = f"brv-hypo {release}"
html_copy_source = html_show_sphinx = False
autodoc_typehints = "none"  # types are in the docstrings, for readers
napoleon_google_docstring = napoleon_use_rtype = False
nb_execution_mode = "off"  # outputs are kept in the notebooks
nb_ipywidgets_js = {}  # the site asks the network for nothing


def linked(app: Sphinx, document: str, source: list[str]) -> None:
    """Make a link of `brv-hypo docs TOPIC` and `docs TOPIC` in a topic."""
    names = "|".join(topics())
    if document.startswith("topics/"):
        source[0] = re.sub(rf"(?<!`)`((?:brv-hypo )?docs ({names}))`(?!`)", r"{doc}`\1 <\2>`", source[0])


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("source-read", linked)
