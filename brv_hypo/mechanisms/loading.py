"""From one plugin, a module or a file, to the mechanisms and record effects that keep their contract."""

from __future__ import annotations

import importlib.util
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from brv_hypo.errors import MechanismError, UsageError
from brv_hypo.files.printed import one_line
from brv_hypo.files.regular import check_regular
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect
from brv_hypo.mechanisms.filed import is_mechanism_file, read_mechanism
from brv_hypo.mechanisms.isolation import answer, fault, guarded, known_as, plain

OWN = "brv-hypo"  # this project's distribution: its plugins pass the conformance kit before every release
HOOKS = ("brv_hypo_mechanisms", "brv_hypo_record_effects")

_NAME = re.compile(r"[a-z][a-z0-9_]*")
_KINDS: dict[type[Any], tuple[str, ...]] = {
    Mechanism: ("mechanism", "aerodynamic"),
    RecordEffect: ("instrument", "environment"),
}

Item = Mechanism | RecordEffect
Found = tuple[list[Item], list[str]]


def items_of(name: str, package: str, load: Callable[[], Any]) -> Found:
    """The items of the plugin that `load` imports, and what is wrong with those that break their contract.

    Raises MechanismError where the plugin as a whole cannot be used.
    """
    plugin = answer(name, package, load)
    hooks = [hook for hook in HOOKS if callable(getattr(plugin, hook, None))]
    if not hooks:
        raise fault(name, package, f"{one_line(repr(plugin))} has neither {' nor '.join(HOOKS)}")
    items: list[Item] = []
    problems: list[str] = []
    for hook in hooks:
        call = getattr(plugin, hook)
        given = answer(name, package, call)
        if not isinstance(given, list | tuple):
            raise fault(name, package, f"`{hook}` gave {one_line(repr(given))}, expected a list", call)
        for item in given:
            try:
                answer(name, package, _check, item, name, package)
                items.append(item)
            except MechanismError as error:
                problems.append(str(error))
    return items, problems


def load_file(path: str) -> Found:
    """The items of one .py file, or the mechanism of one .yaml file.

    Raises UsageError where the file is neither or a .yaml file is wrong, MechanismError where the code is.
    """
    check_regular(path, "a plugin (.py) or a mechanism (.yaml)")
    file = Path(path)
    if is_mechanism_file(path):
        mechanism = read_mechanism(file)
        answer(mechanism.name, path, _check, mechanism, mechanism.name, path)
        return [mechanism], []
    if file.suffix != ".py":
        raise UsageError(
            f"{path}: found a file of type '{file.suffix}', expected .py or .yaml. Give a plugin."
        )
    module = f"brv_hypo_plugin_{file.stem}"
    known_as(module, path)
    return items_of(file.stem, path, lambda: _imported(module, file))


def _imported(module: str, file: Path) -> Any:
    specification = importlib.util.spec_from_file_location(module, file)
    assert specification is not None
    assert specification.loader is not None
    loaded = importlib.util.module_from_spec(specification)
    sys.modules[module] = loaded
    specification.loader.exec_module(loaded)
    return loaded


def _check(item: Any, plugin: str, package: str) -> None:
    """Raise MechanismError unless the item is declared as the contract asks and, if foreign, answers as it should."""
    kind = next((kind for kind in _KINDS if isinstance(item, kind)), None)
    if kind is None:
        raise fault(
            plugin, package, f"a hook gave {one_line(repr(item))}, expected a Mechanism or RecordEffect"
        )
    name = getattr(item, "name", None)
    if not isinstance(name, str) or not _NAME.fullmatch(name) or name == "none":
        raise fault(
            plugin,
            package,
            f"the name {name!r}, expected lower case letters, digits and _, not 'none'",
            type(item),
        )
    for attribute in ("title", "claims", "source"):
        if not isinstance(getattr(item, attribute, None), str):
            raise fault(name, package, f"`{attribute}` is not text", type(item))
    if getattr(item, "kind", None) not in _KINDS[kind]:
        raise fault(
            name,
            package,
            f"`kind` is {getattr(item, 'kind', None)!r}, expected one of {_KINDS[kind]}",
            type(item),
        )
    if package != OWN:
        _check_answers(guarded(item), name, package)


def _check_answers(item: Item, name: str, package: str) -> None:
    """Raise MechanismError unless the item passes those checks of the conformance kit that an analysis relies on."""
    from brv_hypo.mechanisms.conformance import Nonconformity, relied_on

    for check in relied_on(item):
        try:
            check()
        except Nonconformity as broken:
            raise fault(name, package, str(broken), type(plain(item))) from None
