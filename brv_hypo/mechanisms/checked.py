"""Calls of plugins with checked answers: each ends in its answer or in a MechanismError that names the plugin.

`answer` calls a plugin within a limit of time; `checked` makes a mechanism or record effect whose every answer
is checked; `without_faulty` repeats an analysis without the plugins that broke the contract, so that the results
of the others are those of a run in which these were never installed.
"""

from __future__ import annotations

import inspect
import signal
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from brv_hypo.errors import MechanismError
from brv_hypo.flight.record import CHANNELS, Flight
from brv_hypo.io.text import one_line
from brv_hypo.mechanisms.contract import Derived, Mechanism, Parameter, RecordEffect, Term
from brv_hypo.motion.motion import EarlierMotion, Motion

ANSWER_SECONDS = 30.0  # a plugin that has said nothing for so long will not

_ENGINE = Path(__file__).resolve().parents[1]
# By top-level module or file, the distribution that brought it; the registry fills it.
_packages: dict[str, str] = {}
_unchecked_classes: dict[type[Any], type[Any]] = {}
_checked_classes: dict[type[Any], type[Any]] = {}
_limited = False

Item = TypeVar("Item", bound=Mechanism | RecordEffect)
Data = TypeVar("Data")
Result = TypeVar("Result")


class _NoAnswerError(BaseException):
    """Time is up; no Exception, so that foreign code does not catch it in passing."""


def answer(name: str, package: str, call: Callable[..., Result], *arguments: Any) -> Result:
    """What foreign code answers to `call(*arguments)`, within ANSWER_SECONDS.

    Raises MechanismError that names the plugin's package, file and line, whatever it raises, sys.exit included.
    """
    try:
        with np.errstate(), _within(ANSWER_SECONDS):
            return call(*arguments)
    except MechanismError:
        raise
    except _NoAnswerError as error:
        raise fault(name, package, f"no answer in {ANSWER_SECONDS:g} s", call, error) from None
    except (Exception, SystemExit) as error:
        found = f"{type(error).__name__}: {one_line(str(error))}"
        raise fault(name, package, found, call, error) from error


def fault(
    name: str,
    package: str,
    found: str,
    call: Callable[..., Any] | None = None,
    error: BaseException | None = None,
) -> MechanismError:
    """The error to raise for a plugin: what was found, and where in its files that came from."""
    where = "" if call is None and error is None else _place(call, error)
    subject = f"'{name}' of {package}" if package else f"'{name}'"
    return MechanismError(
        f"{subject} breaks its contract{where}: {found}. Repair it or uninstall it; "
        f"`brv-hypo mechanisms check {name}` tests it.",
        name,
    )


def known_as(module: str, package: str) -> None:
    """Note which distribution a module comes from, for messages."""
    _packages[module.partition(".")[0]] = package


def package_of(item: Mechanism | RecordEffect) -> str:
    """The distribution that brought the item; its module where none is known."""
    module = type(item).__module__.partition(".")[0]
    return _packages.get(module, module)


def checked(item: Item) -> Item:
    """The same mechanism or record effect, every answer of which is checked; see `checked_terms`."""
    return item if is_checked(item) else _checked_class(type(item)).model_construct(**dict(item))


def is_checked(item: Mechanism | RecordEffect) -> bool:
    """Whether `checked` made it."""
    return type(item) in _unchecked_classes


def unchecked(item: Item) -> Item:
    """What `checked` was given."""
    return _unchecked_classes[type(item)].model_construct(**dict(item)) if is_checked(item) else item


def checked_terms(mechanism: Mechanism, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
    """The mechanism's terms at this motion, which it cannot change.

    Raises MechanismError where it raises, gives no answer, or anything but terms of finite columns on the
    motion's shape.
    """
    item = unchecked(mechanism)
    name, package = item.name, package_of(item)
    terms = answer(name, package, item.terms, read_only(motion), dict(theta))
    if not isinstance(terms, tuple | list) or not all(isinstance(term, Term) for term in terms):
        raise fault(
            name, package, f"`terms` gave {one_line(repr(terms))}, expected a tuple of Term", item.terms
        )
    names = [term.name for term in terms]
    if not names or len(set(names)) < len(names) or not all(isinstance(each, str) for each in names):
        raise fault(name, package, f"`terms` gave the names {names}, expected one for each term", item.terms)
    for term in terms:
        for side in ("in_plane", "out_of_plane"):
            problem = _column_problem(getattr(term, side), motion.time.shape)
            if problem:
                raise fault(name, package, f"term '{term.name}', {side}: {problem}", item.terms)
    return tuple(terms)


def checked_perturbation(effect: RecordEffect, flight: Flight, component: str, value: float) -> Flight:
    """The record as the effect changes it; the given record it cannot change.

    Raises MechanismError where it raises, gives no answer, or no record of as many finite samples.
    """
    item = unchecked(effect)
    name, package = item.name, package_of(item)
    changed = answer(name, package, item.perturb, read_only(flight), component, value)
    if not isinstance(changed, Flight):
        raise fault(
            name, package, f"`perturb` gave {type(changed).__name__}, expected a Flight", item.perturb
        )
    for channel in CHANNELS:
        problem = _column_problem(getattr(changed, channel), flight.time.shape)
        if problem:
            raise fault(name, package, f"`perturb`, channel {channel}: {problem}", item.perturb)
    return changed


def read_only(data: Data) -> Data:
    """The same motion or flight, through arrays that cannot be written to, its past included."""
    assert is_dataclass(data)
    if isinstance(data, EarlierMotion) or (isinstance(data, Motion) and isinstance(data.history, _ShownPast)):
        return data
    views: dict[str, Any] = {}
    for field in fields(data):
        value = getattr(data, field.name)
        if isinstance(value, np.ndarray):
            views[field.name] = value.view()
            views[field.name].flags.writeable = False
    if isinstance(data, Motion) and data.history is not None:
        views["history"] = _ShownPast(data.history)
    return replace(data, **views)  # type: ignore[type-var]


@dataclass(frozen=True)
class _ShownPast:
    """The past of a motion that cannot be written to."""

    past: Callable[[float], Motion]

    def __call__(self, tau: float) -> Motion:
        return read_only(self.past(tau))


def without_faulty(
    analysis: Callable[[frozenset[str]], Result], *, most: int = 20
) -> tuple[Result, tuple[str, ...]]:
    """What `analysis` gives for the names to leave out, and why each was: those that broke their contract in it.

    Every repetition begins anew, so that nothing of what failed is in the result. Raises MechanismError where the
    plugin at fault is not known, or is still called after it was to be left out.
    """
    left_out: dict[str, str] = {}
    while True:
        try:
            return analysis(frozenset(left_out)), tuple(left_out.values())
        except MechanismError as error:
            if not error.mechanism or error.mechanism in left_out or len(left_out) >= most:
                raise
            left_out[error.mechanism] = f"{error.mechanism} is left out: {error}"


def _column_problem(column: Any, shape: tuple[int, ...]) -> str:
    """What is wrong with a column; empty where nothing is."""
    try:
        values = np.asarray(column)
    except (TypeError, ValueError):
        return "no array"
    if values.dtype.kind not in "fiub":
        return f"values of type {values.dtype}, expected real numbers"
    if values.shape != shape:
        return f"got shape {values.shape}, expected {shape}"
    bad = int(np.count_nonzero(~np.isfinite(values)))
    if bad:
        return (
            f"got {bad} values that are not finite, expected none; it may need a channel that this record lacks "
            "(Mach or Reynolds number)"
        )
    return ""


def _checked_class(kind: type[Any]) -> type[Any]:
    """A subclass whose answers are checked; one for each class."""
    if kind in _checked_classes:
        return _checked_classes[kind]
    own: dict[str, Any] = {"__module__": kind.__module__, "__doc__": kind.__doc__}
    for name, check in (_OF_A_MECHANISM if issubclass(kind, Mechanism) else _OF_AN_EFFECT).items():
        own[name] = _method(name, check, getattr(kind, name).__doc__)
    own["__reduce__"] = lambda self: (checked, (unchecked(self),))
    made = type(kind.__name__, (kind,), own)
    _unchecked_classes[made], _checked_classes[kind] = kind, made
    return made


def _method(name: str, check: Callable[..., str], doc: str | None) -> Callable[..., Any]:
    def call(self: Any, *arguments: Any) -> Any:
        if name == "terms":
            return checked_terms(self, *arguments)
        if name == "perturb":
            return checked_perturbation(self, *arguments)
        item = unchecked(self)
        given = answer(item.name, package_of(item), getattr(item, name), *arguments)
        problem = check(given)
        if problem:
            found = f"`{name}` gave {one_line(repr(given))}, expected {problem}"
            raise fault(item.name, package_of(item), found, getattr(item, name))
        return tuple(checked(one) for one in given) if name == "variants" else given

    call.__name__, call.__doc__ = name, doc
    return call


def _each(kind: type[Any] | tuple[type[Any], ...], what: str) -> Callable[[Any], str]:
    def check(given: Any) -> str:
        sound = isinstance(given, tuple | list) and all(isinstance(one, kind) for one in given)
        return "" if sound else f"a tuple of {what}"

    return check


def _number(given: Any) -> str:
    return "" if isinstance(given, float | int | np.floating) else "a number"


def _knots(given: Any) -> str:
    sound = given is None or not _column_problem(given, np.shape(given))
    return "" if sound else "finite times, or None"


def _checked_elsewhere(given: Any) -> str:
    return ""


_OF_A_MECHANISM: dict[str, Callable[[Any], str]] = {
    "parameters": _each(Parameter, "Parameter"),
    "terms": _checked_elsewhere,
    "knots": _knots,
    "derived": _each(Derived, "Derived"),
    "log_likelihood": _number,
}
_OF_AN_EFFECT: dict[str, Callable[[Any], str]] = {
    "variants": _each(RecordEffect, "RecordEffect"),
    "components": _each((tuple, list), "(name, units, size)"),
    "perturb": _checked_elsewhere,
}


@contextmanager
def _within(seconds: float) -> Iterator[None]:
    """Raise _NoAnswerError in the block after `seconds`; the outermost block's limit is the one that counts.

    Only the main thread can be interrupted, and only where the system has timers.
    """
    global _limited
    main = threading.current_thread() is threading.main_thread()
    if _limited or not main or not hasattr(signal, "setitimer"):
        yield
        return

    def stop(number: int, frame: Any) -> None:
        raise _NoAnswerError

    before = signal.signal(signal.SIGALRM, stop)
    _limited = True
    # Repeated, for code that catches everything and goes on.
    signal.setitimer(signal.ITIMER_REAL, seconds, 1.0)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
        _limited = False


def _place(call: Callable[..., Any] | None, error: BaseException | None) -> str:
    """Where in the plugin's own files: the last line of the traceback there, else the definition of `call`."""
    if isinstance(error, SyntaxError) and error.filename:
        return f" ({error.filename}, line {error.lineno})"
    frames = traceback.extract_tb(error.__traceback__) if error is not None else ()
    own = [frame for frame in frames if _is_plugins(frame.filename)]
    home = _source(call)
    mine = [frame for frame in own if home is not None and frame.filename == home[0]] or own
    if mine:
        return f" ({mine[-1].filename}, line {mine[-1].lineno})"
    return "" if home is None else f" ({home[0]}, line {home[1]})"


def _is_plugins(filename: str) -> bool:
    """Whether a line of a traceback is the plugin's own: neither the engine's nor the import machinery's."""
    return (
        not filename.startswith("<") and _ENGINE not in Path(filename).parents and "importlib" not in filename
    )


def _source(call: Callable[..., Any] | None) -> tuple[str, int] | None:
    """File and line of the definition of a plugin's function or class."""
    if isinstance(call, type):
        try:
            file, line = inspect.getsourcefile(call), inspect.getsourcelines(call)[1]
        except (OSError, TypeError):  # a class that no file defines
            return None
        return (file, line) if file is not None and _is_plugins(file) else None
    code = getattr(inspect.unwrap(call), "__code__", None) if call is not None else None
    return (
        None if code is None or not _is_plugins(code.co_filename) else (code.co_filename, code.co_firstlineno)
    )
