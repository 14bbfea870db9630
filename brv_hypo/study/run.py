"""`run_study`: every flight of a study, in parallel, each outcome kept at once."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from functools import cache
from pathlib import Path

from joblib import Parallel, delayed, parallel_config

from brv_hypo.mechanisms import plugin_files, use_plugin_files
from brv_hypo.study.config import StudyConfig
from brv_hypo.study.draws import Draw, check_names, draws
from brv_hypo.study.outcome import Outcome
from brv_hypo.study.store import Store
from brv_hypo.study.trial import fly

PARENT_LOOKED_FOR_SECONDS = 0.5  # how often a worker looks whether it still has one

Progress = Callable[[int, int, Outcome], None]


def run_study(
    study: StudyConfig,
    folder: str | Path,
    *,
    jobs: int = 1,
    overwrite: bool = False,
    progress: Progress | None = None,
    note: Callable[[str], None] | None = None,
) -> tuple[Outcome, ...]:
    """Fly what `folder` does not hold yet; the outcomes of the whole study, in its order.

    `jobs` processes at once (-1: one for each processor), each with one thread for linear algebra.
    `progress` is called with flights done, flights in all and the latest outcome. A flight that fails is an
    outcome with its reason. Raises UsageError for a vehicle or planted set that does not exist, and where
    `folder` holds another study and `overwrite` is not set. `note` is told what was dropped of the folder.
    """
    check_names(study)
    store = Store(Path(folder), study, overwrite=overwrite)
    wanted = draws(study)
    missing = [draw for draw in wanted if draw.key not in store.known()]
    if note is not None:
        for line in store.notes:
            note(line)
    with closing(store):
        for done, outcome in enumerate(_flown(study, missing, jobs), start=len(wanted) - len(missing) + 1):
            store.add(outcome)
            if progress is not None:
                progress(done, len(wanted), outcome)
    known = store.known()
    return tuple(known[draw.key] for draw in wanted)


def _flown(study: StudyConfig, wanted: Sequence[Draw], jobs: int) -> Iterator[Outcome]:
    """Outcomes as they come."""
    with parallel_config(backend="loky", inner_max_num_threads=1):
        parallel = Parallel(n_jobs=jobs, return_as="generator_unordered", batch_size=1)
        yield from parallel(delayed(_fly)(plugin_files(), study, draw) for draw in wanted)


def _fly(plugins: Sequence[str], study: StudyConfig, draw: Draw) -> Outcome:
    """One flight in whatever process this is, which has to know the plugins that are files."""
    if multiprocessing.parent_process() is not None:  # a signal from the keyboard is the parent's to handle
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        _end_with_parent()
    if tuple(plugins) != plugin_files():
        use_plugin_files(plugins)
    return fly(study, draw)


@cache
def _end_with_parent() -> None:
    """From now on this worker ends when its parent has: one that was killed could tell nobody."""
    parent = os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(PARENT_LOOKED_FOR_SECONDS)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
