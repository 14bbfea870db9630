"""A plugin package to start from; `write_plugin` fills it in. Files end in .tmpl and hold $placeholders.

pyproject.toml.tmpl  the entry point by which the plugin is found
module.py.tmpl       the mechanism; effect.py.tmpl the record effect
test_module.py.tmpl, test_effect.py.tmpl    conformance, one test of the physics, planted and recovered
README.md.tmpl       how to install, check and compare it
"""

from __future__ import annotations

import keyword
import re
from importlib.resources import files
from pathlib import Path
from string import Template

from brv_hypo.errors import UsageError
from brv_hypo.io.atomic import whole_folder

_NAME = re.compile(r"[a-z][a-z0-9_]*")


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
    kind = "effect" if effect else "module"
    parts = {
        "pyproject.toml": "pyproject.toml",
        "README.md": "README.md",
        f"{kind}.py": f"{values['module']}.py",
        f"test_{kind}.py": f"tests/test_{values['module']}.py",
    }
    target = parent / values["distribution"]
    with whole_folder(target) as folder:
        for template, name in parts.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            text = files(__name__).joinpath(f"{template}.tmpl").read_text(encoding="utf-8")
            (folder / name).write_text(Template(text).substitute(values), encoding="utf-8")
    return target
