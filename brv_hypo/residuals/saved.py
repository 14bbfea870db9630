"""The file of a saved model: `SavedModel`, its schema, read and written as YAML.

The file holds what is declared, found and described, with values, errors and covariance: YAML that a person can read
and edit (`trace --write-model`), or the JSON of a trace, which holds the same.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError, field_validator, model_validator

from brv_hypo.errors import UsageError
from brv_hypo.io.mappings import YAML_ENDINGS, read_json, read_yaml
from brv_hypo.io.text import one_line
from brv_hypo.mechanisms.contract import TimeVariation, current_name
from brv_hypo.mechanisms.yaml_mechanism import MechanismFile
from brv_hypo.model.aero_table import AeroTable
from brv_hypo.model.baseline import SlopeSchedule, StaticBend, StaticMoment


class _Saved(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class SavedColumn(_Saved):
    """A column of the moment model; `start`, `stop` s, None where its course has no such end.

    `value` is its coefficient in `units`, `std_error` its 1-sigma error; None where the model is a structure alone.
    `elsewhere` is the coefficient on other flights, where what belongs to the times and the instruments of the model's
    own is left out; None where it is `value`. `flight`: the one of several flights that it belongs to, counted from 0;
    None for all.
    """

    mechanism: str
    term: str
    units: str
    theta: dict[str, float] = {}
    kind: TimeVariation = "constant"
    start: float | None = None
    stop: float | None = None
    tied: bool = False
    part_of: str | None = None
    value: float | None = None
    std_error: float | None = None
    elsewhere: float | None = None
    flight: int | None = None

    @field_validator("term")
    @classmethod
    def _earlier_name(cls, term: str) -> str:
        return current_name(term)


class ModelError(_Saved):
    """What the model leaves beyond the noise on stretches held out of its fit, 1-sigma of either moment coefficient.

    By Mach number, which increases; without one, one value for all. `own`: the whole model; `elsewhere`: without what
    belongs to the times and the instruments of its own flights.
    """

    mach: tuple[float, ...] = ()
    own: tuple[float, ...]
    elsewhere: tuple[float, ...]

    @model_validator(mode="after")
    def _sizes_fit(self) -> ModelError:
        wanted = max(len(self.mach), 1)
        if (len(self.own), len(self.elsewhere)) != (wanted, wanted):
            raise ValueError(
                f"the model's error has {len(self.own)} and {len(self.elsewhere)} values for {len(self.mach)} Mach "
                f"numbers, expected {wanted}: change all together, or drop it"
            )
        if any(b <= a for a, b in pairwise(self.mach)):
            raise ValueError("the Mach numbers of the model's error must increase")
        return self


class SavedRecordError(_Saved):
    """A component of a record effect with its value (SI) on one flight; `options` are the effect's own, as its time."""

    effect: str
    component: str
    value: float
    options: dict[str, Any] = {}
    flight: int = 0


class SavedModel(_Saved):
    """Moment columns, errors of the record, and the files of mechanisms that no plugin holds.

    `covariance` is that of the columns' coefficients, in their order; empty where they have none.
    `covariance_elsewhere` is that of the coefficients on other flights, 0 for what is left out there; empty where it is
    the same. `static` is the baseline's static moment with its schedule; None for constant coefficients; `table` the
    aerodynamic table that stands in its place, `schedule` the prior of its slope's change with Mach number, `bend` that
    of its bend with the angle of attack. `found_on` names the flights, `times` (s) are their starts and stops; `error`
    is what it left there; `flown` the ends of what they ran through, by quantity (`mach`, `alpha` in rad): beyond, the
    model is known to nobody.
    """

    format: Literal["brv-model"] = "brv-model"
    format_version: Literal[1] = 1
    columns: tuple[SavedColumn, ...]
    record: tuple[SavedRecordError, ...] = ()
    files: tuple[MechanismFile, ...] = ()
    static: StaticMoment | None = None
    table: AeroTable | None = None
    schedule: SlopeSchedule | None = None
    bend: StaticBend | None = None
    covariance: tuple[tuple[float, ...], ...] = ()
    covariance_elsewhere: tuple[tuple[float, ...], ...] = ()
    error: ModelError | None = None
    found_on: tuple[str, ...] = ()
    times: tuple[tuple[float, float], ...] = ()
    flown: dict[str, tuple[float, float]] = {}

    @model_validator(mode="after")
    def _covariance_fits(self) -> SavedModel:
        for name in ("covariance", "covariance_elsewhere"):
            matrix = getattr(self, name)
            if matrix and {len(matrix), *(len(row) for row in matrix)} != {len(self.columns)}:
                raise ValueError(
                    f"{name} has {len(matrix)} rows for {len(self.columns)} columns: change both together, or drop it, "
                    "so that the columns' own std_error count"
                )
        return self


# ---- A whole model as a file: what is declared, found and described, with values, errors and covariance ----


_EXPECTED = "a model: what `trace --write-model` or `trace --json` wrote"


def read_model(path: Path) -> SavedModel:
    """The model in a file, with its coefficients.

    Raises UsageError where the file holds none, or one without coefficients.
    """
    model = read_structure(path)
    if not model.columns or any(column.value is None for column in model.columns):
        raise UsageError(
            f"the model in {path} holds no coefficients, which a prediction needs. Trace its flight anew with "
            "--write-model or --json, or give every column its value."
        )
    return model


def read_structure(path: Path) -> SavedModel:
    """The model in a file, with coefficients or without. Raises UsageError where the file holds none."""
    content = read_yaml(path, _EXPECTED) if path.suffix in YAML_ENDINGS else read_json(path, _EXPECTED)
    try:
        return SavedModel.model_validate(content if is_model(content) else content["model"]["definition"])
    except ValidationError as error:
        said = "; ".join(f"{'.'.join(map(str, e['loc'])) or 'model'}: {e['msg']}" for e in error.errors()[:4])
        raise UsageError(f"{path} is not {_EXPECTED}: {one_line(said)}.") from None
    except (KeyError, TypeError) as error:
        raise UsageError(f"{path} holds no model ({type(error).__name__}: {error}); expected {_EXPECTED}.") from None


def is_model(content: dict[str, Any]) -> bool:
    """Whether a file's content is a model itself."""
    return content.get("format") == "brv-model"


def model_text(model: SavedModel) -> str:
    """The model as YAML; what is at its default is left out."""
    data = model.model_dump(mode="json", exclude_defaults=True)
    header = {"format": model.format, "format_version": model.format_version}
    return yaml.safe_dump({**header, **data}, sort_keys=False, width=110, default_flow_style=None)
