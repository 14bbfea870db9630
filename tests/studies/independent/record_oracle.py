"""The information of a record on effects planted into it, once its motion and its errors have to be found as well.

The ideal observer knows the motion. A reconstruction does not, and a small slow moment may be the attitude's own
error: the effects' true columns are projected off all that the loop fits along, and off each other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from brv_hypo.flight.record import Flight
from brv_hypo.inference.problem import Problem, given_column
from brv_hypo.linearisation.linear import lengths
from brv_hypo.linearisation.nuisance import on_frame
from brv_hypo.mechanisms import Mechanism, RecordEffect, Term
from brv_hypo.model.baseline import StaticBend
from brv_hypo.model.model import Model
from brv_hypo.model.term import Regressor, TimeBasis
from brv_hypo.motion.motion import Motion
from brv_hypo.tracing import TraceConfig
from brv_hypo.tracing.baseline import start_model
from brv_hypo.tracing.fit import Fit, Flights, converged, correct
from brv_hypo.tracing.result import Baseline
from tests.studies.independent.flights import Made

_PLANTED = "what was planted"


def baseline_state(
    flight: Flight, known: Sequence[Mechanism] = (), baseline: Baseline = "scheduled", bent: bool = True
) -> Fit:
    """The loop's first model on the record, all terms of `known` mechanisms beside it; `bent`: with its bend."""
    source = Flights((flight,), TraceConfig(baseline=baseline))
    model = start_model(source, (), baseline)
    if not bent:
        model = model.without([StaticBend.name])
    motion, always = correct(source, model).frame.motions[0], TimeBasis("constant")
    own = tuple(Regressor(each.name, term.name, (), always, "1") for each in known for term in each.terms(motion, {}))
    return converged(source, model.having(*known) + Model(columns=own))


def f_ratios_in_record(made: Made, baseline: Baseline = "scheduled", bent: bool = True) -> tuple[float, ...]:
    """F of each planted moment beside the others, on the part of the record that the loop fits."""
    problem = baseline_state(made.flight, (_known(made),), baseline, bent).problem
    design, count = problem.design(problem.frame, problem.baseline), made.true.parts.shape[1]
    return tuple(_beyond(design, design.shape[1] - count + k) for k in range(count))


def f_ratio_of_error(state: Fit, effect: RecordEffect, component: str, size: float) -> float:
    """F of an error of an instrument, or of a wind, of this size (SI)."""
    (change,) = state.linear[0].effects([(effect, component, size)])
    problem = replace(state.problem, given={_PLANTED: on_frame(state.problem.frame, 0, change)})
    return _beside_baseline(problem, problem.design(problem.frame, [given_column(_PLANTED)])[:, 0])


def f_ratio_of_moment(state: Fit, mechanism: Mechanism, values: Sequence[float]) -> float:
    """F of a mechanism's terms at these values, throughout."""
    problem, always = state.problem, TimeBasis("constant")
    names = [term.name for term in mechanism.terms(state.data.frame.motions[0], {})]
    columns = [Regressor(mechanism.name, name, (), always, "1") for name in names]
    moment = problem.design(problem.frame.with_mechanisms([mechanism]), columns) @ np.array(values)
    return _beside_baseline(problem, moment)


def _beside_baseline(problem: Problem, column: np.ndarray) -> float:
    design = problem.design(problem.frame, problem.baseline)
    return _beyond(np.column_stack([design, column]), design.shape[1])


def _beyond(design: np.ndarray, place: int) -> float:
    """Squared length of a column beyond all the others."""
    others = np.delete(design, place, axis=1)
    basis = np.linalg.qr(others / lengths(others))[0]
    free = design[:, place] - basis @ (basis.T @ design[:, place])
    return float(free @ free)


def _known(made: Made) -> Mechanism:
    """A mechanism whose terms are the true contributions, each at the size that was planted."""
    true = made.true

    class Known(Mechanism):
        name = "known"
        title = "what was planted"
        claims = "the truth"
        source = "the simulation"
        time_variation = ("constant",)

        def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
            parts = [np.interp(motion.time, true.time, part) for part in true.parts.T]
            return tuple(Term(f"effect {k}", part.real, part.imag) for k, part in enumerate(parts))

    return Known()
