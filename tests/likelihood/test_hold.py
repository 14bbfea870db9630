"""Inputs between samples: held, on straight lines, on cubics."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.likelihood import FitResult, Segment, fit
from tests.studies.likelihood.problems import by_central_differences
from tests.studies.likelihood.single_shooting import fit_single_shooting

TRUTH = {"a": 1.5, "b": 2.0, "c": 0.7}
SIGMA = 1e-3
_FINE = 200


def dynamics(x: Any, u: Any, theta: Any, t: Any) -> Any:
    return -theta["a"] * x + theta["b"] * u[:1] + theta["c"] * u[1:]


def outputs(x: Any, u: Any, theta: Any, t: Any) -> Any:
    return x


def record(held: str) -> Segment:
    """A switched input and a sine, held or drawn as straight lines from sample to sample."""
    rng = np.random.default_rng(3)
    t = np.arange(150) / 10
    switched = np.repeat(rng.choice([-1.0, 1.0], 30), 5)
    step = (t[1] - t[0]) / _FINE
    fine = t[0] + step * np.arange((t.size - 1) * _FINE + 1)
    between = np.floor(np.arange(fine.size - 1) / _FINE).astype(int)
    x = np.zeros(fine.size)
    for k, interval in enumerate(between):
        middle = fine[k] + step / 2
        own = [u[interval] if held == "zero" else np.interp(middle, t, u) for u in (switched, np.sin(t))]
        forcing = TRUTH["b"] * own[0] + TRUTH["c"] * own[1]
        x[k + 1] = x[k] + (forcing / TRUTH["a"] - x[k]) * -np.expm1(-TRUTH["a"] * step)
    y = x[::_FINE] + SIGMA * rng.standard_normal(t.size)
    return Segment(t, np.stack([switched, np.sin(t)]), y[None], np.zeros(1))


def errors(result: FitResult) -> FloatArray:
    return np.array([(result.theta[k] - v) / result.std_error[k] for k, v in TRUTH.items()])


@pytest.mark.parametrize("held", ["zero", "linear"])
def test_the_right_hold_is_unbiased_and_a_cubic_is_not(held: Any) -> None:
    segment = record(held)
    declared = Segment(segment.t, segment.u, segment.y, segment.x0, hold=held)
    right, wrong = (fit(dynamics, outputs, [s], dict.fromkeys(TRUTH, 1.0)) for s in (declared, segment))
    assert right.converged, right.message
    assert np.abs(errors(right)).max() < 4.0
    assert right.nllf < wrong.nllf - 100.0


def test_central_differences_agree() -> None:
    segment = record("zero")
    held = Segment(segment.t, segment.u, segment.y, segment.x0, hold="zero")
    one = fit(dynamics, outputs, [held], dict.fromkeys(TRUTH, 1.0))
    other = fit(by_central_differences(dynamics), outputs, [held], dict.fromkeys(TRUTH, 1.0))
    for name in TRUTH:
        assert other.theta[name] == pytest.approx(one.theta[name], abs=1e-3 * one.std_error[name])


@pytest.mark.parametrize("hold", ["first", ("zero",)])
def test_an_unknown_hold_is_refused(hold: Any) -> None:
    segment = record("zero")
    with pytest.raises(UsageError, match=r"expected one of \['zero', 'linear', 'cubic'\]"):
        fit(dynamics, outputs, [Segment(segment.t, segment.u, segment.y, segment.x0, hold=hold)], TRUTH)


def test_single_shooting_refuses_a_hold_that_it_does_not_know() -> None:
    segment = record("zero")
    held = Segment(segment.t, segment.u, segment.y, segment.x0, hold="zero")
    with pytest.raises(UsageError, match="Use `fit`"):
        fit_single_shooting(dynamics, outputs, [held], TRUTH)


def test_an_event_between_samples_is_a_held_input_that_jumps_at_a_sample_where_nothing_was_measured() -> None:
    event, rate, truth = 5.037, 10.0, {"a": 1.5, "b": 2.0}
    t = np.arange(150) / rate
    late = np.maximum(t - event, 0.0)
    x = np.exp(-truth["a"] * t) - truth["b"] / truth["a"] * np.expm1(-truth["a"] * late)
    y = x + SIGMA * np.random.default_rng(4).standard_normal(t.size)

    def decay(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return -theta["a"] * x + theta["b"] * u[:1]

    def fitted(times: FloatArray, measured: FloatArray) -> FloatArray:
        happened = np.asarray(times >= event, dtype=float)[None]
        segment = Segment(times, happened, measured[None], np.ones(1), hold="zero")
        found = fit(decay, outputs, [segment], dict.fromkeys(truth, 1.0))
        assert found.converged, found.message
        return np.array([(found.theta[k] - v) / found.std_error[k] for k, v in truth.items()])

    where = int(np.searchsorted(t, event))
    assert np.abs(fitted(np.insert(t, where, event), np.insert(y, where, np.nan))).max() < 3.0
    assert np.abs(fitted(t, y)).max() > 3.0
