"""`run_study`: every flight of a study, in parallel, each outcome stored at once.

`fly` simulates one flight with a planted mechanism, compares on it and gives an `Outcome`; a flight that fails is an
outcome with its reason. `Store` keeps outcomes in an SQLite database for one process: every flight is committed as soon
as it is known, and an interrupted study goes on with the others. `spread` uses joblib (loky) or Dask.
"""

from __future__ import annotations

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
from typing import Any, Literal, TypeVar, Unpack

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from brv_hypo.comparison import compare
from brv_hypo.errors import BrvHypoError, UnanswerableError, UsageError, missing_package
from brv_hypo.flight.format import assemble
from brv_hypo.io.files import check_target, make_folder
from brv_hypo.mechanisms import plugin_files, use_plugin_files
from brv_hypo.motion.signals import rms
from brv_hypo.progress import Progress, report_to
from brv_hypo.settings import takes_settings
from brv_hypo.simulation import Truth, simulate
from brv_hypo.study import config
from brv_hypo.study.config import NONE, Draw, StudyConfig, StudySettings, draws, planted_faults, read_study

ABSENT = 1e-6  # part of its largest value below which what is planted counts as absent: rounding of the moments
Work = TypeVar("Work")
Result = TypeVar("Result")
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
PARENT_CHECK_SECONDS = 0.5  # how often a worker checks whether it still has one
CONNECT_SECONDS = 20.0  # until a scheduler that does not answer is given up


class Outcome(BaseModel):
    """One flight: what was drawn, what was planted, and what `compare` made of it."""

    model_config = ConfigDict(frozen=True, ser_json_inf_nan="constants", use_attribute_docstrings=True)

    draw: Draw = Field(description="what the flight drew")
    status: Literal["compared", "refused", "not simulated", "not compared"] = Field(description="what became of it")
    reason: str = Field(default="", description="why the flight was not compared")
    faults: tuple[str, ...] = Field(default=(), description="that the compatibility check named: channel: fault")
    fault_named: bool | None = Field(default=None, description="whether the planted one is among them")
    effect_in_plane: float = Field(default=0.0, description="rms of what is planted over the moment's, then")
    effect_out_of_plane: float = Field(default=0.0, description="the same, out of plane")
    first: str | None = Field(default=None, description="ranked first")
    winner: str | None = Field(default=None, description="named; null: none")
    equivalent: tuple[str, ...] = Field(default=(), description="as in `compare`")
    probability: dict[str, float] = Field(default={}, description="by hypothesis")
    information: dict[str, float] = Field(default={}, description="-2 ln evidence over baseline only's, by hypothesis")
    alpha_sigma_rad: float | None = Field(default=None, description="rms, rad")
    phi_w_sigma_rad: float | None = Field(default=None, description="of the meridian, rms, rad")
    seconds: float = Field(default=0.0, description="of the comparison, s")

    @property
    def planted(self) -> str:
        """The hypothesis that is true."""
        return self.draw.planted

    @property
    def effect(self) -> float:
        """The larger of the two effects."""
        return max(self.effect_in_plane, self.effect_out_of_plane)

    @property
    def right(self) -> bool:
        """True where the planted mechanism ranks first."""
        return self.first == self.planted

    @property
    def won(self) -> bool:
        """True where the verdict names the planted mechanism."""
        return self.winner == self.planted

    @property
    def wrong(self) -> bool:
        """True where the verdict names a mechanism that was not planted."""
        return self.winner not in (None, NONE, self.planted)

    @property
    def lead(self) -> float | None:
        """By how much the first leads what was planted by -2 ln evidence; None where that was not compared."""
        known = self.information
        return known[self.planted] - known[self.first] if self.first in known and self.planted in known else None


def effect_size(truth: Truth) -> tuple[float, float]:
    """Rms of what is planted in and out of plane over the rms of the whole moment, while it lasts."""
    planted = np.hypot(truth.planted_in_plane, truth.planted_out_of_plane)
    if not truth.planted or not np.any(planted):
        return 0.0, 0.0
    lasts = planted > ABSENT * planted.max()
    whole = rms(np.hypot(truth.C_N, truth.C_Z)[lasts])
    return rms(truth.planted_in_plane[lasts]) / whole, rms(truth.planted_out_of_plane[lasts]) / whole


def fly(study: StudyConfig, draw: Draw, plugins: Sequence[str] | None = None) -> Outcome:
    """Simulate the flight and compare on it; what goes wrong is the outcome's reason. `plugins`: files to know."""
    if plugins not in (None, plugin_files()):
        use_plugin_files(plugins)
    begun = time.perf_counter()
    try:
        flown = simulate(config.flight_config(study, draw), seed=draw.seed)
    except Exception as error:
        return Outcome(draw=draw, status="not simulated", reason=_reason(error))
    in_plane, out_of_plane = effect_size(flown.truth)
    known: dict[str, Any] = {"draw": draw, "effect_in_plane": in_plane, "effect_out_of_plane": out_of_plane}
    try:
        flight = assemble(config.corrupted(flown.record, draw)) if draw.fault else flown.flight
        found = compare([flight], study.compare)
    except Exception as error:
        return Outcome(**known, status="not compared", reason=_reason(error))
    faults, verdict, ranking = found.record.faults, found.verdict, found.ranking
    known["faults"] = tuple(f"{fault.channel}: {fault.fault}" for fault in faults)
    known["fault_named"] = planted_faults()[draw.fault].named_by(faults) if draw.fault else None
    known["seconds"] = time.perf_counter() - begun
    if not ranking:
        return Outcome(**known, status="refused", reason=verdict.reason)
    return Outcome(
        **known,
        status="compared",
        first=ranking[0].mechanism,
        winner=verdict.winner,
        equivalent=verdict.equivalent,
        probability=verdict.probability,
        information={row.mechanism: -2.0 * row.log_evidence for row in ranking},
        alpha_sigma_rad=found.reconstruction.alpha_rms_sigma_rad,
        phi_w_sigma_rad=found.reconstruction.phi_w_rms_sigma_rad,
    )


def _reason(error: Exception) -> str:
    """A refusal in its own words; a fault with its kind, for it is the program's."""
    return str(error) if isinstance(error, BrvHypoError) else f"fault, {type(error).__name__}: {error}"


class Store:
    """The outcomes of one study in its folder."""

    def __init__(self, folder: Path, study: StudyConfig, *, overwrite: bool = False) -> None:
        """Open or begin; raises UsageError where the folder holds another study, is in use or cannot be written."""
        self._path = folder / FLIGHTS
        make_folder(folder)
        check_target(self._path, overwrite=True)
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
    except sqlite3.DatabaseError as error:
        found = f"is damaged: {error}. Remove it to fly the study anew"
        if error.sqlite_errorcode == sqlite3.SQLITE_BUSY:
            found = "is in use by another process. Wait for it"
        elif isinstance(error, sqlite3.OperationalError):
            found = f"cannot be written: {error}. Free some room"
        raise UsageError(f"{path} {found}, or choose another folder.") from error


def results_csv(outcomes: Sequence[Outcome]) -> str:
    """One row for each flight: what was drawn, the verdict, and every hypothesis's probability."""
    import pandas as pd

    included = {"effect_in_plane", "effect_out_of_plane", "status", "first", "winner", "reason"}
    included |= {"alpha_sigma_rad", "phi_w_sigma_rad", "seconds"}
    rows = [
        {
            **outcome.draw.model_dump(),
            **outcome.model_dump(include=included),
            "equivalent": " ".join(outcome.equivalent),
            **{f"probability_{name}": value for name, value in outcome.probability.items()},
            **{f"information_{name}": value for name, value in outcome.information.items()},
        }
        for outcome in outcomes
    ]
    return pd.DataFrame(rows).to_csv(index=False)


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
    chosen, report = read_study(study, **settings), report_to(progress)
    config.check_names(chosen)
    wanted = draws(chosen)
    with closing(Store(Path(folder), chosen, overwrite=overwrite)) as store:
        known = store.known()
        missing = [draw for draw in wanted if draw.key not in known]
        flown = spread(partial(fly, chosen, plugins=plugin_files()), missing, jobs=jobs, cluster=cluster)
        for done, outcome in enumerate(flown, start=len(wanted) - len(missing) + 1):
            store.add(outcome)
            known[outcome.draw.key] = outcome
            report(done / len(wanted), f"{done} of {len(wanted)} flights, last {outcome.draw.key}")
    return tuple(known[draw.key] for draw in wanted)


def spread(
    call: Callable[[Work], Result], items: Sequence[Work], *, jobs: int = 1, cluster: str | None = None
) -> Iterator[Result]:
    """The results of `call` for every item, in any order, each item once; both must survive pickle. `jobs` processes of
    one thread each, or the workers of the Dask scheduler at `cluster`: these need this package, and files that were
    named with --plugin, in the same places, and one thread each (`dask worker --nthreads 1`). What a lost worker was
    flying, another flies again. What is not done when the caller stops is cancelled.
    """
    if cluster is not None:
        yield from _on_cluster(call, items, cluster)
        return
    from joblib import Parallel, delayed, parallel_config

    worker = {"initializer": _as_worker_of, "initargs": (os.getpid(),)}
    with parallel_config(backend="loky", inner_max_num_threads=1, **worker):
        parallel = Parallel(n_jobs=jobs, return_as="generator_unordered", batch_size=1)
        yield from parallel(delayed(call)(item) for item in items)


def _on_cluster(call: Callable[[Work], Result], items: Sequence[Work], address: str) -> Iterator[Result]:
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
    """A process that leaves the keyboard to its parent, and ends when that has, killed or not."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(PARENT_CHECK_SECONDS)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
