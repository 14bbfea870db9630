"""Derivatives that come with a function: by hand, or from automatic differentiation (jax.jacfwd, say)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError

Derivatives = Callable[..., tuple[Any, Mapping[str, Any]]]
"""(x, u, theta, t) -> by states (m, n_states, n), and by parameters (m, n) by name, vectorised as the function is."""


@dataclass(frozen=True)
class Given:
    """A function (x, u, theta, t) -> (m, n) with its `derivatives`; `what` it is, for messages."""

    function: Callable[..., Any]
    derivatives: Derivatives
    what: str

    def __call__(self, *arguments: Any) -> Any:
        """The function."""
        return self.function(*arguments)

    def at(
        self, x: FloatArray, u: FloatArray, theta: Mapping[str, Any], t: FloatArray
    ) -> tuple[FloatArray, dict[str, FloatArray]]:
        """Derivatives by states (n, m, n_states), and by those parameters that it knows, (n, m).

        Raises:
            UsageError: something else than a pair, or of another shape.
        """
        found = self.derivatives(x, u, theta, t)
        if not (isinstance(found, tuple) and len(found) == 2 and isinstance(found[1], Mapping)):
            raise UsageError(
                f"{self.what}_jacobian returned {type(found).__name__}; expected a pair: the derivatives by states, an "
                "array (rows, states, samples), and a mapping of parameter names to arrays (rows, samples)"
            )
        by_state = np.asarray(found[0], dtype=float)
        by_parameter = {name: np.asarray(value, dtype=float) for name, value in found[1].items()}
        if by_state.ndim != 3 or by_state.shape[1:] != x.shape:
            raise UsageError(
                f"{self.what}_jacobian returned derivatives by states of shape {by_state.shape}; expected (rows, "
                f"{x.shape[0]}, {x.shape[1]}): rows, states, samples"
            )
        expected = by_state.shape[::2]
        for name, value in by_parameter.items():
            if value.shape != expected:
                raise UsageError(
                    f"{self.what}_jacobian returned a derivative by {name!r} of shape {value.shape}; expected "
                    f"{expected}: rows, samples"
                )
        return by_state.transpose(2, 0, 1), {name: value.T for name, value in by_parameter.items()}


@dataclass(frozen=True)
class PartlyGiven:
    """A function (x, u, theta, t[, delayed]) -> (m, n) with `slopes`, taken as right: its derivatives (m, n) by some
    parameters and courses, by name.
    """

    function: Callable[..., Any]
    slopes: Callable[..., Mapping[str, FloatArray]]

    def __call__(self, *arguments: Any) -> Any:
        """The function."""
        return self.function(*arguments)

    def at(self, *arguments: Any) -> tuple[None, dict[str, FloatArray]]:
        """No derivatives by states, and those by parameters and courses, (n, m)."""
        return None, {name: value.T for name, value in self.slopes(*arguments).items()}


def with_given(function: Callable[..., Any], derivatives: Derivatives | None, what: str) -> Callable[..., Any]:
    """The function with its derivatives, where there are any."""
    return function if derivatives is None else Given(function, derivatives, what)


def plain(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function alone."""
    return function.function if isinstance(function, Given) else function
