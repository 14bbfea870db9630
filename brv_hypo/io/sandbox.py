"""Readers of binary files run in a process of their own, within limits of memory and time that the system enforces.

Damaged files crash the HDF5, Parquet and MATLAB libraries, and small ones can allocate terabytes. One worker process,
begun at the first file and kept, runs `reader(path, budget, ...)` and sends back what it returns or refuses, pickled;
if the worker ends, the file is refused and the next one gets a new worker. Entrance: `read_in_sandbox`.

The worker is a plain child and no process of `multiprocessing` or loky: these import the user's main script again,
which a notebook or a script without a guard does not survive, or take 0.3 s more; no daemonic worker may begin either.
"""

from __future__ import annotations

import atexit
import math
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from brv_hypo.errors import FlightRecordError
from brv_hypo.io.text import one_line, refused

READ_BUDGET = 256 << 20  # bytes of values in one file: 14 channels at 1 kHz for 40 minutes
READ_CPU_SECONDS = 5  # of processor time for one file; 256 MB of compressed HDF5 take 2
LONGEST_READ_SECONDS = 120.0  # by the clock, for a medium that does not answer
MEMORY_BUDGETS = 3  # how many times the budget of values may be taken to read them
SPARE_BYTES = 256 << 20
_PROGRAM = "from brv_hypo.io.sandbox import serve; serve()"
Content = TypeVar("Content")


class Budget:
    """Bytes of values that may still be read."""

    def __init__(self, most: int) -> None:
        self._most = self._left = most

    def take(self, size: int, place: str) -> None:
        """Take `size` bytes; raises FlightRecordError where that is more than what is left."""
        self._left -= size
        self.check(self._most - self._left, place)

    def check(self, size: int, place: str) -> None:
        """Raise FlightRecordError where `size` bytes are more than there ever were."""
        if size > self._most:
            expected = f"at most {self._most / 2**20:.6g} MB of values in one file"
            cause = "a damaged or forged header, or a record of many flights"
            remedy = "copy the file again, cut it into flights, or lower the sample rate"
            raise refused(place, f"{size / 2**20:.6g} MB declared", expected, cause, remedy)


def read_in_sandbox(library: str, reader: Callable[..., Content], path: str | Path, *arguments: Any) -> Content:
    """What `reader(path, budget, *arguments)` returns; FlightRecordError if it refuses, fails or takes too much."""
    try:
        answer = _worker.ask((reader, os.path.abspath(path), READ_BUDGET, READ_CPU_SECONDS, arguments))
    except EOFError as ended:
        answer = RuntimeError(f"the {library} library {ended}")
    if isinstance(answer, FlightRecordError):
        raise FlightRecordError(f"{path}: {answer}")
    if isinstance(answer, Exception):
        raise FlightRecordError(
            f"{path}: found {library} that cannot be read ({one_line(str(answer))}), expected an intact file. "
            "Likely cause: a truncated or damaged copy. Remedy: copy or write the file again from its source."
        )
    content: Content = answer
    return content


class _Worker:
    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._owner = 0

    def ask(self, request: tuple[Any, ...]) -> Any:
        """What the reader returned or raised. Raises EOFError that says how the worker ended instead."""
        with self._lock:
            process = self._running()
            assert process.stdin is not None
            assert process.stdout is not None
            clock = threading.Timer(LONGEST_READ_SECONDS, process.kill)
            clock.daemon = True
            clock.start()
            try:
                pickle.dump(request, process.stdin)
                process.stdin.flush()
                return pickle.load(process.stdout)
            except (EOFError, BrokenPipeError, pickle.UnpicklingError):
                process.kill()  # it has ended already, unless it wrote what is no answer
                code = process.wait()
                how = f"crashed on it ({signal.Signals(-code).name})" if code < 0 else f"ended on it (code {code})"
                late = code in (-signal.SIGXCPU, -signal.SIGKILL)
                raise EOFError("did not finish in the time that a sound file takes" if late else how) from None
            except BaseException:  # an answer half read cannot be followed by another
                self.end()
                raise
            finally:
                clock.cancel()

    def end(self) -> None:
        """End the worker, if this process has one."""
        if self._process is not None and self._owner == os.getpid():
            with self._process as process:  # whose pipes are closed at the end
                process.kill()
        self._process = None

    def _running(self) -> subprocess.Popen[bytes]:
        if self._process is None or self._owner != os.getpid() or self._process.poll() is not None:
            self.end()
            self._owner = os.getpid()
            # One thread, and an allocator that the limit of memory can count.
            own = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
            modules = os.pathsep.join(path for path in sys.path if path)
            own |= {"PYTHONPATH": modules, "ARROW_DEFAULT_MEMORY_POOL": "system"}
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", _PROGRAM],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=os.environ | own,
                start_new_session=True,  # an interrupt from the keyboard is this process's to handle
            )
        return self._process


_worker = _Worker()
atexit.register(_worker.end)


def serve() -> None:
    """Answer requests until standard input ends."""
    answers, requests = sys.stdout.buffer, sys.stdin.buffer
    sys.stdout = sys.stderr  # what a library prints must not mix with the answers
    answer: Any
    while True:
        try:
            reader, path, budget, seconds, arguments = pickle.load(requests)
        except EOFError:
            return
        try:
            _limit(budget, seconds)
            answer = reader(path, Budget(budget), *arguments)
        except FlightRecordError as refusal:
            answer = FlightRecordError(str(refusal))
        except MemoryError:
            answer = RuntimeError("it asks for more memory than its values would take")
        except Exception as error:  # the libraries raise errors of every kind on damaged files
            answer = RuntimeError(f"{type(error).__name__}: {error}")
        pickle.dump(answer, answers, protocol=5)
        answers.flush()


def _limit(budget: int, seconds: int) -> None:
    """Let the system end this process where it takes too much memory or time for one file."""
    try:
        import resource
    except ImportError:  # a system without such limits: the parent still has its own clock
        return

    def lower(what: int, limit: int) -> None:
        hard = resource.getrlimit(what)[1]
        resource.setrlimit(what, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard))

    lower(resource.RLIMIT_CORE, 0)
    lower(resource.RLIMIT_CPU, math.ceil(time.process_time()) + seconds)
    try:
        with open("/proc/self/statm", encoding="ascii") as stream:
            address_space = int(stream.read().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return
    lower(resource.RLIMIT_AS, address_space + MEMORY_BUDGETS * budget + SPARE_BYTES)
