"""Settings from YAML files and mappings: one reader, one wording of what is wrong; any layer may use it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from brv_hypo.errors import UsageError
from brv_hypo.files.mappings import read_yaml
from brv_hypo.files.printed import meant, one_line

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
