"""How far to go along a step: the merit weighs the objective against violated dynamics."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from brv_hypo.likelihood.step import Iterate, Problem, Step, moved, objective

_HALVINGS = 12
_SUFFICIENT = 1e-4
"""Fraction of the promised decrease that must come true."""


def line_search(
    problem: Problem,
    iterate: Iterate,
    step: Step,
    penalty: float,
    term: Callable[[Iterate], float] | None = None,
) -> tuple[Iterate, float]:
    """Halve the step until the merit falls enough; fraction 0 where it does not.

    The merit is the objective, plus the penalty times the violation, plus a further `term` where there is
    one.
    """
    merit = step.cost + penalty * step.violation + (term(iterate) if term else 0.0)
    slope = step.decrease - penalty * step.violation
    slack = 1e-10 * (1.0 + abs(merit))
    fraction = 1.0
    for _ in range(_HALVINGS):
        trial = moved(problem, iterate, step, fraction)
        with np.errstate(all="ignore"):
            trial_cost, trial_violation = objective(problem, trial)
            trial_merit = trial_cost + penalty * trial_violation + (term(trial) if term else 0.0)
        if np.isfinite(trial_merit) and trial_merit <= merit + _SUFFICIENT * fraction * slope + slack:
            return trial, fraction
        fraction *= 0.5
    return iterate, 0.0
