"""Calls of plugins with checked answers: each ends in its answer or in a MechanismError that names the plugin.

Entrances: `answer`, `checked`, and `without_faulty`, in whose results no plugin that broke the contract has a part.
"""

from __future__ import annotations

import inspect
import os
import signal
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any, NoReturn, TypeVar, cast

import numpy as np

from brv_hypo.errors import MechanismError
from brv_hypo.flight.record import CHANNELS, Flight
from brv_hypo.io.text import one_line
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect, Term
from brv_hypo.motion.motion import Motion

ANSWER_SECONDS = 30.0  # a plugin that has said nothing for so long will not
_ENGINE = Path(__file__).resolve().parents[1]

_ALONE = "Each sample is evaluated alone: use no cumulative sum, gradient or mean; the past is `motion.delayed(tau)`."

Item = TypeVar("Item", bound=Mechanism | RecordEffect)
Data = TypeVar("Data", bound=Motion | Flight)
Result = TypeVar("Result")


class _NoAnswerError(BaseException):
    """Time is up; no Exception, so that foreign code does not catch it in passing."""


def answer(
    name: str,
    package: str,
    call: Callable[..., Result],
    *arguments: Any,
    problem: Callable[[Result], str] = lambda given: "",
) -> Result:
    """What foreign code answers to `call(*arguments)` within ANSWER_SECONDS; `problem` says what is wrong with it.
    Raises MechanismError with the plugin's package, file and line, whatever it raises, sys.exit and os._exit included.
    """
    try:
        with np.errstate(), _within(ANSWER_SECONDS), _exit_refused():
            given = call(*arguments)
            found = problem(given)
    except MechanismError:
        raise
    except _NoAnswerError as error:
        raise fault(name, package, f"no answer in {ANSWER_SECONDS:g} s", call, error) from None
    except (Exception, SystemExit) as error:
        raise fault(name, package, f"{type(error).__name__}: {one_line(str(error))}", call, error) from error
    if found:
        raise fault(name, package, found, call)
    return given


@contextmanager
def _within(seconds: float) -> Iterator[None]:
    """Raise _NoAnswerError in the block after `seconds`, the outermost's; only in a main thread with timers."""
    main = threading.current_thread() is threading.main_thread() and hasattr(signal, "setitimer")
    if not main or signal.getitimer(signal.ITIMER_REAL)[0] > 0.0:
        yield
        return

    def stop(number: int, frame: Any) -> None:
        raise _NoAnswerError

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds, 1.0)  # repeated, for code that catches everything and goes on
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@contextmanager
def _exit_refused() -> Iterator[None]:
    """In the block `os._exit`, which would end the process without a word, raises SystemExit in this thread."""
    real, thread, process = os._exit, threading.get_ident(), os.getpid()

    def refuse(status: int) -> NoReturn:
        if (threading.get_ident(), os.getpid()) == (thread, process):
            raise SystemExit(f"os._exit({status})")
        real(status)

    os._exit = refuse
    try:
        yield
    finally:
        os._exit = real


def fault(
    name: str, package: str, found: str, call: Callable[..., Any] | None = None, error: BaseException | None = None
) -> MechanismError:
    """The error to raise for a plugin: what was found, and where in its files that came from."""
    subject = f"'{name}' of {package}" if package else f"'{name}'"
    remedy = f"Repair it or uninstall it; `brv-hypo mechanisms check {name}` tests it."
    if Path(package).suffix == ".py":
        remedy = f"Repair it, or leave out --plugin {package}."
    return MechanismError(
        f"{subject} breaks its contract{_place(call, error)}: {found.removesuffix('.')}. {remedy}", name
    )


def _place(call: Callable[..., Any] | None, error: BaseException | None) -> str:
    """Where in the plugin's own files: the last line of the traceback there, else the definition of `call`."""
    if isinstance(error, SyntaxError) and error.filename:
        return f" ({error.filename}, line {error.lineno})"
    try:
        home = [] if call is None else [(inspect.getsourcefile(call) or "", inspect.getsourcelines(call)[1])]
    except (OSError, TypeError):  # what no file defines
        home = []
    frames = traceback.extract_tb(error.__traceback__) if error is not None else ()
    # Neither the engine's lines nor those of the import machinery.
    places = [
        (file, line)
        for file, line in (*home, *((frame.filename, frame.lineno) for frame in frames))
        if not file.startswith("<") and _ENGINE not in Path(file).parents and "importlib" not in file
    ]
    at_home = [place for place in places if home and place[0] == home[0][0]]
    return "".join(f" ({file}, line {line})" for file, line in (at_home or places)[-1:])


# ---- A mechanism or record effect whose answers are checked ----


_METHODS = {
    *("parameters", "terms", "knots", "derived", "tolerance", "of_each_flight"),
    *("variants", "components", "perturb", "shapes"),
}


class Checked:
    """Wraps an item of a package, or plugin's file, an instance of its class, each of whose answers is checked."""

    def __init__(self, item: Any, package: str) -> None:
        self.item, self.package = item, package

    @property  # type: ignore[misc]
    def __class__(self) -> type[Any]:
        """For isinstance: the item's."""
        return type(self.item)

    def __getattr__(self, name: str) -> Any:
        if name in ("item", "__copy__", "__deepcopy__"):
            raise AttributeError(name)
        return partial(_answer_of, self, name) if name in _METHODS else getattr(self.item, name)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Checked) and vars(self) == vars(other)

    def __hash__(self) -> int:
        return hash(self.item)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(vars(self).values())

    def model_copy(self, **changes: Any) -> Any:
        """A copy of the item, its answers checked too."""
        return checked(self.item.model_copy(**changes), self.package)


def checked(item: Item, package: str = "") -> Item:
    """The same mechanism or record effect, which cannot change what it is given, and whose every answer is checked. A
    method raises MechanismError where it raises, gives no answer, or anything but what the contract says, such as terms
    of finite columns on the motion's shape. It names the `package`, or the class's module where none is given.
    """
    module = type(item).__module__.partition(".")[0]
    return item if is_checked(item) else cast(Item, Checked(item, package or module))


def is_checked(item: Mechanism | RecordEffect) -> bool:
    """Whether `checked` made it."""
    return issubclass(type(item), Checked)


def unchecked(item: Item) -> Item:
    """What `checked` was given."""
    return cast(Item, vars(item)["item"]) if is_checked(item) else item


def _answer_of(self: Checked, method: str, *arguments: Any) -> Any:
    """What a method answers, found sound, to arguments that it cannot change; raises MechanismError otherwise."""
    shown = [
        read_only(each) if isinstance(each, Motion | Flight) else dict(each) if isinstance(each, Mapping) else each
        for each in arguments
    ]
    problem = partial(_problem, method, arguments[0].time.shape if method in ("terms", "perturb", "shapes") else ())
    try:
        given = answer(self.item.name, self.package, getattr(self.item, method), *shown, problem=problem)
    except MechanismError as error:
        if method not in ("terms", "shapes") or (arguments[0].time.ndim == 1 and arguments[0].time.size > 1):
            raise
        raise MechanismError(f"{error} {_ALONE}", error.mechanism) from error
    return tuple(checked(each, self.package) for each in given) if method == "variants" else given


def _problem(method: str, shape: tuple[int, ...], given: Any) -> str:
    """What is wrong with the answer of a method on motion or record of this shape; empty where nothing is."""
    columns: dict[str, Any] = {}
    if method == "terms":
        if not isinstance(given, tuple | list) or not all(isinstance(term, Term) for term in given):
            return f"`terms` gave {one_line(repr(given))}, expected a tuple of Term"
        names = [term.name for term in given]
        if not names or not all(isinstance(name, str) for name in names) or len(set(names)) < len(names):
            return f"`terms` gave the names {names}, expected one for each term"
        columns = {f"{side} of '{t.name}'": getattr(t, side) for t in given for side in ("in_plane", "out_of_plane")}
    elif method == "perturb":
        if not isinstance(given, Flight):
            return f"`perturb` gave {type(given).__name__}, expected a Flight"
        columns = {name: getattr(given, name) for name in CHANNELS}
    elif method == "shapes":
        if not isinstance(given, tuple | list):
            return f"`shapes` gave {type(given).__name__}, expected a tuple of arrays, one for each shape"
        sides = (("C_m,in", np.real), ("C_n,side", np.imag))
        columns = {f"{side} of `shapes(...)[{k}]`": part(each) for k, each in enumerate(given) for side, part in sides}
    elif method == "components":
        columns, shape = {"sizes": [size for _, _, size in given]}, (len(given),)
    elif method in ("knots", "tolerance") and given is not None:
        columns, shape = {"numbers": given}, (len(given),)
    for name, values in ((name, np.asarray(column)) for name, column in columns.items()):
        if values.dtype.kind not in "fiub":
            return f"`{method}` gave {name} of type {values.dtype}, expected real numbers"
        if values.shape != shape:
            return f"`{method}` gave {name} of shape {values.shape}, expected {shape}"
        if bad := int(np.count_nonzero(~np.isfinite(values))):
            needs = "it may need a channel that this record lacks (Mach or Reynolds number)"
            return f"`{method}` gave {name} with {bad} values that are not finite, expected none; {needs}"
    return ""


def read_only(data: Data) -> Data:
    """The same motion or flight, through arrays that cannot be written to, its past included."""
    held = {each.name: getattr(data, each.name) for each in fields(data)}
    views: dict[str, Any] = {name: each.view() for name, each in held.items() if isinstance(each, np.ndarray)}
    for view in views.values():
        view.flags.writeable = False
    if isinstance(data, Motion) and data.history is not None and not isinstance(data.history, partial):
        views["history"] = partial(_past, data.history)
    return replace(data, **views)


def _past(past: Callable[[float], Motion], tau: float) -> Motion:
    return read_only(past(tau))


def without_faulty(analysis: Callable[[frozenset[str]], Result], *, most: int = 20) -> tuple[Result, tuple[str, ...]]:
    """What `analysis` gives for the names to leave out, and why each was: those that broke their contract in it. Every
    repetition begins anew, so that nothing of what failed is in the result. Raises MechanismError where the plugin at
    fault is not known, or is still called after it was to be left out.
    """
    left_out: dict[str, str] = {}
    while True:
        try:
            return analysis(frozenset(left_out)), tuple(left_out.values())
        except MechanismError as error:
            if not error.mechanism or error.mechanism in left_out or len(left_out) >= most:
                raise
            left_out[error.mechanism] = f"{error.mechanism} is left out: {error}"
