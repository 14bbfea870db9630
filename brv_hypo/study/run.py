"""`run_study`: every flight of a study, in parallel, each outcome stored at once.

`spread` calls a function on every item: in processes of this machine (joblib with loky), or on the workers of a
Dask scheduler. An interrupted study goes on with the flights that its folder does not hold.
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
from pathlib import Path
from typing import Any, TypeVar

from brv_hypo.errors import UnanswerableError, UsageError
from brv_hypo.mechanisms import plugin_files, use_plugin_files
from brv_hypo.study.config import StudyConfig
from brv_hypo.study.draws import Draw, check_names, draws
from brv_hypo.study.store import Store
from brv_hypo.study.trial import Outcome, fly

Item = TypeVar("Item")
Result = TypeVar("Result")
Progress = Callable[[int, int, Outcome], None]

PARENT_CHECK_SECONDS = 0.5  # how often a worker looks whether it still has one
CONNECT_SECONDS = 20.0  # until a scheduler that does not answer is given up


def run_study(
    study: StudyConfig,
    folder: str | Path,
    *,
    jobs: int = 1,
    cluster: str | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> tuple[Outcome, ...]:
    """Fly what `folder` does not hold yet; the outcomes of the whole study, in its order.

    `jobs` processes at once (-1: one for each processor), or the workers of the Dask scheduler at `cluster`.
    `progress` is called with flights done, flights in all and the latest outcome. A flight that fails is an
    outcome with its reason. Raises UsageError for a vehicle or planted set that does not exist, and where
    `folder` holds another study and `overwrite` is not set, or no scheduler answers.
    """
    check_names(study)
    wanted = draws(study)
    with closing(Store(Path(folder), study, overwrite=overwrite)) as store:
        known = store.known()
        missing = [draw for draw in wanted if draw.key not in known]
        flown = spread(partial(_fly, study, plugin_files()), missing, jobs=jobs, cluster=cluster)
        for done, outcome in enumerate(flown, start=len(wanted) - len(missing) + 1):
            store.add(outcome)
            known[outcome.draw.key] = outcome
            if progress is not None:
                progress(done, len(wanted), outcome)
    return tuple(known[draw.key] for draw in wanted)


def _fly(study: StudyConfig, plugins: Sequence[str], draw: Draw) -> Outcome:
    """One flight in whatever process this is, which has to know the plugins that are files."""
    if tuple(plugins) != plugin_files():
        use_plugin_files(plugins)
    return fly(study, draw)


def spread(
    call: Callable[[Item], Result], items: Sequence[Item], *, jobs: int = 1, cluster: str | None = None
) -> Iterator[Result]:
    """The results of `call` for every item, in any order, each item once; both must survive pickle.

    `jobs` processes of one thread each, or the workers of the Dask scheduler at `cluster`: these need this package,
    and files that were named with --plugin, in the same places, and one thread each (`dask worker --nthreads 1`).
    What a lost worker was flying, another flies again. What is not done when the caller stops is cancelled.
    """
    if cluster is not None:
        yield from _on_cluster(call, items, cluster)
        return
    from joblib import Parallel, delayed, parallel_config

    worker = {"initializer": _as_worker_of, "initargs": (os.getpid(),)}
    with parallel_config(backend="loky", inner_max_num_threads=1, **worker):
        parallel = Parallel(n_jobs=jobs, return_as="generator_unordered", batch_size=1)
        yield from parallel(delayed(call)(item) for item in items)


def _on_cluster(call: Callable[[Item], Result], items: Sequence[Item], address: str) -> Iterator[Result]:
    """Dask itself: the Dask back end of joblib 1.6 waits for ever for a flight that ends every worker."""
    try:
        distributed: Any = import_module("distributed")  # which declares no types
    except ImportError as error:
        raise UsageError("--cluster needs Dask. Install the extra: pip install 'brv-hypo[cluster]'.") from error
    try:
        client = distributed.Client(address, timeout=CONNECT_SECONDS)
    except (OSError, TimeoutError, ValueError) as error:
        raise UsageError(
            f"no Dask scheduler answers at {address!r} ({type(error).__name__}), expected one like tcp://host:8786. "
            "Likely cause: it is not running, or a firewall. Remedy: start `dask scheduler` and `dask worker`, and "
            "give the address that the scheduler prints."
        ) from error
    with client:
        try:
            for future in distributed.as_completed(client.map(call, list(items), pure=False)):
                yield future.result()
        except distributed.KilledWorker as lost:
            raise UnanswerableError(
                f"the cluster lost 3 workers or more on one flight ({lost}). Likely cause: too little memory, or "
                "a batch system that ends jobs. Remedy: give the workers more, and repeat the command: it goes on "
                "where it was."
            ) from lost


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
