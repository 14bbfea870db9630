"""Effects that a model took in before it held what they stood for, and has no need of since."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from brv_hypo.model.term import Regressor
from brv_hypo.regression.fit import HypothesisFit, fit_hypothesis
from brv_hypo.regression.problem import Problem
from brv_hypo.residuals.fitted_model import State
from brv_hypo.residuals.linearisation import Model
from brv_hypo.residuals.problem import with_efficiency


def unneeded(state: State, names: Sequence[str]) -> tuple[str, ...]:
    """Those of the effects whose moments explain less beside all others than their coefficients cost (BIC).

    The least needed is left out first, and the rest asked again. Schedules, which change what the baseline is, and what
    every fit holds within its tolerance are not asked.
    """
    found: list[str] = []
    model = state.model
    while True:
        asked = [name for name in dict.fromkeys(names) if _may_go(name, model, state)]
        problem = with_efficiency(state.problem, _fit(state.problem, model.columns))
        own = _fit(problem, model.columns).information
        costs = {name: _fit(problem, without(model, [name]).columns).information - own for name in asked}
        least = min(costs, key=lambda name: costs[name], default=None)
        if least is None or costs[least] > 0.0:
            return tuple(found)
        found.append(least)
        model = without(model, [least])


def without(model: Model, names: Sequence[str]) -> Model:
    """The model without the moments of these effects."""
    return replace(
        model,
        mechanisms={name: mechanism for name, mechanism in model.mechanisms.items() if name not in names},
        columns=tuple(column for column in model.columns if column.mechanism not in names),
        added=tuple(name for name in model.added if name not in names),
    )


def _may_go(name: str, model: Model, state: State) -> bool:
    mechanism = model.mechanisms.get(name)
    if mechanism is None or mechanism.follows == "mach":
        return False
    return all(mechanism.tolerance(flight) is None for flight in state.seen.flights)


def _fit(problem: Problem, columns: tuple[Regressor, ...]) -> HypothesisFit:
    return fit_hypothesis(replace(problem, baseline=columns), "none", ())
