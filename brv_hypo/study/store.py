"""Outcomes on disk: every flight is appended as soon as it is known, so that a study can be interrupted."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from brv_hypo.errors import UsageError
from brv_hypo.study.config import StudyConfig
from brv_hypo.study.draws import Draw
from brv_hypo.study.outcome import Outcome

STUDY, FLIGHTS = "study.json", "flights.jsonl"
# A study may grow by more flights, and its statistics may be drawn otherwise: the flights stay the same.
_FREE = {"title", "flights", "visible_effect"}


class Store:
    """The folder of one study."""

    def __init__(self, folder: Path, study: StudyConfig, *, overwrite: bool = False) -> None:
        """Open or begin; raises UsageError where the folder holds another study, or cannot be written."""
        self._flights = folder / FLIGHTS
        description = folder / STUDY
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if overwrite:
                self._flights.unlink(missing_ok=True)
            elif description.exists() and not _same(description, study):
                raise UsageError(
                    f"{folder} holds another study. Choose another folder, or give --force to replace it."
                )
            description.write_text(study.model_dump_json(indent=2) + "\n", encoding="utf-8")
        except OSError as error:
            raise UsageError(
                f"{folder} cannot be written: {error.strerror}. Choose another folder."
            ) from None
        self._outcomes = {outcome.draw.key: outcome for outcome in self._read()}

    def known(self) -> dict[str, Outcome]:
        """Outcomes by the key of their flight."""
        return dict(self._outcomes)

    def add(self, outcome: Outcome) -> None:
        """Keep an outcome now."""
        self._outcomes[outcome.draw.key] = outcome
        with self._flights.open("a", encoding="utf-8") as stream:
            stream.write(outcome.model_dump_json() + "\n")

    def _read(self) -> list[Outcome]:
        """What is there; the last line may be half written and is then flown again."""
        if not self._flights.exists():
            return []
        text = self._flights.read_text(encoding="utf-8")
        whole = text[: text.rfind("\n") + 1]
        if whole != text:
            self._flights.write_text(whole, encoding="utf-8")
        try:
            return [Outcome.model_validate_json(line) for line in whole.splitlines()]
        except ValidationError as error:
            raise UsageError(
                f"{self._flights} is not of this version: {error.errors()[0]['msg']}. Give --force to "
                "fly the study anew."
            ) from None


def _same(description: Path, study: StudyConfig) -> bool:
    try:
        before = StudyConfig.model_validate_json(description.read_text(encoding="utf-8"))
    except ValidationError:
        return False
    return before.model_dump(exclude=_FREE) == study.model_dump(exclude=_FREE)


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
