"""Outcomes on disk, in an SQLite database: every flight is committed as soon as it is known.

`Store` holds the database of one study for one process; an interrupted study goes on from it. `results_csv` is
the table of the flights for other programs.
"""

from __future__ import annotations

import csv
import io
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from pydantic import ValidationError

from brv_hypo.errors import UsageError
from brv_hypo.io.atomic import check_target, writable
from brv_hypo.study.config import StudyConfig
from brv_hypo.study.trial import Outcome

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
        with writable(folder):
            folder.mkdir(parents=True, exist_ok=True)
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
