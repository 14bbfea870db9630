"""`run_study`: every flight of a study, in parallel, each outcome stored at once.

`Store` keeps outcomes in an SQLite database for one process: every flight is committed as soon as it is known, and an
interrupted study goes on with the others. `spread` calls a function on every item, with joblib (loky) or Dask.
"""

from __future__ import annotations

import csv
import io
import os
import signal
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar, Unpack

from pydantic import ValidationError

from brv_hypo.errors import UnanswerableError, UsageError, missing_package
from brv_hypo.io.files import check_target, make_folder
from brv_hypo.mechanisms import plugin_files, use_plugin_files
from brv_hypo.progress import Progress, report_to
from brv_hypo.settings import settings_of, takes_settings
from brv_hypo.simulation.config import config_path
from brv_hypo.study.config import HOME, Draw, StudyConfig, StudySettings, check_names, draws
from brv_hypo.study.trial import Outcome, fly

FLIGHTS = "flights.db"
# The lock is taken once, and held until the database is closed.
_BEGIN = """
PRAGMA locking_mode = EXCLUSIVE;
PRAGMA synchronous = FULL;
BEGIN EXCLUSIVE;
CREATE TABLE IF NOT EXISTS study (settings TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS flights (key TEXT PRIMARY KEY, outcome TEXT NOT NULL);
COMMIT;
"""
# A study may grow by more flights, and its statistics may be drawn otherwise: the flights stay the same.
_FREE = {"title", "flights", "visible_effect"}


class Store:
    """The outcomes of one study in its folder."""

    def __init__(self, folder: Path, study: StudyConfig, *, overwrite: bool = False) -> None:
        """Open or begin; raises UsageError where the folder holds another study, is in use or cannot be written."""
        self._path = folder / FLIGHTS
        make_folder(folder)
        check_target(self._path, overwrite=True)
        if (folder / "flights.jsonl").exists() and not self._path.exists() and not overwrite:
            raise UsageError(f"{folder} holds a study of an earlier version. Choose another folder, or give --force.")
        with _refusals(self._path):
            self._database = sqlite3.connect(self._path, timeout=0.0, isolation_level=None)
        try:
            with _refusals(self._path):
                self._database.executescript(_BEGIN)
                if overwrite:
                    self._database.executescript("BEGIN; DELETE FROM flights; DELETE FROM study; COMMIT;")
                self._check_same(study)
        except BaseException:
            self.close()
            raise

    def known(self) -> dict[str, Outcome]:
        """Outcomes by the key of their flight."""
        try:
            with _refusals(self._path):
                rows = self._database.execute("SELECT key, outcome FROM flights").fetchall()
            return {key: Outcome.model_validate_json(outcome) for key, outcome in rows}
        except ValidationError as error:
            raise UsageError(
                f"{self._path} is not of this version: {error.errors()[0]['msg']}. Give --force to fly the study anew."
            ) from None

    def add(self, outcome: Outcome) -> None:
        """Keep an outcome: it is on the medium when this returns."""
        row = (outcome.draw.key, outcome.model_dump_json())
        with _refusals(self._path):
            self._database.execute("INSERT OR REPLACE INTO flights VALUES (?, ?)", row)

    def close(self) -> None:
        """Let another process go on with the study."""
        self._database.close()

    def _check_same(self, study: StudyConfig) -> None:
        """Keep the study's settings; raise UsageError where the flights are of another study."""
        for (settings,) in self._database.execute("SELECT settings FROM study").fetchall():
            try:
                before = StudyConfig.model_validate_json(settings).model_dump(exclude=_FREE)
            except ValidationError:
                before = None
            if before != study.model_dump(exclude=_FREE):
                raise UsageError(
                    f"{self._path.parent} holds another study. Choose another folder, or give --force to replace it."
                )
            return
        self._database.execute("INSERT INTO study VALUES (?)", (study.model_dump_json(),))


@contextmanager
def _refusals(path: Path) -> Iterator[None]:
    """Turn errors of the database into UsageError."""
    try:
        yield
    except sqlite3.OperationalError as error:
        if error.sqlite_errorcode == sqlite3.SQLITE_BUSY:
            raise UsageError(f"{path} is in use by another process. Wait for it, or choose another folder.") from None
        raise UsageError(f"{path} cannot be written: {error}. Free some room, or choose another folder.") from error
    except sqlite3.DatabaseError as error:
        raise UsageError(
            f"{path} is damaged: {error}. Remove it to fly the study anew, or choose another folder."
        ) from error


def results_csv(outcomes: Sequence[Outcome]) -> str:
    """One row for each flight: what was drawn, the verdict, and every hypothesis's probability."""
    names = list(dict.fromkeys(name for outcome in outcomes for name in outcome.probability))
    rows = [
        {
            **outcome.draw.model_dump(),
            **{name: getattr(outcome, name) for name in _COLUMNS},
            "equivalent": " ".join(outcome.equivalent),
            **{
                f"{score}_{name}": getattr(outcome, score).get(name)
                for name in names
                for score in ("probability", "information")
            },
        }
        for outcome in outcomes
    ]
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


_COLUMNS = (
    *("effect_in_plane", "effect_out_of_plane", "status", "first", "winner", "equivalent", "reason"),
    *("alpha_sigma_rad", "phi_w_sigma_rad", "seconds"),
)


# ---- Every flight of a study, in parallel ----


Item = TypeVar("Item")
Result = TypeVar("Result")
PARENT_CHECK_SECONDS = 0.5  # how often a worker looks whether it still has one
CONNECT_SECONDS = 20.0  # until a scheduler that does not answer is given up


@takes_settings(
    StudyConfig,
    study="StudyConfig, mapping, str or Path\n    Or the name of a study that comes along.",
    folder="str or Path\n    Where each outcome is kept at once; an interrupted study goes on there.",
    jobs="int\n    Processes at once; -1: one for each processor.",
    cluster="str, optional\n    Address of a Dask scheduler, whose workers are used instead.",
    overwrite="bool\n    Whether another study in the folder is replaced.",
)
def run_study(
    study: StudyConfig | Mapping[str, Any] | str | Path,
    folder: str | Path,
    *,
    jobs: int = 1,
    cluster: str | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
    **settings: Unpack[StudySettings],
) -> tuple[Outcome, ...]:
    """Fly what `folder` does not hold yet.

    Returns
    -------
    tuple of Outcome
        Of the whole study, in its order; a flight that failed is an outcome with its reason.

    Examples
    --------
    >>> import brv_hypo
    >>> small = {"vehicles": ["research_cone"], "planted": ["none"], "sample_rate": 50.0, "flights": 1}
    >>> brv_hypo.run_study(small, "study", compare={"mechanisms": ["lag"]})[0].winner
    'none'
    """
    source = config_path(study, HOME) if isinstance(study, str | Path) else study
    chosen, report = settings_of(StudyConfig, source, settings), report_to(progress)
    check_names(chosen)
    wanted = draws(chosen)
    with closing(Store(Path(folder), chosen, overwrite=overwrite)) as store:
        known = store.known()
        missing = [draw for draw in wanted if draw.key not in known]
        flown = spread(partial(_fly, chosen, plugin_files()), missing, jobs=jobs, cluster=cluster)
        for done, outcome in enumerate(flown, start=len(wanted) - len(missing) + 1):
            store.add(outcome)
            known[outcome.draw.key] = outcome
            report(done / len(wanted), f"{done} of {len(wanted)} flights, last {outcome.draw.key}")
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
        raise missing_package("--cluster", "distributed", "cluster") from error
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
