"""`run_study`: every flight of a study, in parallel, each outcome stored at once.

Flights are spread over processes of this machine (joblib with loky) or the workers of a Dask scheduler,
behind one interface:

    spread = on_this_machine(jobs)          or on_cluster(address)
    for outcome in spread(call, items): ...  in any order, each item once

`call` and the items must survive pickle. What is not done when the caller stops is cancelled. An interrupted
study goes on with the flights that its folder does not hold.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol, TypeVar

from brv_hypo.errors import UnanswerableError, UsageError
from brv_hypo.mechanisms import plugin_files, use_plugin_files
from brv_hypo.study.config import StudyConfig
from brv_hypo.study.draws import Draw, check_names, draws
from brv_hypo.study.store import Store
from brv_hypo.study.trial import Outcome, fly

Item = TypeVar("Item")
Result = TypeVar("Result")

PARENT_CHECK_SECONDS = 0.5  # how often a worker looks whether it still has one
CONNECT_SECONDS = 20.0  # until a scheduler that does not answer is given up
ATTEMPTS = 3  # workers that one item may lose before it is given up (Dask's own count)


class Spread(Protocol):
    """Calls a function on every item, and gives the results as they come."""

    def __call__(self, call: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
        """The results, in any order."""


def on_this_machine(jobs: int) -> Spread:
    """`jobs` processes at once (-1: one for each processor), each with one thread for linear algebra."""

    def spread(call: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
        from joblib import Parallel, delayed, parallel_config

        worker = {"initializer": _as_worker_of, "initargs": (os.getpid(),)}
        with parallel_config(backend="loky", inner_max_num_threads=1, **worker):
            parallel = Parallel(n_jobs=jobs, return_as="generator_unordered", batch_size=1)
            yield from parallel(delayed(call)(item) for item in items)

    return spread


def on_cluster(address: str) -> Spread:
    """The workers of the Dask scheduler at `address`; what a lost worker was flying, another flies again.

    Raises UsageError where Dask is not installed or nothing answers at the address. The workers need this package, and
    files that were named with --plugin, in the same places; one thread each (`dask worker --nthreads 1`).
    """
    client = _client(address)

    def spread(call: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
        futures: list[Any] = []
        try:
            futures = client.map(call, list(items), pure=False)
            for future in _distributed().as_completed(futures):
                yield _result(future)
        finally:
            client.cancel(futures)
            client.close()

    return spread


def _as_worker_of(parent: int) -> None:
    """A process that, from its first moment, leaves the keyboard to its parent and ends when that has.

    A parent that was killed could tell nobody, and one that was killed early gave nothing to do.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(PARENT_CHECK_SECONDS)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _distributed() -> Any:
    """Dask's package, which declares no types."""
    if find_spec("distributed") is None:
        raise UsageError("--cluster needs Dask. Install the extra: pip install 'brv-hypo[cluster]'.")
    return import_module("distributed")


def _client(address: str) -> Any:
    distributed = _distributed()
    try:
        return distributed.Client(address, timeout=CONNECT_SECONDS)
    except (OSError, TimeoutError, ValueError) as error:
        raise UsageError(
            f"no Dask scheduler answers at {address!r} ({type(error).__name__}), expected one like tcp://host:8786. "
            "Likely cause: it is not running, or a firewall. Remedy: start `dask scheduler` and `dask worker`, and "
            "give the address that the scheduler prints."
        ) from error


def _result(future: Any) -> Any:
    try:
        return future.result()
    except _distributed().KilledWorker as lost:
        raise UnanswerableError(
            f"the cluster lost {ATTEMPTS} workers or more on one flight ({lost}). Likely cause: too little memory, or "
            "a batch system that ends jobs. Remedy: give the workers more, and repeat the command: it goes on where "
            "it was."
        ) from lost


# ---- `run_study`: every flight of a study, in parallel, each outcome kept at once ----


Progress = Callable[[int, int, Outcome], None]


def run_study(
    study: StudyConfig,
    folder: str | Path,
    *,
    jobs: int = 1,
    cluster: str | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
    note: Callable[[str], None] | None = None,
) -> tuple[Outcome, ...]:
    """Fly what `folder` does not hold yet; the outcomes of the whole study, in its order.

    `jobs` processes at once (-1: one for each processor), or the workers of the Dask scheduler at `cluster`.
    `progress` is called with flights done, flights in all and the latest outcome. A flight that fails is an
    outcome with its reason. Raises UsageError for a vehicle or planted set that does not exist, and where
    `folder` holds another study and `overwrite` is not set, or no scheduler answers. `note` is called with
    what was dropped of the folder.
    """
    check_names(study)
    store = Store(Path(folder), study, overwrite=overwrite)
    wanted = draws(study)
    missing = [draw for draw in wanted if draw.key not in store.known()]
    if note is not None:
        for line in store.notes:
            note(line)
    with closing(store):
        spread = on_this_machine(jobs) if cluster is None else on_cluster(cluster)
        flown = spread(partial(_fly, study, plugin_files()), missing)
        for done, outcome in enumerate(flown, start=len(wanted) - len(missing) + 1):
            store.add(outcome)
            if progress is not None:
                progress(done, len(wanted), outcome)
    known = store.known()
    return tuple(known[draw.key] for draw in wanted)


def _fly(study: StudyConfig, plugins: Sequence[str], draw: Draw) -> Outcome:
    """One flight in whatever process this is, which has to know the plugins that are files."""
    if tuple(plugins) != plugin_files():
        use_plugin_files(plugins)
    return fly(study, draw)
