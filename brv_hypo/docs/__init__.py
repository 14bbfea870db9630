"""The manual: a Markdown file a topic and the notebooks of the gallery, beside this module; `manual` renders them."""

from __future__ import annotations

from importlib.resources import files

from brv_hypo.errors import UsageError
from brv_hypo.io.text import meant

_FIRST = (
    *("start", "record", "verdict", "loop", "mechanism", "effect", "python", "reference", "theory", "validation"),
    *("glossary", "likelihood", "subset", "changelog", "citation"),
)
_GALLERY = (
    *("own_csv", "rocket_log", "capsule_entry", "planted_mechanism", "own_mechanism", "own_process"),
    *("several_flights", "sister_flight", "kernels_alone", "many_flights"),
)


GENERATED = {"functions": "Functions of the library", "results": "Keys of results in JSON"}
"""Topics that `manual` makes of docstrings and of the fields' descriptions, with their titles."""


def topics() -> dict[str, str]:
    """Every topic with its title, in reading order."""
    found = {entry.name.removesuffix(".md") for entry in files(__name__).iterdir() if entry.name.endswith(".md")}
    order = [*(name for name in _FIRST if name in found), *sorted(found.difference(_FIRST))]
    return {name: text(name).splitlines()[0].removeprefix("# ") for name in order}


def notebooks() -> dict[str, str]:
    """The gallery: each executed notebook by the name of its file, with its content, in reading order."""
    return {f"{name}.ipynb": (files(__name__) / "notebooks" / f"{name}.ipynb").read_text("utf-8") for name in _GALLERY}


def file_of(info: str) -> str:
    """The file that a fence is to be written to, of its info string `LANGUAGE FILE`; "" for none."""
    language, _, file = info.strip().partition(" ")
    return "" if language == "sh" else file


def text(topic: str) -> str:
    """The Markdown of a topic; UsageError with the topics there are where there is no such one."""
    page = files(__name__) / f"{topic}.md"
    if not topic.isidentifier() or not page.is_file():
        pages = [name.removesuffix(".ipynb") for name in _GALLERY]
        if topic in pages:
            raise UsageError(f"'{topic}' is a notebook: `brv-hypo docs {topic} --open` shows it as a page.")
        known = [*topics(), *GENERATED]
        hint = meant(topic, (*known, *pages), "", 0.5)
        raise UsageError(
            f"the manual has no topic '{topic}'; {hint and hint + ' '}it has {', '.join(known)}, and with --open "
            f"{', '.join(pages)}."
        )
    return page.read_text(encoding="utf-8")
