"""A traced model as data, from which another trace can start."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, field_validator, model_validator

from brv_hypo.mechanisms.contract import TimeVariation, current_name
from brv_hypo.mechanisms.yaml_mechanism import MechanismFile
from brv_hypo.model.aero_table import AeroTable
from brv_hypo.model.baseline import StaticBend, StaticMoment
from brv_hypo.model.slope_schedule import SlopeSchedule


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
            told = getattr(self, name)
            if told and {len(told), *(len(row) for row in told)} != {len(self.columns)}:
                raise ValueError(
                    f"{name} has {len(told)} rows for {len(self.columns)} columns: change both together, or drop it, "
                    "so that the columns' own std_error count"
                )
        return self
