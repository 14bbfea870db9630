"""HDF5, Parquet and MATLAB files, read by a process of their own.

Damaged files crash these libraries, and small ones can ask for terabytes. One child process, begun at the first
file and kept, reads for this one, within limits of memory and time that the system enforces; if it ends, the file
is refused and the next one gets a new child.
"""

from __future__ import annotations

import atexit
import json
import os
import subprocess
import sys
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from brv_hypo.errors import FlightRecordError
from brv_hypo.io.reading import check_regular
from brv_hypo.io.text import one_line

READ_BUDGET = 256 << 20  # bytes of values in one file: 14 channels at 1 kHz for 40 minutes
READ_CPU_SECONDS = 5  # of processor time for one file; 256 MB of compressed HDF5 take 2
LONGEST_READ_SECONDS = 120.0  # by the clock, for a medium that does not answer

_CHILD = Path(__file__).with_name("sandbox_worker.py")
_LIBRARIES = {"hdf5": "HDF5", "parquet": "Parquet", "mat": "MATLAB"}


@dataclass(frozen=True)
class Held:
    """One array or list of texts in a file; `units` None where none are stated."""

    place: str
    values: NDArray[Any]
    units: Any = None


@dataclass(frozen=True)
class Content:
    """What a file holds of what was asked for.

    `groups`: by place ("" is the root), attributes and names of datasets not read. `names`: all columns of a table.
    """

    held: tuple[Held, ...]
    groups: dict[str, dict[str, Any]] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    is_hdf5: bool = False


def read_hdf5(path: str | Path, only: dict[str, list[str] | None] | None = None) -> Content:
    """Groups with attributes and datasets; `only` names, by group, the datasets to read (None: all below it).

    Raises FlightRecordError where the file cannot be read, is damaged or beyond the budget.
    """
    return _ask("hdf5", path, {"only": only})


def read_table(kind: str, path: str | Path, names: tuple[str, ...]) -> Content:
    """The columns `names`, as far as they exist, of a file of that kind ("parquet" or "mat"), as float arrays.

    Raises FlightRecordError where the file cannot be read, is damaged or beyond the budget.
    """
    return _ask(kind, path, {"names": list(names)})


def _ask(kind: str, path: str | Path, details: dict[str, Any]) -> Content:
    check_regular(
        path, "a flight record" if kind == "hdf5" else f"a {_LIBRARIES[kind]} table", FlightRecordError
    )
    limits = {"budget": READ_BUDGET, "seconds": READ_CPU_SECONDS}
    try:
        header, arrays = _child.ask({"kind": kind, "path": os.path.abspath(path), **limits, **details})
    except EOFError as ended:
        raise _damaged(path, kind, f"the {_LIBRARIES[kind]} library {ended}") from None
    if "refused" in header:
        parts = {name: one_line(text) for name, text in header["refused"].items()}
        place = f"{parts['place']}: " if parts["place"] else ""
        raise FlightRecordError(
            f"{path}: {place}found {parts['found']}, expected {parts['expected']}. "
            f"Likely cause: {parts['cause']}. Remedy: {parts['remedy']}."
        )
    if "memory" in header:
        raise _damaged(path, kind, "it asks for more memory than its values would take")
    if "library" in header:
        raise _damaged(path, kind, one_line(header["library"]))
    held = []
    for entry in header.get("datasets", ()):
        values = np.array(entry["texts"]) if "texts" in entry else arrays.pop(0)
        held.append(Held(entry["place"], values.reshape(entry["shape"]), entry.get("units")))
    names = tuple(header.get("names", ()))
    return Content(tuple(held), header.get("groups", {}), names, header.get("is_hdf5", False))


def _damaged(path: str | Path, kind: str, found: str) -> FlightRecordError:
    return FlightRecordError(
        f"{path}: found {_LIBRARIES[kind]} that cannot be read ({found}), expected an intact file. "
        "Likely cause: a truncated or damaged copy. Remedy: copy or write the file again from its source."
    )


class _Child:
    """The reading process of this process."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._owner = 0

    def ask(self, request: dict[str, Any]) -> tuple[dict[str, Any], list[NDArray[Any]]]:
        """Header and arrays of the answer. Raises EOFError that says how the child ended instead."""
        with self._lock:
            process = self._running()
            clock = threading.Timer(LONGEST_READ_SECONDS, process.kill)
            clock.daemon = True
            clock.start()
            try:
                assert process.stdin is not None
                assert process.stdout is not None
                process.stdin.write(json.dumps(request).encode("ascii") + b"\n")
                process.stdin.flush()
                return _answer(process.stdout)
            except (EOFError, BrokenPipeError):
                raise EOFError(_how_ended(process)) from None
            except BaseException:  # an answer half read cannot be followed by another
                self.end()
                raise
            finally:
                clock.cancel()

    def end(self) -> None:
        """End the child, if this process has one."""
        if self._process is not None and self._owner == os.getpid():
            self._process.kill()
            self._process.wait()
        self._process = None

    def _running(self) -> subprocess.Popen[bytes]:
        if self._process is None or self._owner != os.getpid() or self._process.poll() is not None:
            self._owner = os.getpid()
            self._process = subprocess.Popen(
                [sys.executable, "-P", str(_CHILD)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=_environment(),
                start_new_session=True,  # an interrupt from the keyboard is this process's to handle
            )
        return self._process


def _environment() -> dict[str, str]:
    """The same modules as here; one thread, and an allocator that the limit of memory can count."""
    own = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    modules = os.pathsep.join(path for path in sys.path if path)
    return {**os.environ, **own, "PYTHONPATH": modules, "ARROW_DEFAULT_MEMORY_POOL": "system"}


def _answer(stream: Any) -> tuple[dict[str, Any], list[NDArray[Any]]]:
    header: dict[str, Any] = json.loads(_exactly(stream, int.from_bytes(_exactly(stream, 8), "little")))
    arrays = []
    for entry in header.get("datasets", ()):
        if "dtype" in entry:
            array = np.empty(entry["shape"], dtype=np.dtype(entry["dtype"]))
            _fill(stream, array)
            arrays.append(array)
    return header, arrays


def _exactly(stream: BinaryIO, size: int) -> bytes:
    content = stream.read(size)
    if len(content) < size:
        raise EOFError
    return content


def _fill(stream: Any, array: NDArray[Any]) -> None:
    """Read the array's bytes into it."""
    view = memoryview(array.reshape(-1).view(np.uint8).data)
    while view:
        count = stream.readinto(view)
        if not count:
            raise EOFError
        view = view[count:]


def _how_ended(process: subprocess.Popen[bytes]) -> str:
    import signal

    code = process.wait()
    if code in (-signal.SIGXCPU, -signal.SIGKILL):
        return "did not finish in the time that a sound file takes"
    return f"crashed on it ({signal.Signals(-code).name})" if code < 0 else f"ended on it (code {code})"


_child = _Child()
atexit.register(_child.end)
