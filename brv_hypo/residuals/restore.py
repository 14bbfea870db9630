"""Models to data and back: `saved`, `restored`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from pydantic import ValidationError

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect
from brv_hypo.mechanisms.filed import FiledMechanism, MechanismFile, mechanism_of
from brv_hypo.mechanisms.registry import find, find_installed
from brv_hypo.model.aero_table import TableSlope
from brv_hypo.model.baseline import StaticMoment
from brv_hypo.model.columns import Column, delay_name
from brv_hypo.model.slope_schedule import SlopeSchedule
from brv_hypo.model.time_variation import TimeFunction
from brv_hypo.residuals.baseline import TOLERATED, start_model
from brv_hypo.residuals.linearisation import Applied, Model
from brv_hypo.residuals.saved import SavedColumn, SavedModel, SavedRecordError


def saved(
    model: Model,
    values: FloatArray | None = None,
    covariance: FloatArray | None = None,
    found_on: tuple[str, ...] = (),
    flown: dict[str, tuple[float, float]] | None = None,
) -> SavedModel:
    """The model as data, with its coefficients (columns,) and their covariance where they are known."""
    static = model.mechanisms.get(StaticMoment.name)
    table = model.mechanisms.get(TableSlope.name)
    schedule = model.mechanisms.get(SlopeSchedule.name)
    nothing: list[float | None] = [None] * len(model.columns)
    known = nothing if values is None else values.tolist()
    errors = nothing if covariance is None else np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist()
    return SavedModel(
        columns=tuple(_saved_column(*each) for each in zip(model.columns, known, errors, strict=True)),
        covariance=() if covariance is None else tuple(tuple(row) for row in covariance.tolist()),
        static=static if isinstance(static, StaticMoment) and static.by == "mach" else None,
        table=table.table if isinstance(table, TableSlope) else None,
        schedule=schedule if isinstance(schedule, SlopeSchedule) else None,
        found_on=found_on,
        flown=flown or {},
        record=tuple(
            SavedRecordError(
                effect=a.effect.name,
                component=a.component,
                value=a.value,
                options=a.effect.model_dump(),
                flight=a.flight,
            )
            for a in model.applied
        ),
        files=tuple(_file(m) for m in model.mechanisms.values() if isinstance(m, FiledMechanism)),
    )


def restored(content: SavedModel, flights: Sequence[Flight], *, frozen: bool = False) -> Model:
    """The model that the data hold, for these flights.

    What belongs to one of several flights stays with it where as many are given, and is left out elsewhere. Increments
    to a table, and a schedule's terms, are columns where the model is `frozen`; else they are estimated anew, within
    their priors.
    Raises UsageError where a mechanism or an effect is not installed, or has no such term, component or option.
    """
    content = of_as_many(content, len(flights))
    files: Mapping[str, Mechanism] = {file.name: mechanism_of(file) for file in content.files}
    baseline = dict(start_model(flights, (), aero=content.table).mechanisms)
    if content.static is not None:
        baseline[content.static.name] = content.static
    if content.schedule is not None:
        baseline[content.schedule.name] = content.schedule
    names = dict.fromkeys(c.mechanism for c in content.columns if c.mechanism not in baseline)
    own = [files[name] if name in files else find(name) for name in names]
    applied = tuple(_applied(error, flights[error.flight]) for error in content.record)
    known = {**baseline, **{mechanism.name: mechanism for mechanism in own}}
    return Model(
        mechanisms=known,
        columns=tuple(
            column_of(column, known[column.mechanism])
            for column in content.columns
            if frozen or column.mechanism not in TOLERATED
        ),
        applied=applied,
        added=(*names, *dict.fromkeys(a.effect.name for a in applied)),
    )


def of_as_many(content: SavedModel, flights: int) -> SavedModel:
    """The model without what belongs to single flights, unless it was found on as many."""
    if max(len(content.found_on), 1) == flights:
        return content
    kept = [k for k, column in enumerate(content.columns) if column.flight is None]
    return content.model_copy(
        update={
            "columns": tuple(content.columns[k] for k in kept),
            "covariance": tuple(tuple(row[k] for k in kept) for row in (content.covariance[j] for j in kept))
            if content.covariance
            else (),
            "record": () if len(content.found_on) > 1 or flights > 1 else content.record,
        }
    )


def _saved_column(column: Column, value: float | None, std_error: float | None) -> SavedColumn:
    ends = [end if math.isfinite(end) else None for end in (column.course.start, column.course.stop)]
    return SavedColumn(
        mechanism=column.mechanism,
        term=column.term,
        units=column.units,
        theta=dict(column.theta),
        kind=column.course.kind,
        start=ends[0],
        stop=ends[1],
        tied=column.tied,
        value=value,
        std_error=std_error,
        flight=column.flight,
    )


def column_of(column: SavedColumn, mechanism: Mechanism) -> Column:
    """The column that the data hold."""
    start = -math.inf if column.start is None else column.start
    stop = math.inf if column.stop is None else column.stop
    return Column(
        column.mechanism,
        column.term,
        tuple(column.theta.items()),
        TimeFunction(column.kind, start, stop),
        column.units,
        column.tied,
        delay_name(mechanism),
        column.flight,
    )


def _file(mechanism: FiledMechanism) -> MechanismFile:
    return MechanismFile(
        name=mechanism.name,
        title=mechanism.title,
        claims=mechanism.claims,
        source=mechanism.source,
        terms=mechanism.definition,
    )


def _applied(error: SavedRecordError, flight: Flight) -> Applied:
    item = find_installed(error.effect)
    if not isinstance(item, RecordEffect):
        raise UsageError(
            f"the model takes '{error.effect}' out of the record, but that is a mechanism. Trace the flight anew."
        )
    try:
        effect = type(item).model_validate({**item.model_dump(), **error.options})
    except ValidationError as wrong:
        raise UsageError(f"the model sets options that '{error.effect}' refuses: {wrong}") from None
    sizes = {name: (units, size) for name, units, size in effect.components(flight)}
    if error.component not in sizes:
        raise UsageError(
            f"the model holds '{error.component}' of '{error.effect}', which has {', '.join(sizes)}. "
            "Trace the flight anew."
        )
    return Applied(effect, error.component, *sizes[error.component], error.value, error.flight)
