"""Finds the installed plugins, each on its own, and looks their mechanisms up by name."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from importlib.metadata import Distribution, EntryPoint, entry_points
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from brv_hypo.errors import MechanismError, UsageError
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect
from brv_hypo.mechanisms.filed import is_mechanism_file, read_mechanism
from brv_hypo.mechanisms.hookspecs import ENTRY_POINT_GROUP
from brv_hypo.mechanisms.isolation import answer, guarded, known_as
from brv_hypo.mechanisms.loading import OWN, Found, items_of, load_file

_files: tuple[str, ...] = ()


@dataclass(frozen=True)
class Installed:
    """A mechanism or record effect with the distribution, or the file, that brought it."""

    item: Mechanism | RecordEffect
    package: str
    version: str


@dataclass(frozen=True)
class Loaded:
    """What was found, by name, and why some of it was left out."""

    items: Mapping[str, Installed]
    left_out: tuple[str, ...]


def use_plugin_files(paths: Sequence[str | Path]) -> None:
    """Load these .py and .yaml files beside what is installed, instead of those of an earlier call."""
    global _files
    _files = tuple(str(Path(path).absolute()) for path in paths)
    _loaded.cache_clear()


def plugin_files() -> tuple[str, ...]:
    """The files that `use_plugin_files` was given: another process has to be told."""
    return _files


def installed() -> Mapping[str, Installed]:
    """Every mechanism and record effect of every plugin that keeps its contract, by name; loaded once."""
    return _loaded().items


def left_out() -> tuple[str, ...]:
    """Why plugins were left out when they were loaded, with package, file and line; empty before that."""
    return _loaded().left_out if _loaded.cache_info().currsize else ()


@lru_cache(maxsize=1)
def _loaded() -> Loaded:
    found: dict[str, Installed] = {}
    left: list[str] = []
    for point in _entry_points():
        package, version = _distribution(point)
        known_as(point.module, package)
        _add(found, left, package, version, partial(items_of, point.name, package, point.load))
    for path in _files:
        _add(found, left, path, "", partial(load_file, path))
    return Loaded(dict(sorted(found.items())), tuple(left))


def _add(
    found: dict[str, Installed], left: list[str], package: str, version: str, load: Callable[[], Found]
) -> None:
    """Add what `load` gives; whatever is wrong with it is a line in `left` and touches nothing else."""
    try:
        items, problems = load()
    except MechanismError as error:
        items, problems = [], [str(error)]
    left += [f"a plugin is left out: {problem}" for problem in problems]
    for item in items:
        if item.name in found:
            left.append(
                f"a plugin is left out: '{item.name}' of {package} has the name of one of "
                f"{found[item.name].package}, which is kept. Uninstall or rename one of them."
            )
            continue
        found[item.name] = Installed(item if package == OWN else guarded(item), package, version)


def _entry_points() -> list[EntryPoint]:
    """Those of the group, each once: this project's own first, then by package and name."""
    unique = {(_distribution(point)[0], point.name): point for point in entry_points(group=ENTRY_POINT_GROUP)}
    return [unique[key] for key in sorted(unique, key=lambda key: (key[0] != OWN, key))]


def _distribution(point: EntryPoint) -> tuple[str, str]:
    """Name and version of what brought the entry point."""
    return (point.module, "") if point.dist is None else _name_and_version(point.dist)


@lru_cache(maxsize=64)
def _name_and_version(distribution: Distribution) -> tuple[str, str]:
    """As the distribution's metadata say, which are read anew each time that they are asked for."""
    metadata = distribution.metadata
    return metadata["Name"], metadata["Version"]


def mechanisms(kind: str = "mechanism") -> tuple[Mechanism, ...]:
    """The installed mechanisms of one kind, with default options."""
    items = (entry.item for entry in installed().values())
    return tuple(item for item in items if isinstance(item, Mechanism) and item.kind == kind)


def record_effects() -> tuple[RecordEffect, ...]:
    """The installed instrument and environment effects."""
    return tuple(entry.item for entry in installed().values() if isinstance(entry.item, RecordEffect))


def find(name: str, options: Mapping[str, Any] | None = None) -> Mechanism:
    """The mechanism of that name, or of a mechanism file, with options set.

    Raises UsageError with the nearest names, or with what is wrong in the file.
    """
    if is_mechanism_file(name):
        return read_mechanism(name)
    items = {key: entry.item for key, entry in installed().items() if isinstance(entry.item, Mechanism)}
    if name not in items:
        raise _unknown(name, items)
    item = items[name]
    if not options:
        return item
    try:
        return answer(
            name, installed()[name].package, type(item).model_validate, {**item.model_dump(), **options}
        )
    except MechanismError as error:
        if isinstance(error.__cause__, ValidationError):
            raise UsageError(f"bad options for mechanism '{name}': {error.__cause__}") from None
        raise


def find_installed(name: str) -> Mechanism | RecordEffect:
    """The mechanism or record effect of that name, or of a mechanism file.

    Raises UsageError with the nearest names, or with what is wrong in the file.
    """
    if is_mechanism_file(name):
        return read_mechanism(name)
    if name not in installed():
        raise _unknown(name, installed())
    return installed()[name].item


def _unknown(name: str, known: Iterable[str]) -> UsageError:
    near = difflib.get_close_matches(name, list(known), n=3, cutoff=0.4)
    hint = f"did you mean {' or '.join(near)}?" if near else f"installed: {', '.join(known)}."
    reasons = "".join(f" {reason}" for reason in left_out() if f"'{name}'" in reason)
    return UsageError(
        f"unknown mechanism '{name}'; {hint} `brv-hypo mechanisms` lists what is installed.{reasons}"
    )


def parse_hypothesis(
    text: str, options: Mapping[str, Mapping[str, Any]] | None = None
) -> tuple[Mechanism, ...]:
    """The mechanisms of a hypothesis such as 'sticking+bodyfixed'; 'none' is the empty tuple."""
    if text == "none":
        return ()
    names = [part.strip() for part in text.split("+")]
    if len(set(names)) < len(names):
        raise UsageError(f"the hypothesis '{text}' names a mechanism twice; name each once")
    return tuple(find(name, (options or {}).get(name)) for name in names)
