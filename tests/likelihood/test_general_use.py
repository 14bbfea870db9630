"""What users do with a fit: constraints among parameters, profile intervals, reports, tables, pickles."""

from __future__ import annotations

import pickle
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
import pytest
from scipy.optimize import curve_fit

from brv_hypo.errors import UsageError
from brv_hypo.likelihood import FitResult, Segment, fit, profile_interval
from brv_hypo.likelihood.result import correlations

TIMES = np.linspace(0.0, 5.0, 101)


def decay(x: Any, u: Any, theta: Any, t: Any) -> Any:
    return -theta["rate"] * x + theta["gain"]


def seen(x: Any, u: Any, theta: Any, t: Any) -> Any:
    return x


def record(sigma: float, rate: float = 0.8, gain: float = 0.4) -> Segment:
    x = gain / rate + (2.0 - gain / rate) * np.exp(-rate * TIMES)
    y = x + sigma * np.random.default_rng(4).standard_normal(TIMES.size)
    return Segment(TIMES, np.zeros((0, TIMES.size)), y[None], np.array([2.0]))


SEGMENT = record(0.02)
START = {"rate": 0.5, "gain": 0.5}
PLAIN = fit(decay, seen, [SEGMENT], START)


def test_a_tied_parameter_is_the_same_model_with_its_error() -> None:
    """The rate as the inverse of a time constant."""
    constraints = fit(
        decay, seen, [SEGMENT], {"tau": 2.0, "gain": 0.5}, constraints={"rate": lambda theta: 1.0 / theta["tau"]}
    )
    assert constraints.names == ("tau", "gain")
    assert constraints.derivatives == "complex"
    assert constraints.theta["rate"] == pytest.approx(PLAIN.theta["rate"], rel=1e-5)
    assert constraints.std_error["rate"] == pytest.approx(PLAIN.std_error["rate"], rel=1e-3)
    assert constraints.std_error_coloured["rate"] == pytest.approx(PLAIN.std_error_coloured["rate"], rel=1e-3)


def test_a_constraint_takes_a_freedom_away() -> None:
    half = fit(decay, seen, [SEGMENT], {"rate": 0.5}, constraints={"gain": lambda theta: 0.5 * theta["rate"]})
    assert half.theta["gain"] == 0.5 * half.theta["rate"]
    assert half.std_error["gain"] == pytest.approx(0.5 * half.std_error["rate"])
    assert half.nllf >= PLAIN.nllf - 1e-6


def test_a_tied_parameter_may_follow_from_another() -> None:
    ties = {"tau": lambda theta: 2.0 * theta["half"], "rate": lambda theta: 1.0 / theta["tau"]}
    constraints = fit(decay, seen, [SEGMENT], {"half": 1.0, "gain": 0.5}, constraints=ties)
    assert constraints.theta["rate"] == pytest.approx(PLAIN.theta["rate"], rel=1e-5)
    assert constraints.std_error["rate"] == pytest.approx(PLAIN.std_error["rate"], rel=1e-3)
    assert constraints.std_error["tau"] == pytest.approx(2.0 * constraints.std_error["half"], rel=1e-6)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"constraints": {"rate": lambda theta: 1.0}}, "theta0 has too"),
        ({"constraints": {"other": lambda theta: theta["nothing"]}}, "needs 'nothing'"),
        ({"constraints": {"other": lambda theta: np.nan}}, "finite"),
        ({"constraints": {"other": lambda theta: 1.0}, "per_segment": ("gain",)}, "one value"),
    ],
)
def test_ties_that_mean_nothing_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        fit(decay, seen, [SEGMENT], START, **changes)


def refit(theta0: Mapping[str, float], fixed: Collection[str]) -> FitResult:
    return fit(decay, seen, [SEGMENT], theta0, fixed=fixed)


def test_a_profile_of_a_nearly_linear_problem_is_the_standard_error() -> None:
    found = profile_interval(refit, PLAIN, "rate")
    for end, side in ((found.lower, -1.0), (found.upper, 1.0)):
        assert end == pytest.approx(PLAIN.theta["rate"] + side * 1.96 * PLAIN.std_error["rate"], rel=0.02)
    values = [value for value, _ in found.points]
    assert values == sorted(values)
    assert min(drop for _, drop in found.points) == 0.0


def test_the_ends_of_a_profile_lie_where_the_likelihood_has_dropped_enough() -> None:
    noisy = record(0.3)

    def settled(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return np.exp(-theta["log_tau"]) * (theta["level"] - x)

    def again(theta0: Mapping[str, float], fixed: Collection[str]) -> FitResult:
        return fit(
            settled, seen, [noisy], theta0, fixed=fixed, noise_covariance=np.array([[0.09]]), mesh_steps=4
        )

    best = again({"log_tau": 0.0, "level": 0.5}, ())
    found = profile_interval(again, best, "log_tau", level=0.68)
    assert found.lower < best.theta["log_tau"] < found.upper
    for end in (found.lower, found.upper):
        assert np.sqrt(2.0 * dict(found.points)[end]) == pytest.approx(0.994, abs=0.02)
    below, above = best.theta["log_tau"] - found.lower, found.upper - best.theta["log_tau"]
    assert abs(above / below - 1.0) > 0.02


@pytest.mark.parametrize(("name", "level"), [("other", 0.95), ("rate", 1.5)])
def test_a_profile_of_nothing_is_refused(name: str, level: float) -> None:
    with pytest.raises(UsageError):
        profile_interval(refit, PLAIN, name, level)


def test_the_report_says_what_a_reader_needs() -> None:
    held = fit(
        decay, seen, [SEGMENT], {"rate": 0.5, "gain": 0.4, "idle": 3.0}, fixed=("idle",),
        constraints={"level": lambda theta: theta["gain"] / theta["rate"]},
    )  # fmt: skip
    text = held.report()
    for part in (
        "[[Fit]]",
        "status",
        "converged",
        "[[Noise]]",
        "output 0",
        "[[Parameters]]",
        "(held)",
        "(constrained)",
    ):
        assert part in text
    assert "C(rate, gain) = +" in text
    assert correlations(held)[0, 1] > 0.5
    assert max(map(len, repr(held).splitlines())) < 200
    assert "<table>" in held._repr_html_()


def test_the_report_warns() -> None:
    def twice(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return x + theta["bias"] - theta["trim"]

    text = fit(decay, twice, [SEGMENT], START | {"bias": 0.0, "trim": 0.0}).report()
    assert "[[Beware]]" in text
    assert "hardly seen by the data" in text
    assert "(not determined)" in text


def test_a_table_by_parameter_and_a_pickle() -> None:
    table = PLAIN.to_dataframe()
    assert list(table.index) == ["rate", "gain"]
    assert table.loc["rate", "value"] == PLAIN.theta["rate"]
    assert table.loc["gain", "std_error"] == PLAIN.std_error_coloured["gain"]
    again = pickle.loads(pickle.dumps(PLAIN))
    assert again.theta == PLAIN.theta
    assert again.status == "converged"
    np.testing.assert_array_equal(again.states[0], PLAIN.states[0])
    assert again.theta_without([np.arange(TIMES.size) > 50]) == PLAIN.theta_without(
        [np.arange(TIMES.size) > 50]
    )


def test_a_model_without_states_is_fitted() -> None:
    t = np.arange(60.0)
    y = 3.0 * np.exp(-0.1 * t) + 0.05 * np.random.default_rng(0).standard_normal(60)
    segment = Segment(t, np.zeros((0, 60)), y[None], np.zeros(0))

    def outputs(x: Any, u: Any, theta: Any, t: Any) -> Any:
        assert x.shape == (0, t.size)
        return (theta["a"] * np.exp(-theta["b"] * t))[None]

    def of_outputs(x: Any, u: Any, theta: Any, t: Any) -> Any:
        e = np.exp(-theta["b"] * t)[None]
        return np.zeros((1, 0, t.size)), {"a": e, "b": -t * theta["a"] * e}

    result = fit(None, outputs, [segment], {"a": 1.0, "b": 0.5})
    assert result.converged
    assert result.states[0].shape == (0, 60)
    best, covariance = curve_fit(lambda t, a, b: a * np.exp(-b * t), t, y, (1.0, 0.5))
    assert [result.theta["a"], result.theta["b"]] == pytest.approx(best, rel=1e-5)
    error = np.sqrt(np.diag(covariance))
    assert list(result.std_error.values()) == pytest.approx(error, rel=1e-3)
    given = fit(None, outputs, [segment], {"a": 1.0, "b": 0.5}, outputs_jacobian=of_outputs)
    assert given.theta == pytest.approx(result.theta, rel=1e-6)
    with pytest.raises(UsageError, match="dynamics is None"):
        fit(None, outputs, [SEGMENT], {"a": 1.0, "b": 0.5})
