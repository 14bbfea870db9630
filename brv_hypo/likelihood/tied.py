"""Constraints among parameters: some are functions of others, with errors that follow from theirs."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.likelihood.derivatives import Function
from brv_hypo.likelihood.given import Given
from brv_hypo.likelihood.result import FitResult

Tie = Callable[[Mapping[str, Any]], Any]
"""Of the free parameters by name; analytic, if derivatives are to be exact."""

_RELATIVE = 1e-5
"""Central difference for a tie's derivative, against its parameter."""
_STEP = 1e-3
"""Central difference for the errors of tied parameters, in standard errors."""


def tied_values(ties: Mapping[str, Tie], theta: Mapping[str, Any]) -> dict[str, Any]:
    """The tied parameters; each may depend on those before it."""
    found: dict[str, Any] = {}
    for name, tie in ties.items():
        found[name] = tie(dict(theta) | found)
    return found


def with_ties(function: Function, ties: Mapping[str, Tie]) -> Function:
    """The function, its theta completed by the tied parameters."""
    if not ties:
        return function

    def complete(theta: Mapping[str, Any]) -> dict[str, Any]:
        return dict(theta) | tied_values(ties, theta)

    def completed(x: Any, u: Any, theta: Mapping[str, Any], t: Any, *delayed: Any) -> Any:
        return function(x, u, complete(theta), t, *delayed)

    if not isinstance(function, Given):
        return completed

    def derivatives(x: Any, u: Any, theta: Mapping[str, Any], t: Any) -> tuple[Any, dict[str, Any]]:
        by_state, found = function.derivatives(x, u, complete(theta), t)
        total = dict(found)
        for name in set(found) & set(theta):
            slopes = _slopes(ties, theta, name) if np.ndim(theta[name]) == 0 else {}
            through = {tied: slope for tied, slope in slopes.items() if slope != 0.0}
            if set(through) <= set(found):
                total[name] = found[name] + sum(found[tied] * slope for tied, slope in through.items())
            else:
                del total[name]  # left to differences
        return by_state, total

    return Given(completed, derivatives, function.what)


def _slopes(
    ties: Mapping[str, Tie], theta: Mapping[str, Any], name: str, step: float | None = None
) -> dict[str, float]:
    """Derivatives of the tied parameters by one that is free."""
    step = step or _RELATIVE * (abs(float(theta[name])) or 1.0)
    up, down = (tied_values(ties, dict(theta) | {name: theta[name] + sign * step}) for sign in (1.0, -1.0))
    return {tied: float(up[tied] - down[tied]) / (2.0 * step) for tied in ties}


def check_ties(ties: Mapping[str, Tie], theta0: Mapping[str, float], per_segment: Collection[str]) -> None:
    """Refuse ties that mean nothing.

    Raises:
        UsageError: a tied parameter that is in theta0 too, a tie that is not finite there, per-segment parameters.
    """
    both = sorted(set(ties) & set(theta0))
    if both:
        raise UsageError(
            f"tied names {both}, which theta0 has too; a tied parameter follows from others: leave it out"
        )
    if ties and per_segment:
        raise UsageError(
            f"tied {sorted(ties)} came together with per_segment {sorted(per_segment)}: a tied parameter has one "
            "value. Compute it in the dynamics instead"
        )
    known = dict(theta0)
    for name, tie in ties.items():
        try:
            known[name] = value = float(tie(known))
        except KeyError as missing:
            raise UsageError(
                f"tied {name!r} needs {missing}, which is neither in theta0 nor tied before it; expected one of "
                f"{sorted(known)}"
            ) from missing
        if not np.isfinite(value):
            raise UsageError(f"tied {name!r} is {value} at the start; expected a finite value")


def completed_result(result: FitResult, ties: Mapping[str, Tie]) -> FitResult:
    """The result with the tied parameters in `theta` and both kinds of standard errors, to first order."""
    if not ties:
        return result
    values = {name: float(value) for name, value in tied_values(ties, result.theta).items()}
    rows = _gradients(ties, result)
    white, coloured = (
        {name: _error(rows[name], covariance) for name in ties}
        for covariance in (result.covariance, result.covariance_coloured)
    )
    return replace(
        result,
        theta=result.theta | values,
        std_error=result.std_error | white,
        std_error_coloured=result.std_error_coloured | coloured,
    )


def _gradients(ties: Mapping[str, Tie], result: FitResult) -> dict[str, FloatArray]:
    """Derivatives of each tied parameter by the free ones, (p,)."""
    found = {name: np.zeros(len(result.names)) for name in ties}
    for i, name in enumerate(result.names):
        sigma = result.std_error[name]
        step = _STEP * (sigma if np.isfinite(sigma) and sigma > 0 else max(abs(result.theta[name]), 1.0))
        for tied, slope in _slopes(ties, result.theta, name, step).items():
            found[tied][i] = slope
    return found


def _error(row: FloatArray, covariance: FloatArray) -> float:
    """nan where the tie depends on a parameter without an error."""
    used = row != 0.0
    return float(np.sqrt(row[used] @ covariance[np.ix_(used, used)] @ row[used]))
