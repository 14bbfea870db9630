"""Finds the installed plugins and looks their mechanisms up by name."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import pluggy
from pydantic import ValidationError

from brv_hypo.errors import UsageError
from brv_hypo.mechanisms import hookspecs
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect
from brv_hypo.mechanisms.filed import is_mechanism_file, read_mechanism


@dataclass(frozen=True)
class Installed:
    """A mechanism or record effect with the distribution that brought it."""

    item: Mechanism | RecordEffect
    package: str
    version: str


@lru_cache(maxsize=1)
def installed() -> Mapping[str, Installed]:
    """Every mechanism and record effect of every installed plugin, by name; loaded once."""
    manager = pluggy.PluginManager(hookspecs.PROJECT)
    manager.add_hookspecs(hookspecs)
    try:
        manager.load_setuptools_entrypoints(hookspecs.ENTRY_POINT_GROUP)
    except Exception as error:  # whatever foreign code raises when it is imported
        raise UsageError(
            f"an installed plugin of the group '{hookspecs.ENTRY_POINT_GROUP}' cannot be loaded: "
            f"{type(error).__name__}: {error}. Mend it or uninstall it."
        ) from error
    found: dict[str, Installed] = {}
    for plugin, distribution in manager.list_plugin_distinfo():
        metadata = distribution.metadata
        for hook in ("brv_hypo_mechanisms", "brv_hypo_record_effects"):
            for item in getattr(plugin, hook, list)():
                if item.name in found:
                    raise UsageError(
                        f"two installed plugins name the mechanism '{item.name}': {found[item.name].package} "
                        f"and {metadata['name']}. Uninstall one of them."
                    )
                found[item.name] = Installed(item, metadata["name"], metadata["version"])
    return dict(sorted(found.items()))


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
        return type(item).model_validate({**item.model_dump(), **options})
    except ValidationError as error:
        raise UsageError(f"bad options for mechanism '{name}': {error}") from None


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
    return UsageError(f"unknown mechanism '{name}'; {hint} `brv-hypo mechanisms` lists what is installed.")


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
