"""The baseline that a trace starts from: constant coefficients, a stiffness by Mach number, or a user's table."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.polynomial import Polynomial

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UnanswerableError
from brv_hypo.flight.record import Flight
from brv_hypo.inference.build import baseline_columns
from brv_hypo.linearisation.channels import first_values
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.model.aero_table import TableIncrements, TableSlope
from brv_hypo.model.baseline import PitchDamping, SlopeSchedule, StaticBend, StaticMoment, wavering_speeds
from brv_hypo.model.model import Model, constant_moment
from brv_hypo.model.term import term_column
from brv_hypo.motion.motion import Motion
from brv_hypo.tracing.fit import Corrected, Flights, correct
from brv_hypo.tracing.result import Baseline

# Revised on seeds 171100 to 174044 of `tests.studies.independent.loop_study`, and held by its fresh ones; the prior of
# the schedule is judgement about bodies, after results on the measured entry were known.
SCHEDULE_RELATIVE = 1.0  # 1-sigma of the slope's change within a doubling of the Mach number, over its mean
TRACED_SLOPE_DEGREE = 2  # of the scheduled stiffness in Mach number
TRACED_SPAN = (0.5, 99.5)  # percentiles that a quantity runs between
TRACED_SMALLEST_SPAN = 0.01  # of its greatest value; narrower, the polynomial is next to a constant
TRACED_INDEPENDENT = 0.1  # decades (rms) by which Reynolds number has to leave a smooth function of Mach number
TRACED_SMOOTH_DEGREE = 3  # of that function


def start_model(source: Flights, mechanisms: Sequence[Mechanism] = (), baseline: Baseline = "constant") -> Model:
    """The columns of the baseline: constant coefficients, a stiffness that follows Mach and Reynolds number, or that of
    a table; and, without columns, further mechanisms and what its static moment may be more. That is a bend that a body
    with its slope may have, unless a table by angle of attack or a column has it, and a schedule where it follows Mach
    number. Raises UnanswerableError where a record has no Mach number at which a table could be read.
    """
    flights, aero = source.records, source.config.aero
    table = () if aero is None else (TableSlope(table=aero), TableIncrements(table=aero))
    if table and any(flight.mach is None or not np.all(np.isfinite(flight.mach)) for flight in flights):
        raise UnanswerableError(
            "a record has no Mach number, at which an aerodynamic table is read. Add mach or altitude to it."
        )
    static = static_moment(flights, "constant" if table else baseline)
    model = Model().having(static, PitchDamping(), *table, *mechanisms)
    data = correct(source, model)
    columns, motion = baseline_columns(data.frame), data.frame.motions[0]
    if table:  # in place of a slope of its own
        (term,) = table[0].terms(motion, {})
        columns = tuple(column for column in columns if not column.term.startswith("C_malpha"))
        columns = (*columns, term_column(table[0], term))
    model = model.but(columns=columns)
    slope, bends = _slope(model, data), any(is_bend(mechanism, motion) for mechanism in model.mechanisms.values())
    if slope is not None and not bends and (aero is None or len(aero.alpha) < 2):
        model = model.having(StaticBend(slope=slope))
    return scheduled(model, data) if has_schedule(model) else model


def static_moment(flights: Sequence[Flight], baseline: Baseline) -> StaticMoment:
    """The static moment of a baseline; constant where the records' Mach number is missing or hardly changes."""
    mach = _span([flight.mach for flight in flights]) if baseline == "scheduled" else None
    if mach is None:
        return constant_moment(flights)
    decades = _span([None if flight.reynolds is None else np.log10(flight.reynolds) for flight in flights])
    if decades is not None:  # a smooth function of Mach number is no quantity of its own
        x, y = (np.concatenate([np.log10(getattr(each, name)) for each in flights]) for name in ("mach", "reynolds"))
        if np.std(y - Polynomial.fit(x, y, TRACED_SMOOTH_DEGREE)(x)) <= TRACED_INDEPENDENT:
            decades = None
    # Where Mach number hardly changes, the temperature of the air moves it as much as the speed, and a slope that goes
    # with the conditions of flight is no function of it alone.
    narrow = not SlopeSchedule(low=mach[0], high=mach[1], size=1.0).sizes.size
    histories = [(flight.mach, flight.velocity) for flight in flights if flight.mach is not None]
    return StaticMoment(
        start=mach[0],
        stop=mach[1],
        offset_degree=0,
        slope_degree=TRACED_SLOPE_DEGREE,
        by="mach",
        reynolds=decades,
        speeds=wavering_speeds(histories, TRACED_SLOPE_DEGREE) if narrow else None,
    )


def _span(histories: Sequence[FloatArray | None]) -> tuple[float, float] | None:
    """The ends of what a quantity runs through on all flights; None where it is missing or hardly changes."""
    known = [values for values in histories if values is not None and np.all(np.isfinite(values))]
    if len(known) < len(histories):
        return None
    low, high = np.percentile(np.concatenate(known), TRACED_SPAN)
    return (float(low), float(high)) if high - low > TRACED_SMALLEST_SPAN * abs(high) else None


# ---- What its static moment may be more, within a prior ----


def has_schedule(model: Model) -> bool:
    """Whether the static moment follows Mach number, by itself or by a table."""
    static = model.mechanisms.get(StaticMoment.name)
    own = isinstance(static, StaticMoment) and static.by == "mach"
    return own or bool(model.mechanisms.keys() & {TableIncrements.name, SlopeSchedule.name, TableSlope.name})


def is_bend(mechanism: Mechanism, motion: Motion) -> bool:
    """Whether a mechanism claims the very moment that the baseline's bend is, under whatever name."""
    if mechanism.time_variation != ("constant",) or mechanism.parameters():
        return False
    terms, (own,) = mechanism.terms(motion, {}), StaticBend(slope=1.0).terms(motion, {})
    return len(terms) == 1 and all(
        np.allclose(getattr(terms[0], part), getattr(own, part), atol=0.0) for part in ("in_plane", "out_of_plane")
    )


def scheduled(model: Model, data: Corrected) -> Model:
    """The model with a smooth schedule of its slope by Mach number beside the coarse one that its columns have."""
    mach = _span([flight.mach for flight in data.flights])
    slope = None if mach is None or TableSlope.name in model.mechanisms else _slope(model, data)
    if mach is None or slope is None:
        return model
    schedule = SlopeSchedule(low=mach[0], high=mach[1], size=SCHEDULE_RELATIVE * abs(slope))
    return model.having(schedule) if schedule.sizes.size else model


def _slope(model: Model, data: Corrected) -> float | None:
    """The static slope (1/rad) of the columns, or of the table in its place, on the whole record."""
    table = model.mechanisms.get(TableSlope.name)
    if isinstance(table, TableSlope):
        return float(np.mean(table.table.slope))
    static = model.mechanisms.get(StaticMoment.name)
    if not isinstance(static, StaticMoment):
        return None
    pairs = zip(model.columns, first_values(data.frame, data.whole, model.columns).tolist(), strict=True)
    by_term = {column.term: value for column, value in pairs if column.mechanism == static.name}
    return static.mean_slope(data.frame.motions[0], by_term) if by_term else None
