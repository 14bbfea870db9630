"""Which instrument errors the data ask for: a score test on one Gauss-Newton step of the model with all of
them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.identification.instruments import InstrumentError, of_flight
from brv_hypo.identification.problem import Instrument, Problem
from brv_hypo.identification.result import Evidence
from brv_hypo.likelihood import FitResult

Group = tuple[str, int]


def wanted_instruments(
    problem: Problem, base: FitResult
) -> tuple[tuple[Instrument, ...], tuple[Evidence, ...]]:
    """The instrument errors to add to a converged model, and what was found out about each group.

    Forward selection: the group that raises twice the log-likelihood most beyond k ln n is added, until none
    rises by `evidence` more (Bayesian information criterion with a margin for the number of groups tried).
    Coloured residuals count for as many fewer samples as they inflate the variances of the model's
    parameters.
    """
    groups = _groups(problem)
    if not groups:
        return (), ()
    everything = problem.with_instruments([i for members in groups.values() for i in members])
    step = everything.warm(base).solve(noise=base.innovation_covariance, max_iterations=1)
    if not step.history or not np.all(np.isfinite(step.covariance)):
        return (), ()
    names = {
        group: [of_flight(error.name, flight) for error, flight in members]
        for group, members in groups.items()
    }
    inflation = variance_inflation(base)
    gain = _Gain(step, {**everything.theta, **base.theta}, base.names)
    each = np.log(base.samples / inflation)
    added: list[Group] = []
    evidence: dict[Group, Evidence] = {}
    while len(added) <= problem.config.most_added:
        tried = {}
        for group in groups:
            if group not in added:
                rise = gain([n for g in (*added, group) for n in names[g]]) - gain(
                    [n for g in added for n in names[g]]
                )
                needed = len(names[group]) * each + problem.config.evidence
                tried[group] = Evidence(*group, rise / inflation, needed, False)
        evidence |= tried
        best = max(tried, key=lambda group: tried[group].gain - tried[group].needed, default=None)
        if best is None or tried[best].gain <= tried[best].needed or len(added) == problem.config.most_added:
            break
        added.append(best)
        evidence[best] = Evidence(*best, tried[best].gain, tried[best].needed, True)
    return tuple(i for group in added for i in groups[group]), tuple(evidence.values())


def variance_inflation(fit: FitResult) -> float:
    """How much coloured residuals inflate variances: median over the parameters, at least 1; 1 where they are
    white.
    """
    if all(test.white for test in fit.whiteness):
        return 1.0
    ratio = [
        (fit.std_error_coloured[name] / fit.std_error[name]) ** 2
        for name in fit.names
        if fit.std_error[name] > 0.0
    ]
    return max(1.0, float(np.nanmedian(ratio))) if ratio else 1.0


def _groups(problem: Problem) -> dict[Group, list[Instrument]]:
    found: dict[Group, list[Instrument]] = {}
    for error in _candidates(problem):
        for flight in problem.flights:
            found.setdefault((error.group, flight), []).append((error, flight))
    return found


def _candidates(problem: Problem) -> Sequence[InstrumentError]:
    from brv_hypo.identification.instruments import INSTRUMENT_ERRORS

    present = {error.group for error, _ in problem.instruments}
    return [e for e in INSTRUMENT_ERRORS if e.group in problem.config.offered() and e.group not in present]


class _Gain:
    """Rise of twice the log-likelihood when some candidates join the base, to second order."""

    def __init__(self, step: FitResult, start: Mapping[str, float], base: Sequence[str]) -> None:
        scale = np.sqrt(np.diag(step.covariance))
        self.information = np.linalg.inv(step.covariance / np.outer(scale, scale))
        moved = np.array([step.theta[name] - start[name] for name in step.names]) / scale
        self.gradient = self.information @ moved / step.history[-1].fraction
        self.index = {name: i for i, name in enumerate(step.names)}
        self.base = [self.index[name] for name in base]

    def __call__(self, names: Sequence[str]) -> float:
        chosen = [*self.base, *(self.index[name] for name in names)]
        information: FloatArray = self.information[np.ix_(chosen, chosen)]
        gradient = self.gradient[chosen]
        return float(gradient @ np.linalg.lstsq(information, gradient, rcond=1e-12)[0])
