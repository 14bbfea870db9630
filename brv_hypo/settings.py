"""Settings from YAML files and mappings, and commented files to start from; any layer may use it.

`settings_of` and `read_settings` have one wording for what is wrong: each setting, the value that it has and
what is expected. `commented` writes a YAML file in which every setting stands at its default, below its
meaning, which is the description of the model's field.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import to_json

from brv_hypo.errors import UsageError
from brv_hypo.io.mappings import read_yaml
from brv_hypo.io.text import meant, one_line

Settings = TypeVar("Settings", bound=BaseModel)


def settings_of(model: type[Settings], source: Settings | Mapping[str, Any] | str | Path | None) -> Settings:
    """Settings as they are, those of a mapping or of a YAML file, or for None the defaults; UsageError as below."""
    if isinstance(source, model):
        return source
    if isinstance(source, Mapping):
        return read_settings(model, None, **source)
    if source is None or isinstance(source, str | Path):
        return read_settings(model, source)
    raise UsageError(
        f"got settings of type {type(source).__name__}, expected a {model.__name__}, a mapping of its fields, or the "
        "path of a YAML file."
    )


def read_settings(model: type[Settings], path: str | Path | None, **overrides: Any) -> Settings:
    """The settings in the YAML file at `path` (defaults where None), with `overrides` set over them.

    Raises UsageError that names each wrong setting, what it holds and what is expected.
    """
    content = {} if path is None else read_yaml(path, "settings")
    try:
        return model.model_validate({**content, **overrides})
    except ValidationError as error:
        where = "the settings" if path is None else f"the settings in {path}"
        problems = "; ".join(_problem(detail, tuple(model.model_fields)) for detail in error.errors())
        raise UsageError(f"{where}: {problems}.") from None


def _problem(detail: Any, known: tuple[str, ...]) -> str:
    place = ".".join(str(part) for part in detail["loc"])
    if detail["type"] == "extra_forbidden":
        hint = meant(place, known, f"known are {', '.join(known)}", cutoff=0.5)
        return f"there is no setting '{place}' ({hint})"
    return f"'{place}': {detail['msg']}, got {one_line(repr(detail['input']))}"


def commented(model: type[BaseModel], title: str) -> str:
    """A YAML file that sets nothing: each setting stands commented out at its default, below what it means."""
    lines = [f"# {title}", "# Every setting is at its default; take away the # before one to change it.", ""]
    for name, field in model.model_fields.items():
        lines += [f"# {line}" for line in textwrap.wrap(field.description or "", 100)]
        default = field.get_default(call_default_factory=True)
        value = default if isinstance(default, str) else to_json(default).decode()
        lines += [f"#{name}: {value}", ""]
    return "\n".join(lines)
