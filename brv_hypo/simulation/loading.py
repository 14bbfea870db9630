"""Configurations from files and mappings, with refusals that say what to write instead."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from brv_hypo.errors import UsageError
from brv_hypo.files.mappings import read_yaml
from brv_hypo.files.printed import one_line
from brv_hypo.files.regular import kind_of
from brv_hypo.mechanisms.registry import record_effects
from brv_hypo.simulation.config import SimulationConfig

_PACKAGE = Path(__file__).resolve().parents[1]
# An installed wheel carries the configurations inside the package, a checkout beside it.
_HOMES = (_PACKAGE / "configs", _PACKAGE.parent / "configs")

ConfigSource = SimulationConfig | Mapping[str, Any] | str | Path


def config_names(folder: str = "") -> tuple[str, ...]:
    """Names of the configurations that come with the program; `folder` holds those of another kind."""
    return tuple(sorted({file.stem for home in _HOMES for file in (home / folder).glob("*.yaml")}))


def config_path(name: str | Path, folder: str = "") -> Path:
    """The file of a configuration: an existing path, or a name of `config_names` with or without `.yaml`.

    Raises UsageError with the nearest names.
    """
    if kind_of(name) not in (None, "a directory"):  # what is no file either is refused where it is read
        return Path(name)
    for home in _HOMES:
        for candidate in (home / folder / Path(name), home / folder / f"{name}.yaml"):
            if kind_of(candidate) == "a file":
                return candidate
    known = config_names(folder)
    near = difflib.get_close_matches(Path(name).stem, known, n=2, cutoff=0.4)
    hint = f"did you mean {' or '.join(near)}?" if near else f"those that come along: {', '.join(known)}."
    raise UsageError(f"no configuration file '{name}', and none of that name comes with the program; {hint}")


def load_config(source: ConfigSource, *, plant: Sequence[str] = ()) -> SimulationConfig:
    """The configuration of a file, a name, a mapping or a `SimulationConfig`, with `plant` sets planted.

    Raises UsageError that names each wrong key, what it holds and what is expected.
    """
    config = source if isinstance(source, SimulationConfig) else _validated(source)
    unknown = [name for name in plant if name not in config.plantable]
    if unknown:
        raise UsageError(
            f"'{unknown[0]}' is not plantable in '{config.title}'; its `plantable` block holds "
            f"{', '.join(config.plantable) or 'nothing'}. Choose one of these, or add it to `mechanisms`."
        )
    return config.planting(plant) if plant else config


def validated(data: Mapping[str, Any], origin: str) -> SimulationConfig:
    """The configuration of a mapping; `origin` names it in the refusal."""
    try:
        return SimulationConfig.model_validate(data)
    except ValidationError as error:
        problems = "; ".join(_problem(detail) for detail in error.errors())
        raise UsageError(f"{origin}: {problems}. All values are SI, angles in rad.") from None


def _validated(source: Mapping[str, Any] | str | Path) -> SimulationConfig:
    if isinstance(source, Mapping):
        return validated(_on_base(source), "simulation configuration")
    path = config_path(source)
    return validated(_on_base(_read(path)), str(path))


def _read(path: Path) -> Mapping[str, Any]:
    return read_yaml(path, "a simulation with `vehicle`, `start` ...")


def _on_base(data: Mapping[str, Any]) -> Mapping[str, Any]:
    """`base: NAME` takes over another file's top-level keys, where the mapping has none of its own."""
    if "base" not in data:
        return data
    own = {key: value for key, value in data.items() if key != "base"}
    base = _read(config_path(str(data["base"])))
    if "base" in base:
        raise UsageError(f"the base configuration '{data['base']}' has a base itself; one level is allowed")
    return {**base, **own}


def _problem(detail: Any) -> str:
    place = ".".join(str(part) for part in detail["loc"]) or "the whole"
    if detail["type"] == "missing":
        return f"'{place}' is missing"
    if detail["type"] == "extra_forbidden":
        return f"'{place}' is not a known key{_nearest_key(detail['loc'])}"
    message = detail["msg"].removeprefix("Value error, ")
    return f"'{place}': {message}" + (
        "" if isinstance(detail["input"], dict) else f", got {one_line(repr(detail['input']))}"
    )


def _nearest_key(location: Sequence[str | int]) -> str:
    leaf = str(location[-1])
    near = difflib.get_close_matches(leaf, _keys(SimulationConfig), n=1, cutoff=0.6)
    if near and near[0] != leaf:
        return f" (is '{near[0]}' meant?)"
    return _nearest_effect(location) if location[0] == "instruments" else ""


def _nearest_effect(location: Sequence[str | int]) -> str:
    """Where an instrument's error is written beside its noise: the record effect that it is."""
    effects = [effect.name for effect in record_effects()]
    near = difflib.get_close_matches("_".join(map(str, location[1:])), effects, n=1, cutoff=0.7)
    meant = f"is the record effect '{near[0]}' meant? " if near else ""
    return f" ({meant}errors are written under `instruments.errors`, by effect and component)"


def _keys(model: type[BaseModel]) -> list[str]:
    """Every key of the schema, at any depth."""
    names: list[str] = []
    for name, field in model.model_fields.items():
        names.append(name)
        inner = (field.annotation, *getattr(field.annotation, "__args__", ()))
        names += [
            key
            for kind in inner
            if isinstance(kind, type) and issubclass(kind, BaseModel)
            for key in _keys(kind)
        ]
    return names
