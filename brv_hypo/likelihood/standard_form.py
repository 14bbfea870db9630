"""Models brought to the standard form of the fit, and results brought back.

A model without states, y = h(u, theta, t) + noise, gets one constant state. Parameters that are functions of others
(constraints) are completed before the functions are called, their derivatives by the chain rule; afterwards they and
their first-order errors join the result.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.likelihood.derivatives import AnalyticJacobian, Function
from brv_hypo.likelihood.result import FitResult
from brv_hypo.likelihood.segment import Segment


def still(x: Any, u: Any, theta: Any, t: Any) -> Any:
    """The dynamics of a state that stands still."""
    return 0.0 * x


def stateless(outputs: Callable[..., Any]) -> Callable[..., Any]:
    """The outputs, the state that stands still kept from them; and from the derivatives that they come with."""

    def observation(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return outputs(x[:0], u, theta, t)

    if not isinstance(outputs, AnalyticJacobian):
        return observation

    def derivatives(x: Any, u: Any, theta: Any, t: Any) -> Any:
        by_state, by_parameter = outputs.derivatives(x[:0], u, theta, t)
        return np.zeros((np.shape(by_state)[0], 1, t.size)), by_parameter

    return AnalyticJacobian(observation, derivatives, outputs.what)


def with_still_state(segments: Sequence[Segment]) -> list[Segment]:
    """The segments of a model without states, with one that stands still at 0.

    Raises:
        UsageError: a segment with states.
    """
    for number, segment in enumerate(segments):
        if np.size(segment.x0):
            raise UsageError(
                f"segment {number}: x0 has shape {np.shape(segment.x0)}, but dynamics is None; expected an empty x0, "
                "such as np.zeros(0), or dynamics"
            )
    return [replace(segment, x0=np.zeros(1), x0_std=0.0) for segment in segments]


def without_still_state(result: FitResult) -> FitResult:
    """The result as the model without states has it."""
    return replace(
        result,
        states=tuple(x[:0] for x in result.states),
        initial_state_std_error=tuple(error[:0] for error in result.initial_state_std_error),
        process_noise=result.process_noise[:0],
        process_noise_std_error=result.process_noise_std_error[:0],
    )


# ---- Constraints among parameters: some are functions of others, with errors that follow from theirs ----


Constraint = Callable[[Mapping[str, Any]], Any]
"""Of the free parameters by name; analytic, if derivatives are to be exact."""

_RELATIVE = 1e-5
"""Central difference for a tie's derivative, against its parameter."""
_STEP = 1e-3
"""Central difference for the errors of constrained parameters, in standard errors."""


def constrained_values(constraints: Mapping[str, Constraint], theta: Mapping[str, Any]) -> dict[str, Any]:
    """The constrained parameters; each may depend on those before it."""
    found: dict[str, Any] = {}
    for name, tie in constraints.items():
        found[name] = tie(dict(theta) | found)
    return found


def with_constraints(function: Function, constraints: Mapping[str, Constraint]) -> Function:
    """The function, its theta completed by the constrained parameters."""
    if not constraints:
        return function

    def complete(theta: Mapping[str, Any]) -> dict[str, Any]:
        return dict(theta) | constrained_values(constraints, theta)

    def completed(x: Any, u: Any, theta: Mapping[str, Any], t: Any, *delayed: Any) -> Any:
        return function(x, u, complete(theta), t, *delayed)

    if not isinstance(function, AnalyticJacobian):
        return completed

    def derivatives(x: Any, u: Any, theta: Mapping[str, Any], t: Any) -> tuple[Any, dict[str, Any]]:
        by_state, found = function.derivatives(x, u, complete(theta), t)
        total = dict(found)
        for name in set(found) & set(theta):
            slopes = _slopes(constraints, theta, name) if np.ndim(theta[name]) == 0 else {}
            through = {constrained: slope for constrained, slope in slopes.items() if slope != 0.0}
            if set(through) <= set(found):
                total[name] = found[name] + sum(found[constrained] * slope for constrained, slope in through.items())
            else:
                del total[name]  # left to differences
        return by_state, total

    return AnalyticJacobian(completed, derivatives, function.what)


def _slopes(
    constraints: Mapping[str, Constraint], theta: Mapping[str, Any], name: str, step: float | None = None
) -> dict[str, float]:
    """Derivatives of the constrained parameters by one that is free."""
    step = step or _RELATIVE * (abs(float(theta[name])) or 1.0)
    up, down = (
        constrained_values(constraints, dict(theta) | {name: theta[name] + sign * step})
        for sign in (1.0, -1.0)
    )
    return {constrained: float(up[constrained] - down[constrained]) / (2.0 * step) for constrained in constraints}


def check_constraints(
    constraints: Mapping[str, Constraint], theta0: Mapping[str, float], per_segment: Collection[str]
) -> None:
    """Refuse constraints that mean nothing.

    Raises:
        UsageError: a constrained parameter that is in theta0 too, a constraint that is not finite there,
        per-segment parameters.
    """
    both = sorted(set(constraints) & set(theta0))
    if both:
        raise UsageError(
            f"constraints name {both}, which theta0 has too; a constrained parameter follows from others: leave it out"
        )
    if constraints and per_segment:
        raise UsageError(
            f"constraints {sorted(constraints)} came together with per_segment {sorted(per_segment)}: a constrained "
            "parameter has one value. Compute it in the dynamics instead"
        )
    known = dict(theta0)
    for name, tie in constraints.items():
        try:
            known[name] = value = float(tie(known))
        except KeyError as missing:
            raise UsageError(
                f"constraint {name!r} needs {missing}, which is neither in theta0 nor constrained before it; expected "
                f"one of {sorted(known)}"
            ) from missing
        if not np.isfinite(value):
            raise UsageError(f"constraint {name!r} is {value} at the start; expected a finite value")


def completed_result(result: FitResult, constraints: Mapping[str, Constraint]) -> FitResult:
    """The result with the constrained parameters in `theta` and both kinds of standard errors, to first order."""
    if not constraints:
        return result
    values = {name: float(value) for name, value in constrained_values(constraints, result.theta).items()}
    rows = _gradients(constraints, result)
    white, coloured = (
        {name: _error(rows[name], covariance) for name in constraints}
        for covariance in (result.covariance, result.covariance_coloured)
    )
    return replace(
        result,
        theta=result.theta | values,
        std_error=result.std_error | white,
        std_error_coloured=result.std_error_coloured | coloured,
    )


def _gradients(constraints: Mapping[str, Constraint], result: FitResult) -> dict[str, FloatArray]:
    """Derivatives of each constrained parameter by the free ones, (p,)."""
    found = {name: np.zeros(len(result.names)) for name in constraints}
    for i, name in enumerate(result.names):
        sigma = result.std_error[name]
        step = _STEP * (sigma if np.isfinite(sigma) and sigma > 0 else max(abs(result.theta[name]), 1.0))
        for constrained, slope in _slopes(constraints, result.theta, name, step).items():
            found[constrained][i] = slope
    return found


def _error(row: FloatArray, covariance: FloatArray) -> float:
    """nan where the tie depends on a parameter without an error."""
    used = row != 0.0
    return float(np.sqrt(row[used] @ covariance[np.ix_(used, used)] @ row[used]))
