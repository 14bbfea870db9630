"""Outcomes on disk: every flight is appended as soon as it is known, so that a study can be interrupted."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from brv_hypo.errors import UsageError
from brv_hypo.io.atomic import LineLog, writable, write_whole
from brv_hypo.io.mappings import read_json
from brv_hypo.io.reading import kind_of
from brv_hypo.study.config import StudyConfig
from brv_hypo.study.draws import Draw, draws
from brv_hypo.study.trial import Outcome

STUDY, FLIGHTS = "study.json", "flights.jsonl"
# A study may grow by more flights, and its statistics may be drawn otherwise: the flights stay the same.
_FREE = {"title", "flights", "visible_effect"}


class Store:
    """The folder of one study; `notes` says what was dropped of it."""

    def __init__(self, folder: Path, study: StudyConfig, *, overwrite: bool = False) -> None:
        """Open or begin; raises UsageError where the folder holds another study, is in use or cannot be written."""
        with writable(folder):
            folder.mkdir(parents=True, exist_ok=True)
        self._log = LineLog(folder / FLIGHTS)
        try:
            if overwrite:
                self._log.clear()
            outcomes, self.notes = _outcomes(self._log, folder / FLIGHTS)
            self._outcomes = {outcome.draw.key: outcome for outcome in outcomes}
            description = folder / STUDY
            if not overwrite and kind_of(description) is not None:
                self._check_same(description, study)
            write_whole(description, study.model_dump_json(indent=2) + "\n")
        except BaseException:
            self._log.close()
            raise

    def known(self) -> dict[str, Outcome]:
        """Outcomes by the key of their flight."""
        return dict(self._outcomes)

    def add(self, outcome: Outcome) -> None:
        """Keep an outcome now."""
        self._log.append(outcome.model_dump_json())
        self._outcomes[outcome.draw.key] = outcome

    def close(self) -> None:
        """Let another process go on with the study."""
        self._log.close()

    def _check_same(self, description: Path, study: StudyConfig) -> None:
        """Raise UsageError unless the description, or where it is damaged every flight, is of this study."""
        try:
            content = read_json(description, "a study")
        except UsageError:
            wanted = {draw.key: draw for draw in draws(study)}
            if all(wanted.get(key) == outcome.draw for key, outcome in self._outcomes.items()):
                self.notes += (
                    f"{description} was damaged, and is written anew: the flights are of this study",
                )
                return
            raise UsageError(
                f"{description} is damaged, and the flights beside it are not of this study. Give the study that they "
                "were flown for, or choose another folder."
            ) from None
        if not _same(content, study):
            raise UsageError(
                f"{description.parent} holds another study. Choose another folder, or give --force to replace it."
            )


def _outcomes(log: LineLog, path: Path) -> tuple[list[Outcome], tuple[str, ...]]:
    """What is there, and a note on what was torn: such flights are flown again."""
    found, torn = [], int(log.torn)
    for line in log.lines():
        try:
            found.append(Outcome.model_validate_json(line))
        except ValidationError as error:
            first = error.errors()[0]
            if first["type"] != "json_invalid":
                raise UsageError(
                    f"{path} is not of this version: {first['msg']}. Give --force to fly the study anew."
                ) from None
            torn += 1
    return found, (f"{path}: {torn} torn line(s) dropped; such flights are flown again",) if torn else ()


def _same(before: dict[str, Any], study: StudyConfig) -> bool:
    try:
        flown = StudyConfig.model_validate(before)
    except ValidationError:
        return False
    return flown.model_dump(exclude=_FREE) == study.model_dump(exclude=_FREE)


def results_csv(outcomes: Sequence[Outcome]) -> str:
    """One row for each flight: what was drawn, the verdict, and every hypothesis's probability."""
    names = list(dict.fromkeys(name for outcome in outcomes for name in outcome.probability))
    text = io.StringIO()
    writer = csv.DictWriter(text, [*_row_of_draw(None), *_ROW, *_scores(None, names)], lineterminator="\n")
    writer.writeheader()
    for outcome in outcomes:
        row = {name: getattr(outcome, name) for name in _ROW}
        row["equivalent"] = " ".join(outcome.equivalent)
        writer.writerow({**_row_of_draw(outcome.draw), **row, **_scores(outcome, names)})
    return text.getvalue()


_ROW = (
    "effect_in_plane",
    "effect_out_of_plane",
    "status",
    "first",
    "winner",
    "equivalent",
    "reason",
    "alpha_sigma_rad",
    "phi_w_sigma_rad",
    "seconds",
)


def _row_of_draw(draw: Draw | None) -> dict[str, Any]:
    return dict.fromkeys(Draw.model_fields) if draw is None else draw.model_dump()


def _scores(outcome: Outcome | None, names: Sequence[str]) -> dict[str, float | None]:
    return {
        f"{score}_{name}": None if outcome is None else getattr(outcome, score).get(name)
        for name in names
        for score in ("probability", "information")
    }
