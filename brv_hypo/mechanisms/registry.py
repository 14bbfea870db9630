"""Finds mechanisms and record effects, by name.

A plugin is a module (entry point or .py file) with the hooks of contract.py, or one mechanism in a .yaml file.
Each is loaded and checked on its own: an installed one that breaks the contract is left out with a reason that names
its package, file and line, and changes nothing else; a requested file that breaks it is refused.

Nuisances (record effects, and mechanisms with a tolerance) and processes are in every hypothesis: those of this
distribution, and of others those that were requested, by their file (`use_plugin_files`) or by name (`requested`).
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import lru_cache, partial
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from brv_hypo.errors import BrvHypoError, MechanismError, UsageError
from brv_hypo.flight.record import Flight
from brv_hypo.io.files import check_regular
from brv_hypo.io.text import meant, one_line
from brv_hypo.mechanisms.checked import answer, checked, fault, is_checked, unchecked
from brv_hypo.mechanisms.contract import Mechanism, MomentProcess, Process, RecordEffect, RecordProcess
from brv_hypo.mechanisms.yaml_mechanism import is_mechanism_file, read_mechanism
from brv_hypo.motion.responses import Perturbation, superposed
from brv_hypo.settings import problems_of

ENTRY_POINT_GROUP = "brv_hypo.mechanisms"
OWN = "brv-hypo"  # this project's distribution: its plugins pass the conformance kit before every release
HOOKS = ("brv_hypo_mechanisms", "brv_hypo_record_effects")

Item = Mechanism | RecordEffect
Found = tuple[list[Item], list[str]]
_files: tuple[str, ...] = ()


def items_of(name: str, package: str, load: Callable[[], Any]) -> Found:
    """The items of the plugin that `load` imports, and what is wrong with others; MechanismError for the whole."""
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
    """The items of a .py file, or the mechanism of a .yaml file; UsageError where it is neither, MechanismError."""
    check_regular(path, "a plugin (.py) or a mechanism (.yaml)")
    file = Path(path)
    if is_mechanism_file(path):
        mechanism = read_mechanism(file)
        answer(mechanism.name, path, _check, mechanism, mechanism.name, path)
        return [mechanism], []
    if file.suffix != ".py":
        raise UsageError(f"{path}: found a file of type '{file.suffix}', expected .py or .yaml. Give a plugin.")
    module = f"brv_hypo_plugin_{file.stem}"

    def imported() -> Any:
        specification = importlib.util.spec_from_file_location(module, file)
        assert specification is not None
        assert specification.loader is not None
        loaded = sys.modules[module] = importlib.util.module_from_spec(specification)
        specification.loader.exec_module(loaded)
        return loaded

    return items_of(file.stem, path, imported)


def _check(item: Any, plugin: str, package: str) -> None:
    """Raise MechanismError unless a foreign item passes those checks of the kit that an analysis relies on."""
    if not isinstance(item, Mechanism | RecordEffect):
        raise fault(plugin, package, f"a hook gave {one_line(repr(item))}, expected a Mechanism or RecordEffect")
    if package == OWN:
        return
    from brv_hypo.mechanisms.conformance import Nonconformity, relied_on

    for check in relied_on(item):
        try:
            check(checked(item, package))
        except Nonconformity as broken:
            name = getattr(item, "name", plugin)
            raise fault(name, package, str(broken), unchecked(item).__class__) from None


@dataclass(frozen=True)
class Installed:
    """A mechanism or record effect with the distribution, or the file, that brought it."""

    item: Mechanism | RecordEffect
    package: str
    version: str


def use_plugin_files(paths: Sequence[str | Path]) -> None:
    """Load these .py and .yaml files in place of an earlier call's, which stay where one cannot be used (an error)."""
    global _files
    earlier, _files = _files, tuple(str(Path(path).absolute()) for path in paths)
    _loaded.cache_clear()
    try:
        if _files:
            _loaded()
    except BrvHypoError:
        _files = earlier
        raise


def plugin_files() -> tuple[str, ...]:
    """The files that `use_plugin_files` was given: another process has to load them too."""
    return _files


def installed() -> Mapping[str, Installed]:
    """Every mechanism and record effect of every plugin that keeps its contract, by name; loaded once."""
    return _loaded()[0]


def left_out() -> tuple[str, ...]:
    """Why plugins were left out when they were loaded, with package, file and line; empty before that."""
    return _loaded()[1] if _loaded.cache_info().currsize else ()


@lru_cache(maxsize=1)
def _loaded() -> tuple[Mapping[str, Installed], tuple[str, ...]]:
    """What was found, by name, and why some of it was left out."""
    # Each entry point once, of this project first, then by package and name.
    points: dict[tuple[bool, str, str], tuple[EntryPoint, str]] = {}
    for point in entry_points(group=ENTRY_POINT_GROUP):
        metadata = {"Name": point.module, "Version": ""} if point.dist is None else point.dist.metadata
        package = metadata["Name"]
        points[package != OWN, package, point.name] = point, metadata["Version"]
    found: dict[str, Installed] = {}
    left: list[str] = []
    for (_, package, name), (point, version) in sorted(points.items(), key=lambda each: each[0]):
        wrong = _add(found, package, version, partial(items_of, name, package, point.load))
        left += [f"a plugin is left out: {problem}" for problem in wrong]
    for path in _files:
        if wrong := _add(found, path, "", partial(load_file, path)):
            raise MechanismError(" ".join(wrong))
    return dict(sorted(found.items())), tuple(left)


def _add(found: dict[str, Installed], package: str, version: str, load: Callable[[], Found]) -> list[str]:
    """Add what `load` gives, and return what is wrong with it, which touches nothing else."""
    try:
        items, problems = load()
    except MechanismError as error:
        items, problems = [], [str(error)]
    for item in items:
        entry = Installed(item if package == OWN else checked(item, package), package, version)
        kept = found.setdefault(item.name, entry)
        if unchecked(kept.item) is not item:
            twice = f"'{item.name}' of {package} has the name of one of {kept.package}"
            then = (
                "name --plugin once, or rename one" if package in _files else "which is kept: uninstall or rename one"
            )
            problems.append(f"{twice}, {then} of them.")
    return problems


def mechanisms(kind: str = "mechanism") -> tuple[Mechanism, ...]:
    """The installed mechanisms of one kind, with default options."""
    items = (entry.item for entry in installed().values())
    return tuple(item for item in items if isinstance(item, Mechanism) and item.kind == kind)


def compared(names: Sequence[str]) -> list[str]:
    """The names, with `installed` replaced; where there are none, the mechanisms of this distribution and of files."""
    known = [item.name for item in mechanisms()]
    own = [name for name in known if installed()[name].package in (OWN, *_files)]
    return [each for name in names for each in (known if name == "installed" else [name])] or own


def record_effects() -> tuple[RecordEffect, ...]:
    """The installed instrument and environment effects but for processes."""
    items = (entry.item for entry in installed().values())
    return tuple(item for item in items if isinstance(item, RecordEffect) and not isinstance(item, Process))


def find(name: str, options: Mapping[str, Any] | None = None) -> Mechanism:
    """The mechanism of that name or file, with options; raises UsageError with the nearest names, or what is wrong."""
    item = _found(name, [key for key, entry in installed().items() if isinstance(entry.item, Mechanism)])
    assert isinstance(item, Mechanism)
    return item if not options or is_mechanism_file(name) else _with_options(item, options)


def _with_options(item: Any, options: Mapping[str, Any]) -> Any:
    """An installed item with options of its own; UsageError for what is wrong with them."""
    from brv_hypo.mechanisms.conformance import Nonconformity, has_sane_parameters

    package, plain, name = installed()[item.name].package, unchecked(item), item.name
    try:
        made = answer(name, package, plain.__class__.model_validate, {**plain.model_dump(), **options})
        if isinstance(made, Mechanism):
            has_sane_parameters(checked(made, package))
    except Nonconformity as wrong:
        raise UsageError(f"bad options for '{name}', {dict(options)}: {wrong}.") from None
    except MechanismError as error:
        if isinstance(error.__cause__, ValidationError):
            known = str(plain.__class__()) or "none"
            raise UsageError(f"bad options for '{name}': {problems_of(error.__cause__)}. It has: {known}.") from None
        raise
    return checked(made, package) if is_checked(item) else made


def find_installed(name: str) -> Mechanism | RecordEffect:
    """The mechanism or record effect of that name or file; raises UsageError as `find` does."""
    return _found(name, list(installed()))


def _found(name: str, known: Sequence[str]) -> Item:
    if is_mechanism_file(name):
        return read_mechanism(name)
    if name in known:
        return installed()[name].item
    if name.endswith(".py"):
        raise UsageError(f"'{name}' is a file of plugins: give it by --plugin, and its mechanisms by their names")
    causes = [each for each in known if not isinstance(installed()[each].item, Process)]
    hint = meant(name, causes, f"installed: {', '.join(causes)}.", cutoff=0.4, most=3)
    reasons = "".join(f" {reason}" for reason in left_out() if f"'{name}'" in reason)
    where = "`brv-hypo mechanisms` lists what is installed, --plugin FILE (Python: use_plugin_files) adds a file's"
    raise UsageError(f"unknown mechanism '{name}'; {hint} {where}.{reasons}")


def parse_hypothesis(text: str, options: Mapping[str, Mapping[str, Any]] | None = None) -> tuple[Mechanism, ...]:
    """The mechanisms of a hypothesis such as 'sticking+bodyfixed'; 'none' is the empty tuple."""
    if text == "none":
        return ()
    names = [part.strip() for part in text.split("+")]
    if len(set(names)) < len(names):
        raise UsageError(f"the hypothesis '{text}' names a mechanism twice; name each once")
    found = tuple(find(name, (options or {}).get(name)) for name in names)
    if any(isinstance(mechanism, MomentProcess) for mechanism in found):
        raise UsageError(f"'{text}' names a process, which every hypothesis has beside its mechanisms; leave it out")
    return found


# ---- Nuisances: what every hypothesis has, within its tolerance ----


Options = Mapping[str, Mapping[str, Any]]
_NONE: tuple[frozenset[str], frozenset[str], Options] = (frozenset(), frozenset(), {})
_requested = ContextVar("requested", default=_NONE)
"""Names that a comparison requests, those of plugins that broke their contract in it, and options by name."""


@contextmanager
def requested(names: Iterable[str], faulty: Iterable[str] = (), options: Options = _NONE[2]) -> Iterator[None]:
    """In the block nuisances have `options`; those of others are of `names` and files, without the `faulty`."""
    token = _requested.set((frozenset(names), frozenset(faulty), options))
    try:
        yield
    finally:
        _requested.reset(token)


def nuisance_effects() -> tuple[RecordEffect, ...]:
    """The record effects that are part of every hypothesis."""
    return tuple(item for item in nuisances() if isinstance(item, RecordEffect) and item.carried)


def nuisance_mechanisms(flight: Flight) -> tuple[Mechanism, ...]:
    """The mechanisms whose coefficients the record's tolerances of the vehicle bound."""
    return tuple(item for item in nuisances() if isinstance(item, Mechanism) and item.tolerance(flight) is not None)


def record_processes() -> tuple[RecordProcess, ...]:
    """The processes of instruments and air that are part of every hypothesis."""
    return tuple(item for item in nuisances() if isinstance(item, RecordProcess))


def processes_by_name() -> dict[str, Process]:
    """Every process, of record and moment."""
    every: tuple[Process, ...] = (*record_processes(), *moment_processes())
    return {each.name: each for each in every}


def stated_processes() -> frozenset[str]:
    """Names of the processes of the moment that a user states: those of other distributions and of files."""
    return frozenset(each.name for each in moment_processes() if installed()[each.name].package != OWN)


def moment_processes() -> tuple[MomentProcess, ...]:
    """The processes of the moment that are part of every hypothesis."""
    return tuple(item for item in nuisances() if isinstance(item, MomentProcess))


def nuisances() -> list[Item]:
    """All of which a tolerance may be known: of this distribution, or requested."""
    names, faulty, options = _requested.get()
    wanted = {name for name, entry in installed().items() if entry.package in (OWN, *_files)} | names
    items = [entry.item for name, entry in installed().items() if name in wanted - faulty]
    return [_with_options(item, options[item.name]) if item.name in options else item for item in items]


def perturbations(flight: Flight) -> tuple[Perturbation, ...]:
    """Every component of every nuisance effect, with the size that the tolerances of `flight` give it."""

    def applied(effect: RecordEffect, component: str, flight: Flight, value: float) -> Flight:
        return effect.perturb(flight, component, value)

    known = ((effect, component) for effect in nuisance_effects() for component in effect.components(flight))
    return tuple(Perturbation(effect.name, *each, partial(applied, effect, each.name)) for effect, each in known)


def without(flight: Flight, errors: Mapping[tuple[str, str], float]) -> Flight:
    """The record with what is known of nuisance effects' components (SI) taken out; other names are passed over."""
    known = ((effect, each.name) for effect in nuisance_effects() for each in effect.components(flight))
    held = [(effect, name, errors[effect.name, name]) for effect, name in known if (effect.name, name) in errors]
    return superposed(flight, (effect.perturb(flight, name, -value) for effect, name, value in held))
