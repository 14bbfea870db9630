"""A saved model from a fitted one, and a fitted one from it, for other flights: `saved`, `restored`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import ValidationError

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect
from brv_hypo.mechanisms.registry import find, find_installed
from brv_hypo.mechanisms.yaml_mechanism import MechanismFile, YamlMechanism, mechanism_of
from brv_hypo.model.aero_table import TableSlope
from brv_hypo.model.baseline import SlopeSchedule, StaticBend, StaticMoment
from brv_hypo.model.term import Regressor, TimeBasis, delays_among
from brv_hypo.residuals.baseline import TOLERATED, start_model
from brv_hypo.residuals.linearisation import Applied, Model
from brv_hypo.residuals.saved import ModelError, SavedColumn, SavedModel, SavedRecordError


@dataclass(frozen=True)
class Found:
    """What is known of a model: its coefficients (columns,), their covariance, and where they were found.

    `elsewhere` (columns,) are the coefficients on other flights, NaN for columns that belong to these alone, and
    `covariance_elsewhere` is theirs.
    """

    values: FloatArray
    covariance: FloatArray
    elsewhere: FloatArray
    covariance_elsewhere: FloatArray
    error: ModelError
    on: tuple[str, ...]
    times: tuple[tuple[float, float], ...]
    flown: dict[str, tuple[float, float]]


def saved(model: Model, found: Found | None = None) -> SavedModel:
    """The model as data, with what is known of it where it was fitted."""
    static = model.mechanisms.get(StaticMoment.name)
    table = model.mechanisms.get(TableSlope.name)
    schedule, bend = (model.mechanisms.get(each.name) for each in (SlopeSchedule, StaticBend))
    content = SavedModel(
        columns=tuple(_saved_column(column) for column in model.columns),
        static=static if isinstance(static, StaticMoment) and static.by == "mach" else None,
        table=table.table if isinstance(table, TableSlope) else None,
        schedule=schedule if isinstance(schedule, SlopeSchedule) else None,
        bend=bend if isinstance(bend, StaticBend) else None,
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
        files=tuple(
            MechanismFile(name=m.name, title=m.title, claims=m.claims, source=m.source, terms=m.definition)
            for m in model.mechanisms.values()
            if isinstance(m, YamlMechanism)
        ),
    )
    return content if found is None else _with_coefficients(content, found)


def _with_coefficients(content: SavedModel, found: Found) -> SavedModel:
    errors = np.sqrt(np.maximum(np.diag(found.covariance), 0.0))
    known = zip(content.columns, found.values.tolist(), errors.tolist(), found.elsewhere.tolist(), strict=True)
    return content.model_copy(
        update={
            "columns": tuple(
                column.model_copy(
                    update={
                        "value": value,
                        "std_error": error,
                        "elsewhere": elsewhere if math.isfinite(elsewhere) and elsewhere != value else None,
                    }
                )
                for column, value, error, elsewhere in known
            ),
            "covariance": _rows(found.covariance),
            "covariance_elsewhere": ()
            if np.array_equal(found.covariance, found.covariance_elsewhere)
            else _rows(found.covariance_elsewhere),
            "error": found.error,
            "found_on": found.on,
            "times": found.times,
            "flown": found.flown,
        }
    )


def _rows(covariance: FloatArray) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in covariance.tolist())


def restored(content: SavedModel, flights: Sequence[Flight], *, frozen: bool = False) -> Model:
    """The model that the data hold, for these flights.

    What belongs to one of several flights stays with it where as many are given, and is left out elsewhere. Increments
    to a table, a schedule's terms and the static moment's bend are columns where the model is `frozen`; else they are
    estimated anew, within their priors.
    Raises UsageError where a mechanism or an effect is not installed, or has no such term, component or option.
    """
    content = of_as_many(content, len(flights))
    files: Mapping[str, Mechanism] = {file.name: mechanism_of(file) for file in content.files}
    baseline = dict(start_model(flights, (), aero=content.table).mechanisms)
    own_baseline = (content.static, content.schedule, content.bend)
    baseline.update({mechanism.name: mechanism for mechanism in own_baseline if mechanism is not None})
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
            "covariance": _among(content.covariance, kept),
            "covariance_elsewhere": _among(content.covariance_elsewhere, kept),
            "record": () if len(content.found_on) > 1 or flights > 1 else content.record,
        }
    )


def _among(covariance: tuple[tuple[float, ...], ...], kept: Sequence[int]) -> tuple[tuple[float, ...], ...]:
    """Rows and columns that are kept, if there are any."""
    return tuple(tuple(covariance[j][k] for k in kept) for j in kept) if covariance else ()


def _saved_column(column: Regressor) -> SavedColumn:
    ends = [end if math.isfinite(end) else None for end in (column.time_basis.start, column.time_basis.stop)]
    return SavedColumn(
        mechanism=column.mechanism,
        term=column.term,
        units=column.units,
        theta=dict(column.theta),
        kind=column.time_basis.kind,
        start=ends[0],
        stop=ends[1],
        tied=column.grouped,
        part_of=column.part_of,
        flight=column.flight,
    )


def column_of(column: SavedColumn, mechanism: Mechanism) -> Regressor:
    """The column that the data hold."""
    start = -math.inf if column.start is None else column.start
    stop = math.inf if column.stop is None else column.stop
    return Regressor(
        column.mechanism,
        column.term,
        tuple(column.theta.items()),
        TimeBasis(column.kind, start, stop),
        column.units,
        column.tied,
        delays_among(mechanism.parameters()),
        column.flight,
        column.part_of,
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
