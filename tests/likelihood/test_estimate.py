"""`fit` on output-error problems: against single shooting and exact statistics; gaps, bounds, refusals."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from brv_hypo.errors import UsageError
from brv_hypo.likelihood import FitResult, Segment, fit
from tests.studies.likelihood.problems import (
    ModelProblem,
    by_central_differences,
    growing_body,
    short_period,
    spinning_body,
)
from tests.studies.likelihood.single_shooting import fit_single_shooting

SHORT = short_period()


def scaled(problem: ModelProblem, factor: float) -> dict[str, float]:
    return {name: factor * value for name, value in problem.truth.items()}


def errors_in_sigma(result: FitResult, problem: ModelProblem) -> np.ndarray:
    return np.array([(result.theta[k] - problem.truth[k]) / result.std_error[k] for k in problem.truth])


SLOW_BODY = spinning_body().with_truth(M_alpha=-4.0, M_q=-0.8)


@pytest.mark.slow
@pytest.mark.parametrize("problem", [short_period(), SLOW_BODY], ids=["short period", "spinning body"])
def test_it_agrees_with_single_shooting_to_1e_6(problem: ModelProblem) -> None:
    """At 150 Hz, where the discretisation errors of both are below the tolerance."""
    fast = replace(problem, rate=150.0)
    segment = fast.simulate(450, seed=3)
    ours = fit(fast.dynamics, fast.outputs, [segment], scaled(fast, 0.9), tolerance=1e-9)
    reference = fit_single_shooting(
        fast.dynamics, fast.outputs, [segment], scaled(fast, 0.9), substeps=2, tolerance=1e-9
    )
    assert (ours.status, reference.status) == ("converged", "converged")
    for name in fast.truth:
        assert ours.theta[name] == pytest.approx(reference.theta[name], rel=1e-6, abs=1e-6 * ours.std_error[name])
    assert ours.nllf == pytest.approx(reference.nllf, abs=1e-6 * abs(reference.nllf))
    np.testing.assert_allclose(ours.states[0], reference.states[0], atol=1e-6 * np.abs(ours.states[0]).max())


@pytest.mark.parametrize("factor", [0.0, *(pytest.param(factor, marks=pytest.mark.slow) for factor in (0.5, 1.5))])
@pytest.mark.parametrize(
    "problem",
    [
        pytest.param(short_period(), id="short period"),
        pytest.param(spinning_body(), id="spinning body", marks=pytest.mark.thorough),
    ],
)
def test_it_converges_from_zero_and_from_half_off(problem: ModelProblem, factor: float) -> None:
    segment = problem.simulate(500, seed=1)
    result = fit(problem.dynamics, problem.outputs, [segment], scaled(problem, factor))
    assert result.status == "converged", result.message
    assert result.derivatives == "complex"
    assert np.abs(errors_in_sigma(result, problem)).max() < 4
    assert all(test.white for test in result.whiteness)


@pytest.mark.parametrize("start", [1e-3, *(pytest.param(start, marks=pytest.mark.slow) for start in (1e-8, 1e-5))])
@pytest.mark.parametrize(
    ("problem", "samples"),
    [
        pytest.param(spinning_body(), 400, id="spinning", marks=pytest.mark.thorough),
        pytest.param(growing_body(), 75, id="growing"),
    ],
)
def test_a_small_start_is_as_good_as_zero(problem: ModelProblem, samples: int, start: float) -> None:
    """A force slope of 1e-3 makes the accelerometers imply an angle of attack of many turns."""
    segment = problem.simulate(samples, seed=5)
    result = fit(problem.dynamics, problem.outputs, [segment], dict.fromkeys(problem.truth, start))
    assert result.converged, result.message
    assert np.abs(errors_in_sigma(result, problem)).max() < 4


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.thorough) for seed in range(1, 4))])
def test_unstable_motion_converges_from_half_off(seed: int) -> None:
    body = growing_body()
    rng = np.random.default_rng(seed)
    start = {name: value * (1 + 0.5 * rng.choice([-1, 1])) for name, value in body.truth.items()}
    result = fit(body.dynamics, body.outputs, [body.simulate(75, seed)], start)
    assert result.converged, result.message
    assert np.abs(errors_in_sigma(result, body)).max() < 4.5


def test_covariance_and_likelihood_against_their_formulas() -> None:
    """x' = -a x + b u, y = x + c, whose solution and sensitivities are known."""
    rng = np.random.default_rng(2)
    t = np.arange(800) / 50
    u = np.sin(1.1 * t) + np.sin(2.9 * t)
    truth = {"a": 0.8, "b": 1.5, "c": 0.3}
    sigma = 0.05

    def dynamics(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return -theta["a"] * x + theta["b"] * u

    def outputs(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return x + theta["c"]

    def response(a: float) -> np.ndarray:
        found = np.zeros_like(t)
        for frequency in (1.1, 2.9):
            found += (a * np.sin(frequency * t) - frequency * np.cos(frequency * t)) / (a**2 + frequency**2)
        return found

    def model(a: float, b: float, c: float, transient: float) -> np.ndarray:
        return b * response(a) + c + transient * np.exp(-a * t)

    x_true = model(truth["a"], truth["b"], 0.0, 0.9)
    y = x_true + truth["c"] + sigma * rng.standard_normal(t.size)
    known = np.array([sigma**2])
    result = fit(
        dynamics, outputs, [Segment(t, u[None], y[None], np.array([0.0]))], {"a": 0.4, "b": 1.0, "c": 0.0},
        noise=known,
    )  # fmt: skip
    at = np.array([*(result.theta[k] for k in "abc"), 0.0])
    at[3] = result.states[0][0, 0] - at[1] * response(at[0])[0]
    rows = []
    for i in range(4):
        step = 1e-6 * np.eye(4)[i]
        rows.append((model(*(at + step)) - model(*(at - step))) / 2e-6)
    information = np.array(rows) @ np.array(rows).T / sigma**2
    np.testing.assert_allclose(result.covariance, np.linalg.inv(information)[:3, :3], rtol=1e-4)
    v = result.innovations[0][0]
    assert result.log_likelihood == pytest.approx(-0.5 * np.sum(v**2 / sigma**2 + np.log(sigma**2)), rel=1e-12)
    np.testing.assert_allclose(v, y - model(*at), atol=1e-6)


@pytest.mark.parametrize("differentiated", [lambda function: function, by_central_differences])
@pytest.mark.parametrize("start", [0.0, 1e-14, 1e-9])
def test_a_parameter_that_starts_next_to_zero_moves_like_one_that_starts_at_zero(
    start: float, differentiated: Any
) -> None:
    """Beside a state of 300 a step in proportion to such a start is lost in rounding."""
    t = np.arange(200) / 20
    speed = 300.0 * np.exp(-0.1 * t) + 20.0 * t
    y = np.stack([speed, speed + 2.5]) + 0.1 * np.random.default_rng(6).standard_normal((2, 200))
    segment = Segment(t, np.zeros((0, 200)), y, np.array([300.0]))

    def dynamics(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return -theta["drag"] * x + theta["thrust"] + theta["growth"] * t

    def outputs(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return np.concatenate([x, x + theta["bias"]])

    result = fit(
        differentiated(dynamics), outputs, [segment], {"drag": 0.1, "thrust": 15.0, "growth": start, "bias": start}
    )  # fmt: skip
    assert result.converged, result.message
    for name, value in (("drag", 0.1), ("thrust", 20.0), ("growth", 2.0), ("bias", 2.5)):
        assert abs(result.theta[name] - value) < 4.0 * result.std_error[name]
    assert result.std_error["bias"] == pytest.approx(0.1 * np.sqrt(2.0 / 200), rel=0.2)


def test_central_differences_reach_the_same_estimate() -> None:
    segment = SHORT.simulate(400, seed=5)
    exact = fit(SHORT.dynamics, SHORT.outputs, [segment], scaled(SHORT, 0.0))
    central = fit(by_central_differences(SHORT.dynamics), SHORT.outputs, [segment], scaled(SHORT, 0.0))
    assert exact.derivatives == "complex"
    assert central.derivatives == "central"
    for name in SHORT.truth:
        assert central.theta[name] == pytest.approx(exact.theta[name], abs=1e-4 * exact.std_error[name])
        assert central.std_error[name] == pytest.approx(exact.std_error[name], rel=1e-5)


def test_gaps_cost_information_and_nothing_else() -> None:
    segment = SHORT.simulate(600, seed=7)
    y = segment.y.copy()
    y[0, ::2] = np.nan
    y[1, 100:180] = np.nan
    result = fit(SHORT.dynamics, SHORT.outputs, [replace(segment, y=y)], scaled(SHORT, 0.5))
    whole = fit(SHORT.dynamics, SHORT.outputs, [segment], scaled(SHORT, 0.5))
    assert result.converged
    assert result.samples == int(np.isfinite(y).sum())
    assert np.abs(errors_in_sigma(result, SHORT)).max() < 4
    assert all(result.std_error[k] > whole.std_error[k] for k in ("Z_alpha", "alpha_bias", "M_q"))
    np.testing.assert_array_equal(np.isnan(result.innovations[0]), np.isnan(y))


def test_several_segments_share_parameters_and_keep_their_own() -> None:
    """Each flight has its own initial state; one coefficient set."""
    flights = [SHORT.simulate(300 + 50 * i, seed=i) for i in range(3)]
    result = fit(SHORT.dynamics, SHORT.outputs, flights, scaled(SHORT, 0.5))
    assert result.converged
    assert np.abs(errors_in_sigma(result, SHORT)).max() < 4
    alone = fit(SHORT.dynamics, SHORT.outputs, flights[:1], scaled(SHORT, 0.5))
    assert result.std_error["M_alpha"] < alone.std_error["M_alpha"]
    assert [x.shape[1] for x in result.states] == [300, 350, 400]


def test_a_fixed_parameter_stays_and_a_prior_pulls() -> None:
    segment = SHORT.simulate(300, seed=2)
    start = scaled(SHORT, 0.8) | {"M_q": SHORT.truth["M_q"]}
    fixed = fit(SHORT.dynamics, SHORT.outputs, [segment], start, bounds={"M_q": (start["M_q"], start["M_q"])})
    assert fixed.theta["M_q"] == SHORT.truth["M_q"]
    assert "M_q" not in fixed.names
    free = fit(SHORT.dynamics, SHORT.outputs, [segment], start)
    spread = free.std_error["M_q"]
    mean = free.theta["M_q"] + 2 * spread
    pulled = fit(
        SHORT.dynamics, SHORT.outputs, [segment], start, priors={"M_q": (mean, spread)},
        noise=free.noise_variance,
    )  # fmt: skip
    assert pulled.theta["M_q"] == pytest.approx(free.theta["M_q"] + spread, abs=0.05 * spread)
    assert pulled.std_error["M_q"] == pytest.approx(spread / np.sqrt(2), rel=0.02)


def test_a_parameter_at_its_bound_says_so_and_has_no_error() -> None:
    segment = SHORT.simulate(300, seed=2)
    free = fit(SHORT.dynamics, SHORT.outputs, [segment], scaled(SHORT, 1.0))
    limit = free.theta["M_q"] + free.std_error["M_q"]
    result = fit(SHORT.dynamics, SHORT.outputs, [segment], scaled(SHORT, 0.5), bounds={"M_q": (limit, 0.0)})
    assert result.status == "converged"
    assert result.at_bound == ("M_q",)
    assert result.theta["M_q"] == limit
    assert np.isnan(result.std_error["M_q"])
    assert np.isfinite(result.std_error["M_alpha"])
    assert result.nllf > free.nllf


def test_a_known_initial_state_is_kept() -> None:
    segment = replace(SHORT.simulate(300, seed=2), x0=SHORT.x0, x0_std=0.0)
    result = fit(SHORT.dynamics, SHORT.outputs, [segment], scaled(SHORT, 0.5))
    assert result.converged
    np.testing.assert_allclose(result.states[0][:, 0], SHORT.x0, atol=1e-12)


def test_parameters_that_the_data_cannot_separate_are_named() -> None:
    def outputs(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return np.stack([x[0] + theta["alpha_bias"] + theta["alpha_trim"], x[1] + theta["q_bias"]])

    result = fit(SHORT.dynamics, outputs, [SHORT.simulate(300, 4)], scaled(SHORT, 0.5) | {"alpha_trim": 0.0})
    worst = result.identifiability.near_null[0]
    assert set(worst.weights) == {"alpha_bias", "alpha_trim"}
    assert abs(sum(worst.weights.values())) < 1e-6
    assert np.isnan(result.std_error["alpha_trim"])


def test_an_unobservable_state_is_a_status() -> None:
    def dynamics(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return np.stack([theta["a"] * x[0], theta["b"] * x[1]])

    t = np.arange(100) / 20
    segment = Segment(t, np.zeros((0, 100)), np.exp(-t)[None], np.array([1.0, 1.0]))
    result = fit(dynamics, lambda x, u, theta, t: x[:1], [segment], {"a": -0.5, "b": -0.5})
    assert result.status == "undetermined"
    assert "x0_std" in result.message


SHORT_FIT = fit(SHORT.dynamics, SHORT.outputs, [SHORT.simulate(300, 0)], scaled(SHORT, 1.0))


def test_noise_free_data_give_the_truth_and_a_remark_that_there_is_no_noise() -> None:
    quiet = replace(SHORT, noise=np.zeros(2), rate=100.0)
    result = fit(quiet.dynamics, quiet.outputs, [quiet.simulate(800, 0)], scaled(quiet, 0.5))
    assert result.converged
    for name, value in quiet.truth.items():
        assert result.theta[name] == pytest.approx(value, rel=1e-4)
    assert "outputs [0, 1] hold next to no noise" in result.remarks[0]
    assert SHORT_FIT.remarks == ()


def test_progress_is_reported_and_the_cost_history_kept() -> None:
    reported: list[str] = []
    result = fit(
        SHORT.dynamics, SHORT.outputs, [SHORT.simulate(300, 0)], scaled(SHORT, 0.5),
        progress=lambda fraction, text: reported.append(text),
    )  # fmt: skip
    assert [h.iteration for h in result.history] == list(range(1, result.iterations + 1))
    assert [text.split(":")[0] for text in reported] == [f"iteration {h.iteration}" for h in result.history]
    assert result.history[-1].cost == pytest.approx(result.nllf)


GOOD = SHORT.simulate(50, seed=0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"segments": []}, "no segments"),
        ({"segments": [replace(GOOD, t=GOOD.t[::-1])]}, "do not increase"),
        ({"segments": [replace(GOOD, u=GOOD.u[:, 1:])]}, "one column per sample"),
        ({"segments": [replace(GOOD, u=GOOD.u * np.nan)]}, "u is not finite"),
        ({"segments": [replace(GOOD, x0=np.zeros((2, 7)))]}, "x0 has shape"),
        ({"segments": [Segment(GOOD.t[:4], GOOD.u[:, :4], GOOD.y[:, :4], GOOD.x0)]}, "at least 6 samples"),
        ({"segments": [replace(GOOD, x0=np.zeros(0))]}, "no states"),
        ({"segments": [replace(GOOD, y=GOOD.y * np.nan)]}, "no measured value"),
        ({"segments": [replace(GOOD, x0_std=-1.0)]}, "none negative"),
        ({"segments": [GOOD, replace(GOOD, y=GOOD.y[:1])]}, "the same number in each"),
        ({"theta0": {}}, "theta0 is empty"),
        ({"noise": np.zeros(2)}, "positive values"),
        ({"noise": np.ones(3)}, "expected 2"),
        ({"bounds": {"M_x": (0.0, 1.0)}}, "M_x"),
        ({"bounds": {"M_q": (1.0, 0.0)}}, "expected lower <= upper"),
        ({"bounds": {"M_q": (5.0, 9.0)}}, "outside its bounds"),
        ({"priors": {"M_q": (0.0, 0.0)}}, "standard deviation"),
        ({"bounds": {name: (value, value) for name, value in SHORT.truth.items()}}, "nothing to estimate"),
        ({"process_noise": [0.1]}, "2 values"),
        ({"delays": ("late",)}, "late"),
        ({"dynamics": lambda x, u, theta, t: x[0]}, "dynamics returned an array of shape"),
        ({"outputs": lambda x, u, theta, t: x * np.nan}, "outputs is not finite"),
    ],
)
def test_refusals_say_what_was_got_and_expected(changes: dict[str, Any], message: str) -> None:
    arguments: dict[str, Any] = {
        "dynamics": SHORT.dynamics, "outputs": SHORT.outputs, "segments": [GOOD], "theta0": dict(SHORT.truth),
    }  # fmt: skip
    with pytest.raises(UsageError, match=message):
        fit(**(arguments | changes))


def test_the_import_is_cheap() -> None:
    """Neither SciPy nor anything else beyond NumPy is loaded before the first fit."""
    code = "import sys, brv_hypo.likelihood; print([m for m in ('scipy', 'pandas', 'rich') if m in sys.modules])"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert loaded.stdout.strip() == "[]"


def test_the_units_of_the_states_do_not_matter() -> None:
    """Angles of attack as lateral velocities, three hundred times larger numbers."""
    body = spinning_body()
    segment = body.simulate(300, seed=8)
    units = np.array([[1.0], [1.0], [300.0], [300.0]])

    def dynamics(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return units * body.dynamics(x / units, u, theta, t)

    def outputs(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return body.outputs(x / units, u, theta, t)

    one = fit(body.dynamics, body.outputs, [segment], scaled(body, 0.7), tolerance=1e-7)
    other = fit(dynamics, outputs, [segment], scaled(body, 0.7), tolerance=1e-7)
    for name in body.truth:
        assert other.theta[name] == pytest.approx(one.theta[name], abs=1e-5 * one.std_error[name])
        assert other.std_error[name] == pytest.approx(one.std_error[name], rel=1e-5)


def test_a_start_that_fits_poorly_converges_where_zero_is_not_defined() -> None:
    """x' = -x / tau, of which both x and its rate are measured: nothing can be tried at tau = 0."""
    t = np.arange(100) / 20
    decay = np.exp(-t / 0.8)
    y = np.stack([decay, -decay / 0.8]) + 1e-3 * np.random.default_rng(0).standard_normal((2, 100))
    segment = Segment(t, np.zeros((0, 100)), y, np.zeros(1))

    def dynamics(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return -x / theta["tau"]

    def outputs(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return np.concatenate([x, -x / theta["tau"]])

    result = fit(dynamics, outputs, [segment], {"tau": 3.0})
    assert result.converged, result.message
    assert abs(result.theta["tau"] - 0.8) < 4 * result.std_error["tau"]


def test_what_a_segment_ignores_is_not_differentiated_by() -> None:
    """Two records with a bias each: separated by name or by `ignores`, with fewer evaluations."""
    t = np.arange(0.0, 6.0, 0.05)
    calls = {"plain": 0, "separated": 0}

    def run(kind: str) -> FitResult:
        def dynamics(x: Any, u: Any, theta: Any, t: Any) -> Any:
            return np.stack([-theta["k"] * x[0] + u[0]])

        def outputs(x: Any, u: Any, theta: Any, t: Any) -> Any:
            calls[kind] += 1
            return np.stack([x[0] + np.where(u[1] == 0.0, theta["b0"], theta["b1"])])

        draws = np.random.default_rng(9)
        segments = []
        for number, bias in enumerate((0.3, -0.2)):
            u = np.stack([np.sin(t + number), np.full(t.size, float(number))])
            x = np.exp(-0.8 * t) * np.cumsum(np.exp(0.8 * t) * u[0]) * 0.05
            y = (x + bias + 0.01 * draws.standard_normal(t.size))[None]
            other = frozenset({f"b{1 - number}"}) if kind == "separated" else frozenset()
            segments.append(Segment(t, u, y, np.zeros(1), ignores=other))
        return fit(by_central_differences(dynamics), outputs, segments, {"k": 0.5, "b0": 0.0, "b1": 0.0})

    plain, separated = run("plain"), run("separated")
    assert separated.converged
    assert calls["separated"] < calls["plain"]
    for name, value in plain.theta.items():
        assert separated.theta[name] == pytest.approx(value, abs=1e-6)
        assert separated.std_error[name] == pytest.approx(plain.std_error[name], rel=1e-6)
