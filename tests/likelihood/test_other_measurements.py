"""What other measurements make of the estimate, against fits of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from brv_hypo.errors import UsageError
from brv_hypo.likelihood import FitResult, Segment, fit


def dynamics(x: Any, u: Any, theta: Any, t: Any) -> Any:
    return np.stack([x[1], theta["k"] * x[0] + theta["d"] * x[1] + theta["b"] * u[0]])


def outputs(x: Any, u: Any, theta: Any, t: Any) -> Any:
    return np.stack([x[0] + theta["bias"], x[1]])


def record(seed: int, x0_std: float = np.inf) -> Segment:
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 12.0, 0.05)
    u = np.sin(0.7 * t)[None] + 0.4 * np.cos(2.3 * t)
    truth = {"k": -4.0, "d": -0.5, "b": 2.0, "bias": 0.1}
    x = np.zeros((2, t.size))
    x[:, 0] = [1.0, 0.0]
    for i in range(t.size - 1):
        fine = x[:, i : i + 1]
        for j in range(10):
            now = u[:, i : i + 1] + (u[:, i + 1 : i + 2] - u[:, i : i + 1]) * (j + 0.5) / 10
            half = fine + 0.0025 * dynamics(fine, now, truth, None)
            fine = fine + 0.005 * dynamics(half, now, truth, None)
        x[:, i + 1] = fine[:, 0]
    y = outputs(x, u, truth, t) + 0.02 * rng.standard_normal((2, t.size))
    return Segment(t, u, y, np.array([1.0, 0.0]), x0_std=x0_std)


def fitted(segments: list[Segment], **options: Any) -> FitResult:
    start = {"k": -3.5, "d": -0.4, "b": 1.8, "bias": 0.0}
    return fit(dynamics, outputs, segments, start, noise=np.full(2, 4e-4), **options)


@pytest.mark.parametrize("x0_std", [np.inf, *(pytest.param(std, marks=pytest.mark.thorough) for std in (0.05, 0.0))])
def test_other_measurements_change_it_as_a_fit_of_them_does(x0_std: float) -> None:
    """In gaps nothing counts."""
    segments = [record(4, x0_std), record(5, x0_std)]
    segments[1].y[:, 50:60] = np.nan
    found = fitted(segments)
    rng = np.random.default_rng(6)
    more = [0.005 * rng.standard_normal(part.y.shape).cumsum(axis=1) for part in segments]
    changed = [replace(part, y=part.y + own) for part, own in zip(segments, more, strict=True)]
    again = fitted(changed)
    told = found.change_by([after.y - before.y for before, after in zip(segments, changed, strict=True)])
    for name, error in found.std_error.items():
        assert abs(again.theta[name] - found.theta[name]) > 0.1 * error
        assert told[name] == pytest.approx(again.theta[name] - found.theta[name], abs=0.03 * error, rel=0.05)


def test_with_process_noise_it_is_refused() -> None:
    found = fitted([record(3)], process_noise=[0.0, 0.05])
    with pytest.raises(UsageError, match="without process noise"):
        found.change_by([np.zeros((2, 240))])
