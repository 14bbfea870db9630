"""A model of the moments and of the records' errors, as a value that adds with +, and as its file.

`Model` holds mechanisms with their regressors, and components of record effects with the values that were taken out.
`SavedModel` is its file: what is declared, found and described, with values, errors and covariance, in YAML that a
person can read and edit (`trace --write-model`), or in the JSON of a trace, which holds the same. `Model.saved` and
`restored` lead from one to the other; `read_model` reads the file.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from hashlib import sha256
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field, InstanceOf, ValidationError, field_validator, model_validator

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.errors import UnanswerableError, UsageError
from brv_hypo.flight.record import Flight
from brv_hypo.io.mappings import read_mapping
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect, TimeVariation, current_name
from brv_hypo.mechanisms.registry import find, find_installed, nuisance_mechanisms
from brv_hypo.mechanisms.yaml_mechanism import MechanismFile, YamlMechanism, mechanism_of
from brv_hypo.model.aero_table import AeroTable, TableIncrements, TableSlope
from brv_hypo.model.baseline import PitchDamping, SlopeSchedule, StaticBend, StaticMoment
from brv_hypo.model.term import Regressor, TimeBasis, delays_among, term_column
from brv_hypo.motion.motion import Motion
from brv_hypo.settings import problems_of

TOLERATED = (TableIncrements.name, SlopeSchedule.name, StaticBend.name)
"""What the baseline may be more, within a prior: columns of a saved model, unknowns of a fit."""
_EXPECTED = "a model: what `trace --write-model` or `trace --json` wrote"


class Applied(BaseModel):
    """A component of a record effect that the model holds, with the value that was taken out of one flight's record."""

    model_config = ConfigDict(frozen=True)

    effect: InstanceOf[RecordEffect]
    component: str
    units: str
    size: float
    value: float
    flight: int = 0


class Model(BaseModel):
    """What explains the flights: regressors of mechanisms, and components of record effects, `added` in that order."""

    model_config = ConfigDict(frozen=True)

    mechanisms: dict[str, InstanceOf[Mechanism]] = {}
    columns: tuple[InstanceOf[Regressor], ...] = ()
    applied: tuple[Applied, ...] = ()
    added: tuple[str, ...] = ()

    def __add__(self, more: Model) -> Model:
        return Model(
            mechanisms={**self.mechanisms, **more.mechanisms},
            columns=(*self.columns, *more.columns),
            applied=(*self.applied, *more.applied),
            added=(*self.added, *more.added),
        )

    def but(self, **changes: Any) -> Model:
        """The same with other fields."""
        return self.model_copy(update=changes)

    def having(self, *mechanisms: Mechanism) -> Model:
        """The same with further mechanisms, of which it has no regressors yet."""
        return self + Model(mechanisms={each.name: each for each in mechanisms})

    def with_terms(self, mechanism: Mechanism, motion: Motion, flights: Sequence[int | None] = (None,)) -> Model:
        """The same with all terms of a mechanism throughout the record, of each of some flights or (None) of all."""
        terms = mechanism.terms(motion, {})
        columns = tuple(term_column(mechanism, term, flight=number) for number in flights for term in terms)
        return self + Model(mechanisms={mechanism.name: mechanism}, columns=columns)

    def without(self, names: Sequence[str]) -> Model:
        """The model without the moments of these effects."""
        return self.but(
            mechanisms={name: mechanism for name, mechanism in self.mechanisms.items() if name not in names},
            columns=tuple(column for column in self.columns if column.mechanism not in names),
            added=tuple(name for name in self.added if name not in names),
        )

    @property
    def lasting(self) -> BoolArray:
        """Which columns do not belong to the times of one record, and mean the same on another (columns,)."""
        own = (each for each in self.mechanisms.values() if isinstance(each, YamlMechanism))
        timed = {(each.name, term.name) for each in own for term in each.definition if term.follows_time}
        constant = (c.time_basis.kind == "constant" and (c.mechanism, c.term) not in timed for c in self.columns)
        return np.fromiter(constant, dtype=bool)

    def tolerated(self, flight: Flight) -> tuple[Mechanism, ...]:
        """Mechanisms whose coefficients have a prior on this flight: of its vehicle, or the baseline; not free ones."""
        free = {column.mechanism for column in self.columns if column.flight is None}
        own = (self.mechanisms[name] for name in TOLERATED if name in self.mechanisms)
        return tuple(mechanism for mechanism in (*nuisance_mechanisms(flight), *own) if mechanism.name not in free)

    def saved(self) -> SavedModel:
        """The model as data, without coefficients."""
        static, table, schedule, bend = (
            self.mechanisms.get(each.name) for each in (StaticMoment, TableSlope, SlopeSchedule, StaticBend)
        )
        return SavedModel(
            columns=tuple(SavedColumn.of(column) for column in self.columns),
            static=static if isinstance(static, StaticMoment) and static.by == "mach" else None,
            table=table.table if isinstance(table, TableSlope) else None,
            schedule=schedule if isinstance(schedule, SlopeSchedule) else None,
            bend=bend if isinstance(bend, StaticBend) else None,
            record=tuple(SavedRecordError.of(applied) for applied in self.applied),
            files=tuple(
                MechanismFile(name=m.name, title=m.title, claims=m.claims, source=m.source, terms=m.definition)
                for m in self.mechanisms.values()
                if isinstance(m, YamlMechanism)
            ),
        )


# ---- Its file ----


class _Saved(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True, use_attribute_docstrings=True)


class SavedColumn(_Saved):
    """A column of the moment model."""

    mechanism: str = Field(description="name")
    term: str = Field(description="coefficient")
    units: str = Field(description="of `value`")
    theta: dict[str, float] = Field(default={}, description="nonlinear parameters")
    kind: TimeVariation = Field(default="constant", description="constant, jump or ramp")
    start: float | None = Field(default=None, description="s; null: from the first sample")
    stop: float | None = Field(default=None, description="s; null: to the last")
    grouped: bool = Field(default=False, alias="tied", description="enters with the columns of its vector")
    part_of: str | None = Field(default=None, description="hypothesis that it is a part of")
    value: float | None = Field(default=None, description="of the coefficient; null: the model is a structure alone")
    std_error: float | None = Field(default=None, description="1 sigma")
    time_errors: dict[str, float] = Field(default={}, description="1 sigma of theta, `knot` and `onset width`")
    elsewhere: float | None = Field(default=None, exclude=True)  # of earlier files: read, and not used
    flight: int | None = Field(default=None, description="of several, counted from 0; null: all")

    _SHARED: ClassVar[tuple[str, ...]] = ("mechanism", "term", "units", "grouped", "part_of", "flight")

    @field_validator("term")
    @classmethod
    def _earlier_name(cls, term: str) -> str:
        return current_name(term)

    @classmethod
    def of(cls, column: Regressor) -> SavedColumn:
        """The column as data."""
        shared: dict[str, Any] = {name: getattr(column, name) for name in cls._SHARED}
        basis = column.time_basis
        start, stop = (end if math.isfinite(end) else None for end in (basis.start, basis.stop))
        return cls(**shared, theta=dict(column.theta), kind=basis.kind, start=start, stop=stop)

    def regressor(self, mechanism: Mechanism) -> Regressor:
        """The column that the data hold."""
        start = -math.inf if self.start is None else self.start
        stop = math.inf if self.stop is None else self.stop
        return Regressor(
            theta=tuple(self.theta.items()),
            time_basis=TimeBasis(self.kind, start, stop),
            late_by=delays_among(mechanism.parameters()),
            **{name: getattr(self, name) for name in self._SHARED},
        )


class ModelError(_Saved):
    """What the model leaves beyond the noise on stretches held out of its fit."""

    mach: tuple[float, ...] = Field(default=(), description="increasing; empty: one value for all")
    own: tuple[float, ...] = Field(description="1 sigma of either coefficient, whole model")
    # Of earlier files: read, and not used.
    elsewhere: tuple[float, ...] = Field(default=(), exclude=True, description="not used")

    @model_validator(mode="after")
    def _sizes_fit(self) -> ModelError:
        wanted = max(len(self.mach), 1)
        if len(self.own) != wanted:
            raise ValueError(
                f"the model's error has {len(self.own)} values for {len(self.mach)} Mach numbers, expected {wanted}: "
                "change both together, or drop it"
            )
        if any(b <= a for a, b in pairwise(self.mach)):
            raise ValueError("the Mach numbers of the model's error must increase")
        return self

    def at(self, mach: FloatArray) -> FloatArray:
        """Its 1-sigma (n,) at the Mach numbers of a flight (n,); where these are unknown, the rms of all."""
        values = np.array(self.own)
        whole = float(np.sqrt(np.mean(values**2)))
        if not self.mach:
            return np.full(mach.shape, whole)
        known = np.isfinite(mach)
        return np.where(known, np.sqrt(np.interp(np.where(known, mach, self.mach[0]), self.mach, values**2)), whole)


class SavedRecordError(_Saved):
    """A component of a record effect with its value on one flight."""

    effect: str = Field(description="name")
    component: str = Field(description="of the effect")
    value: float = Field(description="SI")
    options: dict[str, Any] = Field(default={}, description="of the effect, as its time")
    flight: int = Field(default=0, description="counted from 0")

    @classmethod
    def of(cls, applied: Applied) -> SavedRecordError:
        """The component as data."""
        own = applied.model_dump(include={"component", "value", "flight"})
        return cls(effect=applied.effect.name, options=applied.effect.model_dump(), **own)

    def applied(self, flight: Flight) -> Applied:
        """The component as it is taken out of a flight's record; UsageError where nothing installed has it."""
        item = find_installed(self.effect)
        if not isinstance(item, RecordEffect):
            raise UsageError(
                f"the model takes '{self.effect}' out of the record, but that is a mechanism. Trace the flight anew."
            )
        try:
            effect = type(item).model_validate({**item.model_dump(), **self.options})
        except ValidationError as wrong:
            raise UsageError(f"the model's options of '{self.effect}': {problems_of(wrong)}") from None
        found = {each.name: each for each in effect.components(flight)}
        if self.component not in found:
            holds = f"the model holds '{self.component}' of '{self.effect}', which has {', '.join(found)}"
            raise UsageError(f"{holds}. Trace the flight anew.")
        name, units, size = found[self.component]
        return Applied(effect=effect, component=name, units=units, size=size, value=self.value, flight=self.flight)


def digest(flight: Flight) -> str:
    """SHA-256 of a record's times and gyros, by which a model knows the records that it was estimated from."""
    return sha256(np.stack([flight.time, flight.p, flight.q, flight.r]).tobytes()).hexdigest()


class SavedModel(_Saved):
    """Moment columns, errors of the record, and the files of mechanisms that no plugin holds."""

    format: Literal["brv-model"] = Field(default="brv-model", description="`brv-model`")
    format_version: Literal[1] = Field(default=1, description="1")
    columns: tuple[SavedColumn, ...] = Field(description="of the moment model")
    record: tuple[SavedRecordError, ...] = Field(default=(), description="effects of the record that were added")
    files: tuple[MechanismFile, ...] = Field(default=(), description="mechanisms that no plugin holds")
    static: StaticMoment | None = Field(default=None, description="the baseline's static moment; null: constant")
    table: AeroTable | None = Field(default=None, description="aerodynamic table in its place")
    schedule: SlopeSchedule | None = Field(default=None, description="prior of the slope's change with Mach number")
    bend: StaticBend | None = Field(default=None, description="prior of its bend with alpha")
    covariance: tuple[tuple[float, ...], ...] = Field(default=(), description="of the coefficients; empty: unknown")
    of_processes: tuple[tuple[float, ...], ...] = Field(default=(), description="part of it that processes make")
    covariance_elsewhere: tuple[tuple[float, ...], ...] = Field(default=(), exclude=True)  # of earlier files, the same
    error: ModelError | None = Field(default=None, description="what it left beyond the noise")
    found_on: tuple[str, ...] = Field(default=(), description="titles of its flights")
    times: tuple[tuple[float, float], ...] = Field(default=(), description="start and stop of each, s")
    digests: tuple[str, ...] = Field(default=(), description="of their gyros")
    errors: tuple[SavedRecordError, ...] = Field(default=(), description="of record and vehicle, within tolerances")
    flown: dict[str, tuple[float, float]] = Field(default={}, description="ends of `mach` and `alpha` (rad) flown")

    @model_validator(mode="after")
    def _covariance_fits(self) -> SavedModel:
        for matrix in (self.covariance, self.of_processes if self.covariance else ()):
            if matrix and {len(matrix), *(len(row) for row in matrix)} != {len(self.columns)}:
                raise ValueError(
                    f"covariance has {len(matrix)} rows for {len(self.columns)} columns: change both together, or drop "
                    "it, so that the columns' own std_error count"
                )
        return self

    def with_coefficients(self, values: FloatArray, covariance: FloatArray, of_processes: FloatArray) -> SavedModel:
        """With coefficients (columns,), their covariance, and the part of it that processes make."""
        errors = np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist()
        known = zip(self.columns, values.tolist(), errors, strict=True)
        columns = tuple(each.model_copy(update={"value": value, "std_error": error}) for each, value, error in known)
        both = {"covariance": covariance.tolist(), "of_processes": of_processes.tolist()}
        return self.model_copy(update={"columns": columns, **{k: tuple(map(tuple, each)) for k, each in both.items()}})

    @property
    def known_covariance(self) -> tuple[FloatArray, FloatArray]:
        """That of the columns' coefficients, by their errors alone where there is none; and without processes."""
        errors = np.array([column.std_error or 0.0 for column in self.columns])
        whole = np.array(self.covariance) if self.covariance else np.diag(errors**2)
        return whole, whole - np.array(self.of_processes) if self.covariance and self.of_processes else whole

    def of_as_many(self, flights: int) -> SavedModel:
        """The model without what belongs to single flights, unless it was found on as many."""
        return self if max(len(self.found_on), 1) == flights else self._with(None)

    def of_flight(self, number: int) -> SavedModel:
        """The model as that of one of its flights alone, with all that belongs to it."""
        own = {name: getattr(self, name)[number : number + 1] for name in ("found_on", "times", "digests")}
        return self._with(number).model_copy(update=own)

    def _with(self, number: int | None) -> SavedModel:
        """With what all flights share, and what belongs to one of them where there is a number."""
        kept = [k for k, column in enumerate(self.columns) if column.flight in (None, number)]
        covariance, of_processes = (
            tuple(tuple(matrix[j][k] for k in kept) for j in kept if matrix)
            for matrix in (self.covariance, self.of_processes)
        )
        columns = tuple(self.columns[k].model_copy(update={"flight": None}) for k in kept)
        record, errors = (
            tuple(each.model_copy(update={"flight": 0}) for each in every if each.flight == number)
            for every in (self.record, self.errors)
        )
        found = {"columns": columns, "record": record, "errors": errors, "covariance": covariance}
        return self.model_copy(update={**found, "of_processes": of_processes})


def constant_moment(flights: Sequence[Flight]) -> StaticMoment:
    """The static moment of constant coefficients."""
    start, stop = min(float(flight.time[0]) for flight in flights), max(float(flight.time[-1]) for flight in flights)
    return StaticMoment(start=start, stop=stop, offset_degree=0, slope_degree=0)


def restored(content: SavedModel, flights: Sequence[Flight], *, frozen: bool = False) -> Model:
    """The model that the data hold, for these flights. What belongs to one of several flights stays with it where as
    many are given, and is left out elsewhere; of one flight's model, each of several has its own of what belongs to a
    vehicle or to times of a record. Increments to a table, a schedule's terms and the static moment's bend are columns
    where the model is `frozen`; else they are estimated anew, within their priors. Raises UsageError where a mechanism
    or an effect is not installed, or has no such term, component or option, and UnanswerableError where the static
    moment follows a Mach number that a record lacks.
    """
    by_mach = content.table or content.schedule or (content.static is not None and content.static.by == "mach")
    if by_mach and any(flight.mach is None for flight in flights):
        raise UnanswerableError(
            "a record has no Mach number, which the model's static moment follows. Add mach or altitude to it, or "
            "trace the model's flight with `baseline: constant`."
        )
    content = content.of_as_many(len(flights))
    files = {file.name: mechanism_of(file) for file in content.files}
    table = () if content.table is None else (TableSlope(table=content.table), TableIncrements(table=content.table))
    own = (content.static or constant_moment(flights), PitchDamping(), *table, content.schedule, content.bend)
    known: dict[str, Mechanism] = {mechanism.name: mechanism for mechanism in own if mechanism is not None}
    names = dict.fromkeys(c.mechanism for c in content.columns if c.mechanism not in known)
    known |= {name: files[name] if name in files else find(name) for name in names}
    applied = tuple(error.applied(flights[error.flight]) for error in content.record)
    columns = list[Regressor]()
    for column in content.columns:
        mechanism = known[column.mechanism]
        found = column.regressor(mechanism)
        if frozen or column.mechanism not in TOLERATED:
            many = len(flights) > 1 and found.flight is None
            apart = many and (found.time_basis.kind != "constant" or mechanism.of_each_flight(flights[0]))
            numbers = range(len(flights)) if apart else [found.flight]
            columns += [replace(found, flight=number) for number in numbers]
    return Model(
        mechanisms={mechanism.name: mechanism for mechanism in known.values()},
        columns=tuple(columns),
        applied=applied,
        added=(*names, *dict.fromkeys(a.effect.name for a in applied)),
    )


def read_model(path: Path) -> SavedModel:
    """The model in a file; raises UsageError where it holds none, or one without coefficients."""
    model = read_structure(path)
    if not model.columns or any(column.value is None for column in model.columns):
        raise UsageError(
            f"the model in {path} holds no coefficients, which a prediction needs. Trace its flight anew with "
            "--write-model or --json, or give every column its value."
        )
    return model


def read_structure(path: Path) -> SavedModel:
    """The model in a file, with coefficients or without. Raises UsageError where the file holds none."""
    content = read_mapping(path, _EXPECTED)
    if content.get("schema") == "brv-hypo/compare/1":
        raise UsageError(f"{path} is a comparison, which holds no model; `brv-hypo trace --model {path}` finds one.")
    try:
        own = content.get("format") == "brv-model"  # else a trace's JSON
        return SavedModel.model_validate(content if own else content["model"]["definition"])
    except ValidationError as error:
        raise UsageError(f"{path} is not {_EXPECTED}: {problems_of(error)}.") from None
    except (KeyError, TypeError) as error:
        raise UsageError(f"{path} holds no model ({type(error).__name__}: {error}); expected {_EXPECTED}.") from None


def model_text(model: SavedModel) -> str:
    """The model as YAML; what is at its default is left out."""
    data = model.model_dump(mode="json", exclude_defaults=True, by_alias=True)
    header = {"format": model.format, "format_version": model.format_version}
    return yaml.safe_dump({**header, **data}, sort_keys=False, width=110, default_flow_style=None)
