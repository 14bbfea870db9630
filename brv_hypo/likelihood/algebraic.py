"""Models without states, y = h(u, theta, t) + noise: one state that stands still takes their place inside."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from brv_hypo.errors import UsageError
from brv_hypo.likelihood.given import Given
from brv_hypo.likelihood.result import FitResult
from brv_hypo.likelihood.segment import Segment


def still(x: Any, u: Any, theta: Any, t: Any) -> Any:
    """The dynamics of a state that stands still."""
    return 0.0 * x


def stateless(outputs: Callable[..., Any]) -> Callable[..., Any]:
    """The outputs, the state that stands still kept from them; and from the derivatives that they come with."""

    def seen(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return outputs(x[:0], u, theta, t)

    if not isinstance(outputs, Given):
        return seen

    def derivatives(x: Any, u: Any, theta: Any, t: Any) -> Any:
        by_state, by_parameter = outputs.derivatives(x[:0], u, theta, t)
        return np.zeros((np.shape(by_state)[0], 1, t.size)), by_parameter

    return Given(seen, derivatives, outputs.what)


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
