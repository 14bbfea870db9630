"""Made-up outcomes, for statistics whose answer is known."""

from __future__ import annotations

import json
import shutil
import sqlite3
import tempfile
from contextlib import closing
from pathlib import Path
from typing import Any

from brv_hypo.study.config import Draw
from brv_hypo.study.run import FLIGHTS, Outcome


def outcome(
    planted: str = "lag",
    first: str = "lag",
    *,
    winner: str | None = None,
    probability: dict[str, float] | None = None,
    information: dict[str, float] | None = None,
    effect: float = 0.2,
    vehicle: str = "cone",
    repeat: int = 0,
) -> Outcome:
    """A compared flight."""
    draw = Draw(
        vehicle=vehicle,
        planted=planted,
        repeat=repeat,
        seed=repeat,
        size=1.0,
        delay=1.0,
        onset_shift=0.0,
        alpha=1.0,
        roll_rate=1.0,
        windward_meridian=0.0,
        gyro_noise=1.0,
    )
    probability = probability or {"none": 0.0, "lag": 0.0, "sticking": 0.0} | {first: 1.0}
    return Outcome(
        draw=draw,
        status="compared",
        effect_in_plane=0.0 if planted == "none" else effect,
        first=first,
        winner=winner,
        equivalent=(first,),
        probability=probability,
        information=information or {name: -10.0 * (name == first) for name in probability},
        seconds=1.0,
    )


def stored(folder: Path) -> list[dict[str, Any]]:
    """The outcomes in a study's folder, read from a copy: the process that flies has the database locked."""
    with tempfile.TemporaryDirectory() as copies:
        for path in folder.glob(FLIGHTS + "*"):  # the database, and the journal that a killed process leaves
            shutil.copy(path, copies)
        with closing(sqlite3.connect(Path(copies) / FLIGHTS)) as database:
            if not database.execute("SELECT 1 FROM sqlite_master").fetchall():
                return []
            rows = database.execute("SELECT outcome FROM flights ORDER BY rowid").fetchall()
            return [json.loads(outcome) for (outcome,) in rows]
