"""A fit from an earlier one: its noise is begun with, and derivatives hold over steps that the tolerance allows."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from brv_hypo.likelihood import FitResult, Segment, fit, search
from brv_hypo.likelihood.collocation import Linearisation
from brv_hypo.likelihood.gauss_newton import Iterate, Problem, linearised
from tests.studies.likelihood.problems import by_central_differences, spinning_body

BODY = spinning_body()
SEGMENT = BODY.simulate(400, seed=2)
COARSE = 0.1  # standard errors: what `identify` asks


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


@pytest.mark.parametrize(("tolerance", "held"), [(COARSE, 1), (1e-6, 0)])
def test_derivatives_are_held_as_far_as_the_tolerance_allows(
    tolerance: float, held: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A coarse fit takes fewer sets of derivatives than steps, and ends within its tolerance of the exact one."""
    taken: list[Iterate] = []

    def counted(problem: Problem, iterate: Iterate) -> tuple[Linearisation, ...]:
        taken.append(iterate)
        return linearised(problem, iterate)

    monkeypatch.setattr(search, "linearised", counted)
    found = fitted(tolerance)
    assert found.converged
    assert len(taken) == len(found.history) - held
    for name in EXACT.theta:
        assert found.theta[name] == pytest.approx(EXACT.theta[name], abs=tolerance * EXACT.std_error[name])
        assert found.std_error[name] == pytest.approx(EXACT.std_error[name], rel=0.02)
