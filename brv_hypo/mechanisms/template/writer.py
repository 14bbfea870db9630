"""Writes a plugin package from the template."""

from __future__ import annotations

import keyword
import re
from importlib.resources import files
from pathlib import Path
from string import Template

from brv_hypo.errors import UsageError
from brv_hypo.io.atomic import whole_folder

_NAME = re.compile(r"[a-z][a-z0-9_]*")

# Template file -> path in the package, in which $module stands for the module's name.
_COMMON = {"pyproject.toml.tmpl": "pyproject.toml", "README.md.tmpl": "README.md"}
_MECHANISM = {**_COMMON, "module.py.tmpl": "$module.py", "test_module.py.tmpl": "tests/test_$module.py"}
_EFFECT = {**_COMMON, "effect.py.tmpl": "$module.py", "test_effect.py.tmpl": "tests/test_$module.py"}


def write_plugin(name: str, parent: Path, *, effect: bool = False) -> Path:
    """A plugin package for the mechanism `name`, written whole or not at all to a new directory in `parent`.

    With `effect` it is an effect on the record instead.

    Returns the directory, `brv-hypo-<name>`. Raises UsageError where the name cannot be one, or the
    directory exists or cannot be written.
    """
    if not _NAME.fullmatch(name) or keyword.iskeyword(name) or name == "none":
        raise UsageError(
            f"'{name}' cannot name a mechanism: expected lower case letters, digits and _, a letter first, "
            "and neither 'none' nor a word of Python. For example 'uneven_ablation'."
        )
    words = name.replace("_", " ")
    values = {
        "name": name,
        "module": f"brv_hypo_{name}",
        "distribution": f"brv-hypo-{name.replace('_', '-')}",
        "klass": "".join(word.capitalize() for word in words.split()),
        "title": words,
        "what": "record effect" if effect else "mechanism",
        "topic": "effect" if effect else "mechanism",
        "use": "brv-hypo trace flight.h5" if effect else f"brv-hypo compare flight.h5 --mechanisms {name},sticking",
    }
    target = parent / values["distribution"]
    with whole_folder(target) as folder:
        _fill(folder, values, _EFFECT if effect else _MECHANISM)
    return target


def _fill(directory: Path, values: dict[str, str], parts: dict[str, str]) -> None:
    """Every template file, filled in, below `directory`."""
    source = files("brv_hypo.mechanisms.template")
    for template, name in parts.items():
        written = directory / Template(name).substitute(values)
        written.parent.mkdir(parents=True, exist_ok=True)
        text = source.joinpath(template).read_text(encoding="utf-8")
        written.write_text(Template(text).substitute(values), encoding="utf-8")
