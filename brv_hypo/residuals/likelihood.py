"""The final model of a trace, refined by maximum likelihood on the measurements themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from brv_hypo.constants import LIKELIHOOD_STEPS, SCHEDULE_TRIFLE
from brv_hypo.identification import IdentificationConfig, identify
from brv_hypo.model.slope_schedule import KnownSlopeSchedule, SlopeSchedule
from brv_hypo.model.term import Regressor, TimeBasis
from brv_hypo.ranking.result import MaximumLikelihood
from brv_hypo.ranking.summary import likelihood_block
from brv_hypo.regression.regressed import Regressed
from brv_hypo.residuals.fitted_model import State
from brv_hypo.residuals.problem import increments
from brv_hypo.residuals.summary import term_estimates

_OPTIONS = IdentificationConfig(max_iterations=LIKELIHOOD_STEPS)


def maximum_likelihood(state: State) -> MaximumLikelihood:
    """The likelihood's block of the result, in the form of `compare`'s; a failure is its status and message.

    On a record that limits the reconstruction the search takes long and seldom ends: it is left out.
    """
    seen, columns = state.seen, state.model.columns
    if len(seen.records) > 1:
        return _left_out("with several flights, terms of a single flight cannot be fitted")
    if seen.reconstructions[0].status == "degraded":
        return _left_out("the reconstruction is limited by the record, and the search would rarely converge")
    values = state.values
    known_schedule = _course(state)
    if known_schedule is not None:
        column = Regressor(known_schedule.name, "C_malpha by the schedule", (), TimeBasis("constant"), "1")
        seen = replace(seen, frame=seen.frame.with_mechanisms([known_schedule]))
        columns, values = (*columns, column), np.append(values, 1.0)
    _, others = state.problem.solution(state.seen.frame, state.model.columns)
    held = {(each.effect.name, each.component): each.value for each in state.model.applied}
    regressed = Regressed.of(state.problem, state.seen.frame, state.model.columns, state.values, others).beside([held])
    found = identify(seen.frame, columns, values, _OPTIONS, regressed=regressed)
    return likelihood_block(found, term_estimates(seen, found.columns, found.values, found.covariance))


def _course(state: State) -> KnownSlopeSchedule | None:
    """What the baseline's slope is more by its schedule, which the likelihood knows no prior of; None for a trifle."""
    schedule = state.model.mechanisms.get(SlopeSchedule.name)
    if not isinstance(schedule, SlopeSchedule):
        return None
    _, others = state.problem.solution(state.seen.frame, state.model.columns)
    more = increments(state.problem, others).items()
    found = schedule.known_schedule(tuple(value for column, value in more if column.mechanism == schedule.name))
    motion = state.seen.reconstructions[0].motion
    own = found.terms(motion, {})[0].in_plane
    slope = sum(v for c, v in zip(state.model.columns, state.values, strict=True) if c.term == "C_malpha")
    return found if np.linalg.norm(own) > SCHEDULE_TRIFLE * abs(slope) * np.linalg.norm(motion.alpha) else None


def _left_out(message: str) -> MaximumLikelihood:
    return MaximumLikelihood(status="left out", iterations=0, log_likelihood=None, message=message)
