"""Commented YAML files of settings, from the models themselves: every setting with its default and what it means."""

from __future__ import annotations

import json
import re
import textwrap

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

_NAMES = r"(?:`\w+`(?: [^\s`:,.;]+)?,? ?)+"
_ENTRY = re.compile(rf"(?P<names>{_NAMES}): (?P<text>.*?)(?={_NAMES}: |\Z)", re.DOTALL)
"""In a docstring, "`name` unit: meaning", or several names before one meaning."""
_WIDTH = 100


def commented(model: type[BaseModel], title: str) -> str:
    """A YAML file that sets nothing: each setting stands commented out at its default, below what it means."""
    said = meanings(model)
    lines = [f"# {title}", "# Every setting is at its default; take away the # before one to change it.", ""]
    for name, field in model.model_fields.items():
        text = field.description or said.get(name, "")
        lines += [f"# {line}" for line in textwrap.wrap(text, _WIDTH)]
        lines += [f"#{line}" for line in _setting(name, field.get_default(call_default_factory=True))]
        lines.append("")
    return "\n".join(lines)


def meanings(model: type[BaseModel]) -> dict[str, str]:
    """What the model's docstring says of each setting; one text may stand for several."""
    text = " ".join((model.__doc__ or "").split())
    found: dict[str, str] = {}
    for entry in _ENTRY.finditer(text):
        for name in re.findall(r"`(\w+)`", entry["names"]):
            found.setdefault(name, entry["text"].strip())
    return found


def _setting(name: str, default: object) -> list[str]:
    if default is PydanticUndefined:
        return [f"{name}:  # must be given"]
    value = default.model_dump(mode="json") if isinstance(default, BaseModel) else default
    return [f"{name}: {value if isinstance(value, str) else json.dumps(value)}"]
