"""A fit from an earlier one: its noise is begun with; a coarse one ends near the exact."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from brv_hypo.likelihood import FitResult, Segment, fit
from tests.studies.likelihood.problems import by_central_differences, spinning_body

BODY = spinning_body()
SEGMENT = BODY.simulate(400, seed=2)
COARSE = 0.1  # standard errors: what `identify` requires


def fitted(tolerance: float = 1e-6) -> FitResult:
    """The body fitted from a tenth off."""
    start = {name: 0.9 * value for name, value in BODY.truth.items()}
    return fit(by_central_differences(BODY.dynamics), BODY.outputs, [SEGMENT], start, tolerance=tolerance)


EXACT = fitted()


def again(segment: Segment, **options: Any) -> FitResult:
    return fit(by_central_differences(BODY.dynamics), BODY.outputs, [segment], EXACT.theta, near_start=True, **options)


def test_a_fit_that_begins_with_the_noise_of_the_last_has_nowhere_to_go() -> None:
    segment = replace(SEGMENT, x0=EXACT.states[0])
    first = again(segment, tolerance=COARSE, first_noise=EXACT.noise_variance)
    assert first.converged
    assert len(first.history) == 1
    assert first.history[0].step_length < 1e-3
    for name in EXACT.theta:
        assert first.theta[name] == pytest.approx(EXACT.theta[name], abs=1e-3 * EXACT.std_error[name])


def test_a_coarse_fit_ends_within_its_tolerance_of_the_exact_one() -> None:
    found = fitted(COARSE)
    assert found.converged
    for name in EXACT.theta:
        assert found.theta[name] == pytest.approx(EXACT.theta[name], abs=COARSE * EXACT.std_error[name])
        assert found.std_error[name] == pytest.approx(EXACT.std_error[name], rel=0.02)
