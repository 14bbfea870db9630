"""What a command does with its result (terminal, JSON, report, files), and how it ends.

Outputs are claimed before any work starts, so that a long run never ends in a refusal, and are written whole
or not at all. With `--json -` standard output holds JSON and nothing else.

A refusal, a fault of the program, SIGINT or SIGTERM becomes one message and the contract's exit code (`guarded`). After
a signal the command unwinds and its workers end; if it does not within the grace period, the process ends all the
same. `listen` handles the signals, `ready` makes the streams fit for any text, `in_session` makes a function a command.
Typer evaluates options at start-up, so this module imports nothing heavy.
"""

from __future__ import annotations

import codecs
import errno
import functools
import inspect
import io
import json as json_format
import os
import shlex
import signal
import sys
import threading
import time
import traceback
import unicodedata
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, redirect_stdout
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any, ParamSpec, TextIO, get_type_hints

import typer
from typer import Argument, Option

from brv_hypo.errors import BrvHypoError, UsageError
from brv_hypo.io.files import check_hdf5, check_place, check_target, remove_open_temporaries, write_whole
from brv_hypo.io.text import printable
from brv_hypo.progress import Report, report_to, silent

if TYPE_CHECKING:
    from pydantic import BaseModel

    from brv_hypo.flight import Flight
    from brv_hypo.report.document import Document

PLAIN = str.maketrans("–—−─━⁻│┃×·•≤≥…‘’“”", "------||x.*<>.''\"\"") | dict.fromkeys(range(0x250C, 0x2574), "+")
"""Characters that some encodings lack, as ASCII has them; of others, what is left without accents."""
_closed: set[str] = set()  # streams that the shell had closed
GRACE_SECONDS = 1.5  # to unwind in; workers and process are to be gone 2 s after the signal
ENDS = {signal.SIGINT: (130, "interrupted"), signal.SIGTERM: (143, "terminated")}
LINE = "brv-hypo: {}; no half-written output is left"
_unwinds = False
_signal: int | None = None  # that arrived
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO)
LINE_SECONDS = 2.0  # between lines where standard error is no terminal, at least; work of hours has fewer
STAGE_SECONDS = 10.0  # between lines of one stage
LONG_SECONDS = 20.0  # what takes longer says so beforehand
_TOLERANCES = (
    "Tolerances of instruments, vehicle and air in place of the record's: laboratory, tactical, industrial, a YAML "
    "file, or opportunity (`brv-hypo config new opportunity` writes it)."
)


def ready() -> None:
    """Make the standard streams fit for any text: to be called once, before anything is printed or opened."""
    codecs.register_error("brv_hypo.plain", _plain)
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:  # closed: the next file that is opened would get its number, and what is printed
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number, which is this one
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, os.fdopen(number, "r" if name == "stdin" else "w", encoding="utf-8", closefd=False))
            _closed.add(name)
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="brv_hypo.plain")


def _plain(error: UnicodeError) -> tuple[str, int]:
    """What is written in place of characters that the encoding lacks; a raised one has a ^ before it."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    written, raised = "", False
    for each in error.object[error.start : error.end]:
        before, raised = raised, unicodedata.decomposition(each).startswith("<super>")
        written += "^" if raised and not before else ""
        written += unicodedata.normalize("NFKD", each.translate(PLAIN)).encode("ascii", "ignore").decode() or "?"
    return written, error.end


class Signalled(KeyboardInterrupt):
    """A signal, as what unwinds the command. Not KeyboardInterrupt itself: one that passes through `exec` of a text, by
    which a dataclass is made for instance, makes the process die of SIGINT whatever its code.
    """


def listen() -> None:
    """Handle both signals from now on."""
    for number in ENDS:
        signal.signal(number, _handle)


@contextmanager
def unwinding() -> Iterator[None]:
    """In this block a signal is an exception, for everything to be cleaned up; outside it ends the process."""
    global _unwinds
    _unwinds = True
    try:
        yield
    finally:
        _unwinds = False


def end_workers() -> None:
    """End the processes that work for this one, without waiting for what they do."""
    executor = getattr(sys.modules.get("joblib.externals.loky.reusable_executor"), "_executor", None)
    if executor is None:
        return
    for worker in list((executor._processes or {}).values()):
        if worker.pid is not None and worker.is_alive():
            os.kill(worker.pid, signal.SIGKILL)  # loky's workers have no kill() of their own


def _handle(number: int, frame: FrameType | None) -> None:
    global _signal
    _signal = number
    for each in ENDS:  # one is enough: a second must not disturb the unwinding of the first
        signal.signal(each, signal.SIG_IGN)
    code, word = ENDS[signal.Signals(number)]
    if not _unwinds:
        _leave(code, word)
    clock = threading.Timer(GRACE_SECONDS, _leave, [code, word])
    clock.daemon = True
    clock.start()
    raise Signalled


def _leave(code: int, word: str) -> None:
    """End now: workers, temporaries, a line, the process."""
    end_workers()
    remove_open_temporaries()
    os.write(2, (LINE.format(word) + "\n").encode())
    os._exit(code)


P = ParamSpec("P")


def guarded(command: Callable[P, None]) -> Callable[P, None]:
    """The command, with refusals and faults as messages on standard error and exit codes; typer ends wrong options."""

    @functools.wraps(command)
    def run(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            with unwinding(), warnings.catch_warnings():
                if not kwargs.get("verbose"):  # what a user can act on is in the result's own warnings
                    warnings.simplefilter("ignore")
                command(*args, **kwargs)
                sys.stdout.flush()
        except (typer.Exit, BrokenPipeError):
            raise
        except BrvHypoError as refusal:
            _end(f"brv-hypo: {refusal}", refusal.exit_code)
        except (KeyboardInterrupt, Exception) as fault:
            # a library that was just starting may make the signal another error
            if isinstance(fault, KeyboardInterrupt) or _signal is not None:
                end_workers()
                code, word = ENDS[signal.Signals(_signal or signal.SIGINT)]
                _end(f"{LINE.format(word)}{fault if isinstance(fault, KeyboardInterrupt) else ''}", code)
            if isinstance(fault, OSError) and fault.errno in FULL:
                # let the interpreter end without another attempt to write what cannot be written
                os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
                reason = f"brv-hypo: an output cannot be written: {fault.strerror}. Choose another."
                _end(reason, UsageError.exit_code)
            if kwargs.get("verbose"):
                traceback.print_exc()
            where = "above" if kwargs.get("verbose") else "that -v prints"
            message = f"{type(fault).__name__}: {fault}. Please report it, with the traceback {where}."
            _end(f"brv-hypo: a fault of the program: {message}", BrvHypoError.exit_code)

    return run


def _end(message: str, code: int) -> None:
    typer.echo(printable(message), err=True)
    raise typer.Exit(code) from None


@contextmanager
def shown(title: str, *, quiet: bool) -> Iterator[Report]:
    """What to call with a fraction and a text: it moves a bar on a terminal, and elsewhere now and then adds a line."""
    if quiet:
        yield silent
    elif sys.stderr.isatty():
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

        words = TextColumn("{task.description}", markup=False)
        columns = (BarColumn(bar_width=24), TaskProgressColumn(), TimeElapsedColumn(), words)
        with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
            bar.add_task(title, total=None)
            yield report_to(bar)
    else:
        reached, finished = [title], threading.Event()
        writer = threading.Thread(target=_write_lines, args=(reached, finished), daemon=True)  # a stage takes minutes
        writer.start()
        try:
            yield lambda fraction, text: reached.append(text if fraction is None else f"{text}, {fraction:.0%} done")
        finally:
            finished.set()
            writer.join()


def _write_lines(reached: list[str], finished: threading.Event) -> None:
    """Write the last of what was reached, where it is new; of one stage now and then."""
    begun, written, at = time.monotonic(), "", 0.0
    while not finished.wait(max(LINE_SECONDS, (time.monotonic() - begun) / 30.0)):
        last, now = reached[-1], time.monotonic()
        if last != written and (last.split(",")[0] != written.split(",")[0] or now - at > STAGE_SECONDS):
            written, at = last, now
            print(f"{now - begun:.0f} s: {printable(written)}", file=sys.stderr, flush=True)


# ---- Arguments and options that commands share, and what a shell completes; those of one command are beside it ----


def _completion(module: str, names: str, *arguments: str) -> Callable[[str], list[str]]:
    """What a shell offers of the names in a module, or by a function of it: those that begin as what is typed."""

    def beginning(incomplete: str) -> list[str]:
        known = getattr(import_module(f"brv_hypo.{module}"), names)
        return [name for name in (known(*arguments) if callable(known) else known) if name.startswith(incomplete)]

    return beginning


complete_topics = _completion("docs", "topics")
complete_configs = _completion("io.files", "config_names")  # and files, where none begins so
complete_studies = _completion("io.files", "config_names", "studies")
complete_grades = _completion("flight.tolerances", "GRADES")
complete_installed = _completion("mechanisms.registry", "installed")


FlightFile = Annotated[Path, Argument(metavar="FLIGHT.h5", help="Flight record, format 1.")]
FlightFiles = Annotated[list[Path], Argument(metavar="FLIGHT.h5", help="Flight records; several are fitted jointly.")]
Output = Annotated[Path, Option("-o", "--output", metavar="FILE", help="File to write.")]
Seed = Annotated[int | None, Option("--seed", metavar="N", min=0, help="Seed of all random draws (simulate, demo: 1).")]


@dataclass(frozen=True)
class Session:
    """How one command prints: what the common options request."""

    config: Annotated[Path | None, Option("--config", metavar="FILE.yaml", help="Settings, over the defaults.")] = None
    start: Annotated[float | None, Option("--start", metavar="T", help="Use the record from T (s).")] = None
    stop: Annotated[float | None, Option("--stop", metavar="T", help="Use the record up to T (s).")] = None
    instruments: Annotated[
        str | None, Option("--instruments", metavar="GRADE|FILE", autocompletion=complete_grades, help=_TOLERANCES)
    ] = None
    json: Annotated[
        str | None, Option("--json", metavar="FILE|-", help="Write the result as JSON; - is standard output.")
    ] = None
    report: Annotated[
        Path | None, Option("--report", metavar="FILE.html", help="Write a report that any browser opens offline.")
    ] = None
    figures: Annotated[
        Path | None, Option("--figures", metavar="DIR", help="Write every figure as PNG and SVG; needs matplotlib.")
    ] = None
    quiet: Annotated[bool, Option("-q", "--quiet", help="Print the outcome alone, in one line.")] = False
    verbose: Annotated[bool, Option("-v", "--verbose", help="Print every detail; tracebacks too.")] = False
    force: Annotated[bool, Option("--force", help="Overwrite output files that exist.")] = False
    plugin: Annotated[
        list[Path] | None,
        Option("--plugin", metavar="FILE", help="Use mechanisms of this .py or .yaml file; repeatable."),
    ] = None
    stdout: TextIO = field(default_factory=lambda: sys.stdout)

    @property
    def json_only(self) -> bool:
        """True where standard output belongs to JSON."""
        return self.json == "-"

    def load(self, path: Path) -> Flight:
        """The part to use of a record, with the tolerances to use: a grade, a file, or one that comes along by name."""
        from brv_hypo.flight.format import load_flight

        return load_flight(path, instruments=self.instruments).window(self.start, self.stop)

    def claim(self, *files: Path | None, hdf5: bool = False) -> None:
        """Refuse now, by UsageError, outputs that exist without `--force`, or whose place cannot be written to: `files`
        (of `hdf5` by their names too), the report, the JSON file and picture files.
        """
        if self.json_only and "stdout" in _closed:
            raise UsageError("--json - writes to standard output, which is closed (>&-). Open it, or name a file.")
        json_file = None if self.json is None or self.json_only else Path(self.json)
        wanted = [file for file in (*files, self.report, json_file) if file is not None]
        resolved = [file.resolve() for file in wanted]
        for file in wanted:
            if resolved.count(file.resolve()) > 1:
                raise UsageError(f"{file} was given for two outputs. Give each output a file of its own.")
            check_target(file, overwrite=self.force)
            if hdf5 and file in files:
                check_hdf5(file)
            check_place(file, Path(os.path.realpath(file)).parent)
        if (folder := self.figures) is not None:
            from brv_hypo.report.write import require_matplotlib

            require_matplotlib()
            check_place(folder, next(each for each in (folder.absolute(), *folder.absolute().parents) if each.exists()))
            for picture in sorted((*folder.glob("*.png"), *folder.glob("*.svg"))):
                check_target(picture, overwrite=self.force)

    def show(self, *parts: Any, conclusion: str = "") -> None:
        """Print documents, blocks, or what rich renders; with -q the conclusion; nothing where JSON has the output."""
        if self.json_only or (self.quiet and not conclusion):
            return
        from brv_hypo.report.document import Document, Table, Texts
        from brv_hypo.report.terminal import PlainConsole, blocks_view, terminal_view

        console = PlainConsole()
        for part in (conclusion,) if self.quiet else parts:
            if isinstance(part, Document):
                console.print(terminal_view(part, verbose=self.verbose))
            elif isinstance(part, Table | Texts):
                console.print(blocks_view((part,), self.verbose))
            else:
                console.print(part, soft_wrap=self.quiet)

    def warn(self, message: str) -> None:
        """One line on standard error."""
        print(f"brv-hypo: {printable(message)}", file=sys.stderr)

    def write_json(self, result: Any) -> None:
        """The result as JSON, where it was requested; what is not finite becomes null."""
        if self.json is None:
            return
        text = as_json(result, left_out())
        if self.json_only:
            self.stdout.write(text)
        else:
            write_whole(Path(self.json), text)
            self.show(f"Wrote {self.json}.")

    def deliver(
        self, document: Document, result: Any, settings: BaseModel | None = None, records: Iterable[str | Path] = ()
    ) -> None:
        """Print a document; write the result as JSON, report and picture files, where they were requested."""
        self.show(document, conclusion=document.line)
        self.write_json(result)
        if self.report is not None:
            from brv_hypo.report.html import page

            write_whole(self.report, page(document, self.provenance(settings, records)))
            self.show(f"Wrote {self.report}.")
        if self.figures is not None:
            from brv_hypo.report.write import draw_into

            written = draw_into(self.figures, document.charts, overwrite=self.force)
            none = "The result has no charts: no picture files were written."
            self.show(f"Wrote {len(written)} files to {self.figures}." if written else none)

    @staticmethod
    def provenance(settings: BaseModel | None = None, records: Iterable[str | Path] = ()) -> dict[str, str]:
        """Version, settings, digests of the records, and the command line that this process was given."""
        from brv_hypo.report.html import provenance

        return provenance(shlex.join(["brv-hypo", *sys.argv[1:]]), settings, records)

    def progress(self, title: str, seconds: float = 0.0, unless: str = "") -> AbstractContextManager[Report]:
        """What long work reports to, on standard error, never with -q; how long it takes if long, and `unless` what."""
        if seconds > LONG_SECONDS and not self.quiet:
            length = f"{seconds:.0f} s" if seconds < 100.0 else f"{seconds / 60.0:.0f} min"
            self.warn(f"{title} takes about {length} of a free processor{unless}")
        return shown(title, quiet=self.quiet)


def left_out() -> tuple[str, ...]:
    """Why plugins were left out, where any were loaded."""
    mechanisms: Any = sys.modules.get("brv_hypo.mechanisms")
    return () if mechanisms is None else (*mechanisms.left_out(),)


def as_json(result: Any, warnings: tuple[str, ...] = ()) -> str:
    """JSON text of a result, NaN and infinity as null, arrays as lists; `warnings` are added to those that it holds."""
    from pydantic_core import to_json

    text = to_json(result, by_alias=True, indent=2, inf_nan_mode="null", fallback=lambda value: value.tolist())
    if warnings:
        content = json_format.loads(text)
        content["warnings"] = [*content.get("warnings", ()), *warnings]
        text = json_format.dumps(content, indent=2, ensure_ascii=False).encode()
    return text.decode() + "\n"


RESULT = ("json", "report", "figures", "force", "plugin")
ANALYSIS = ("config", "start", "stop", "instruments", *RESULT)
"""Options of a command that makes a result, and that makes it of records."""


def in_session(*options: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Make a function a command: its session is its first argument, and the command line has the session's options.
    `options` are those of `ANALYSIS` that the command takes; -q and -v are everyone's. Plugins that could not be loaded
    are named on standard error, however quiet the command is to be.
    """
    hints = get_type_hints(Session, include_extras=True)
    names = [name for name in hints if name in (*options, "quiet", "verbose")]
    keyword = inspect.Parameter.KEYWORD_ONLY
    shared = [inspect.Parameter(k, keyword, default=getattr(Session, k), annotation=hints[k]) for k in names]

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        @guarded
        @functools.wraps(command)
        def run(**given: Any) -> None:
            session = Session(**{name: given.pop(name) for name in names})
            try:
                # Nothing but the result may reach a standard output that belongs to JSON.
                with redirect_stdout(sys.stderr) if session.json_only else nullcontext():
                    # without --plugin the registry stays unimported, unless an earlier command of this process had one
                    if "plugin" in names and (session.plugin or "brv_hypo.mechanisms" in sys.modules):
                        from brv_hypo.mechanisms import plugin_files, use_plugin_files

                        if session.plugin or plugin_files():
                            use_plugin_files(session.plugin or ())
                    command(session, **given)
            finally:
                for reason in left_out():
                    session.warn(reason)

        declared = inspect.signature(command, eval_str=True)
        own = list(declared.parameters.values())[1:]
        signature = declared.replace(parameters=[*own, *shared])
        run.__signature__ = signature  # type: ignore[attr-defined]  # what the command line reads
        run.__annotations__ = {p.name: p.annotation for p in signature.parameters.values()}
        return run

    return decorate
