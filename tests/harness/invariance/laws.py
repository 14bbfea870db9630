"""The laws: each draws a change, and gives how far apart the comparisons before and after it are, and may be."""

from __future__ import annotations

import importlib
import math
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import strategies as st
from threadpoolctl import threadpool_limits

from brv_hypo.comparison import CompareConfig, Comparison
from brv_hypo.comparison.result import TermEstimate
from brv_hypo.mechanisms import Mechanism, Term, find
from brv_hypo.motion.motion import Motion
from tests.flight.records import ACCEPTED, UNITS
from tests.harness.invariance.chain import Case, Change, Distance, compared, distance, flight, original
from tests.harness.invariance.changes import NAMES, SI_UNITS, mirrored, rolled, shifted, with_isotropic_errors, written
from tests.harness.last_digit import flight_last_digit_off

NOTHING = Distance(0.0, 0.0)
# Of numbers of 53 bits, where the flight holds what is fitted to it.
ROUNDING = Distance(1e-6, 5e-5)
# The same where the flight does not hold it: knots and delays are hardly known then, and an angle of what is not there
# is anything (3e-4 measured).
UNHELD = Distance(1e-3, 1e-3)
# Where sums are taken in another order, axes are others, columns are scaled, or times begin thousands of seconds later:
# the whole motion, some 10,000 times the noise, is rounded otherwise, and the design makes some hundreds of it.
SUMMED = Distance(1e-4, 1e-3)
# A copy costs the criterion the logarithm of two for each term that may be either.
COPIED = Distance(math.inf, 2.0 * math.log(2.0) * CompareConfig().max_terms + 0.1)
MOST_PARTS = 1e-6  # by which two columns may differ and are called near-dependent

Found = tuple[Distance, Distance]
Law = Callable[[st.DataObject, Case], Found]


def _rounding(case: Case) -> Distance:
    return ROUNDING if case.planted == case.mechanism else UNHELD


def any_units(data: st.DataObject, case: Case) -> Found:
    choices = {name: st.sampled_from(sorted(ACCEPTED[UNITS[name]])) for name in NAMES}
    others = data.draw(st.fixed_dictionaries(choices))
    with tempfile.TemporaryDirectory() as folder:
        plain, converted = (
            written(flight(case), units, Path(folder, f"{k}.h5")) for k, units in enumerate((SI_UNITS, others))
        )
    return distance(compared([plain], case), compared([converted], case)), _rounding(case)


def any_last_digit(data: st.DataObject, case: Case) -> Found:
    off = flight_last_digit_off(flight(case), data.draw(st.integers(0, 1000)))
    return distance(original(case), compared([off], case)), _rounding(case)


def any_origin_of_time(data: st.DataObject, case: Case) -> Found:
    shift = data.draw(st.floats(1e-3, 1e4)) * data.draw(st.sampled_from((-1.0, 1.0)))
    after = compared([shifted(flight(case), shift)], case)
    return distance(original(case), after, Change(shift=shift)), SUMMED


def rolled_axes(data: st.DataObject, case: Case) -> Found:
    angle = data.draw(st.floats(-np.pi, np.pi))
    known = with_isotropic_errors(flight(case))
    before, after = (compared([one], case) for one in (known, rolled(known, angle)))
    return distance(before, after, Change(roll=angle)), SUMMED


def a_mirror(data: st.DataObject, case: Case) -> Found:
    return distance(original(case), compared([mirrored(flight(case))], case), Change(sign=-1.0)), SUMMED


def any_order_of_flights(data: st.DataObject, case: Case) -> Found:
    order = data.draw(st.permutations(range(data.draw(st.integers(2, 3)))))
    # The given order decides nothing: the other way round.
    return reordered(case, order[::-1] if order == sorted(order) else order), SUMMED


def reordered(case: Case, order: Sequence[int]) -> Distance:
    """Of so many flights of the case from those in this order; their seeds follow each other."""
    flights = [flight(replace(case, seed=case.seed + more)) for more in range(len(order))]
    return distance(compared(flights, case), compared([flights[k] for k in order], case))


def any_number_of_threads(data: st.DataObject, case: Case) -> Found:
    with threadpool_limits(limits=data.draw(st.integers(2, 8))):
        after = compared([flight(case)], case)
    return distance(original(case), after), NOTHING


class Rescaled(Mechanism):
    """Columns `size` times those of `damping`, with a copy of the first that is off by `parts` of it."""

    name = "damping"
    title = claims = source = "damping, rescaled"
    size: float = 1.0
    parts: float = 0.0

    def terms(self, motion: Motion, theta: object) -> tuple[Term, ...]:
        terms = find("damping").terms(motion, {})
        off = 1.0 + self.parts * np.cos(3.0 * motion.time)
        copies = (Term("copy", off * terms[0].in_plane, off * terms[0].out_of_plane),) if self.parts else ()
        return tuple(
            Term(term.name, self.size * term.in_plane, self.size * term.out_of_plane) for term in (*terms, *copies)
        )


@cache
def _with_damping(mechanism: Rescaled, case: Case) -> Comparison:
    """The comparison in which `damping` is this mechanism."""
    module = importlib.import_module("brv_hypo.comparison.compare")
    known = module.parse_hypothesis

    def parse(name: str, options: object = None) -> tuple[Mechanism, ...]:
        return (mechanism,) if name == "damping" else known(name, options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "parse_hypothesis", parse)
        return compared([flight(case)], case)


def any_scale_of_columns(data: st.DataObject, case: Case) -> Found:
    size = 10.0 ** data.draw(st.integers(-8, 8))
    case = replace(case, planted="damping", mechanism="damping")
    after = _with_damping(Rescaled(size=size), case)
    rows = [row.model_copy(update={"terms": tuple(_times(term, size) for term in row.terms)}) for row in after.ranking]
    return distance(_with_damping(Rescaled(), case), after.model_copy(update={"ranking": tuple(rows)})), SUMMED


def _times(term: TermEstimate, size: float) -> TermEstimate:
    return term.model_copy(update={"value": term.value * size, "std_error": term.std_error * size})


def near_dependent_columns(data: st.DataObject, case: Case) -> Found:
    """A copy of a column explains nothing more: the same fit, for the price of a longer list."""
    parts = 10.0 ** data.draw(st.floats(-16.0, math.log10(MOST_PARTS)))
    case = replace(case, planted="damping", mechanism="damping")
    return distance(_with_damping(Rescaled(), case), _with_damping(Rescaled(parts=parts), case)), COPIED


LAWS: dict[str, Law] = {
    law.__name__: law
    for law in (
        any_units,
        any_last_digit,
        any_origin_of_time,
        rolled_axes,
        a_mirror,
        any_order_of_flights,
        any_number_of_threads,
        any_scale_of_columns,
        near_dependent_columns,
    )
}
