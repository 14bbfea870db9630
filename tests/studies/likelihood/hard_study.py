"""Fits of what misleads them: when `converged` is right. See `python -m tests.studies.likelihood.study`.

An estimate is beyond 3 sigma where the errors of all its parameters together are: their sum of squares in units of
their covariance exceeds what one fit in 370 does by chance. Robertson's reaction has rates nine decades apart, all
states measured: its status is `too stiff`; with the fastest state following the others at once (quasi-steady state:
Bodenstein, Z. physikalische Chemie 85 (1913) 329) it converges.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.likelihood.fit import fit
from brv_hypo.likelihood.result import FitResult
from brv_hypo.likelihood.search import Status
from brv_hypo.likelihood.segment import Segment
from tests.studies.likelihood.problems import (
    ModelProblem,
    growing_body,
    held_short_period,
    kinetics,
    oscillator,
    scattered,
    short_period,
    stalled_aircraft,
    thinned,
    with_gap,
)

_THREE_SIGMA = 0.9973
_SAME_LIKELIHOOD = 1.0
"""Difference of log-likelihoods below which an optimum is the best known."""


@dataclass(frozen=True)
class TrapStudy:
    """Start by start, (starts,): log-likelihood and convergence.

    `best` is the greatest log-likelihood known: of all starts, and of a fit from the states that were flown.
    """

    log_likelihood: FloatArray
    converged: BoolArray
    best: float

    @property
    def solved(self) -> BoolArray:
        """Converged at the best optimum known, (starts,)."""
        return np.asarray(self.converged & (self.log_likelihood > self.best - _SAME_LIKELIHOOD))

    @property
    def deceived(self) -> BoolArray:
        """Converged at a worse one, (starts,)."""
        return np.asarray(self.converged & ~self.solved)


def trapped(severity: float, starts: int, seed: int, samples: int = 480) -> tuple[TrapStudy, TrapStudy]:
    """A flight into stall, fitted by a model without one, from start values up to half off: the fits, and the first
    starting point of each alone.
    """
    flown, model = stalled_aircraft(severity)
    rng = np.random.default_rng(seed)
    t = np.arange(samples) / flown.rate
    x = flown.trajectory(t, rng)
    segment = flown.measure(t, x, rng, 0.0)
    reference = fit(model.dynamics, model.outputs, [replace(segment, x0=x)], model.truth)
    ends = [fit(model.dynamics, model.outputs, [segment], scattered(model.truth, 0.5, rng)) for _ in range(starts)]
    first = [end.starting_points[0] for end in ends]
    likelihoods = np.array([end.log_likelihood for end in ends])
    best = max(float(np.nanmax(likelihoods)), reference.log_likelihood)
    alone = np.array([each.log_likelihood for each in first])
    return (
        TrapStudy(likelihoods, np.array([end.converged for end in ends]), best),
        TrapStudy(alone, np.array([each.status is Status.CONVERGED for each in first]), best),
    )


Corruption = Callable[[Segment, np.random.Generator], Segment]


@dataclass(frozen=True)
class Kind:
    """Records of one kind: what was flown, for how many samples, how they were corrupted, how far off starts are."""

    name: str
    problem: ModelProblem
    samples: int
    corruption: Corruption
    spread: float = 0.3


@dataclass(frozen=True)
class KindResult:
    """Fits of one kind: convergence (trials,), errors in standard errors (trials, p), whether all of them together
    are beyond 3 sigma (trials,).
    """

    name: str
    converged: BoolArray
    coarse: BoolArray
    score: FloatArray
    beyond: BoolArray


def record_kinds() -> tuple[Kind, ...]:
    """Gaps, half of the samples missing, held and switched inputs, coarse grids."""
    growing, aircraft, held = growing_body(), short_period(), held_short_period()
    coarse_body = replace(growing, rate=10.0)
    return (
        Kind("gap of 3 s, unstable body", growing, 250, lambda s, rng: with_gap(s, rng.uniform(0.3, 0.5), 3.0)),
        Kind("half missing, unstable body", growing, 250, lambda s, rng: thinned(s, 0.5, rng)),
        Kind(
            "both, unstable body", growing, 250,
            lambda s, rng: thinned(with_gap(s, rng.uniform(0.3, 0.5), 3.0), 0.5, rng),
        ),
        Kind("gap of 3 s, short period", aircraft, 300, lambda s, rng: with_gap(s, rng.uniform(0.1, 0.6), 3.0), 1.0),
        Kind("half missing, short period", aircraft, 300, lambda s, rng: thinned(s, 0.5, rng), 1.0),
        Kind("held input, short period", held, 300, _as_it_is, 1.0),
        Kind("held input, half missing", held, 300, lambda s, rng: thinned(s, 0.5, rng), 1.0),
        Kind("10 Hz, unstable body", coarse_body, 100, _as_it_is),
        Kind("oscillator, 2 samples a rad", oscillator(10.0), 150, _as_it_is, 0.05),
        Kind("oscillator, 1 sample a rad", oscillator(20.0), 150, _as_it_is, 0.05),
    )  # fmt: skip


def stiff_kinds() -> tuple[Kind, ...]:
    """From slow for the samples to far too fast."""
    return (
        *(Kind(f"oscillator, {w:g} rad/s", oscillator(w), 150, _as_it_is, 0.02) for w in (5.0, 20.0, 40.0, 60.0)),
        *(Kind(f"kinetics, {k:g} 1/s", kinetics(k), 100, _as_it_is) for k in (10.0, 40.0, 100.0)),
    )


def run_kind(kind: Kind, trials: int, seed: int) -> KindResult:
    """That many records, each with its own noise, gaps and start."""
    problem = kind.problem
    found = [fit(problem.dynamics, problem.outputs, [segment], start) for segment, start in _trials(kind, trials, seed)]
    return KindResult(
        name=kind.name,
        converged=np.array([result.converged for result in found]),
        coarse=np.array([result.status is Status.COARSE for result in found]),
        score=np.array([problem.score(result) for result in found]),
        beyond=np.array([_beyond(result, problem.truth) for result in found]),
    )


def hold_bias(samples: int = 300) -> FloatArray:
    """Error without noise of the estimates from a held input, in standard errors that the noise would give, (p,)."""
    problem = held_short_period()
    quiet = replace(problem, noise=np.zeros_like(problem.noise)).simulate(samples, seed=0)
    known = problem.noise**2
    found = fit(problem.dynamics, problem.outputs, [quiet], problem.truth, noise=known)
    return np.array(problem.score(found))


def _trials(kind: Kind, trials: int, seed: int) -> Iterator[tuple[Segment, dict[str, float]]]:
    problem = kind.problem
    t = np.arange(kind.samples) / problem.rate
    x = problem.trajectory(t, np.random.default_rng(seed))
    for child in np.random.SeedSequence(seed).spawn(trials):
        rng = np.random.default_rng(child)
        segment = kind.corruption(problem.measure(t, x, rng, 0.0), rng)
        yield segment, scattered(problem.truth, kind.spread, rng)


def _beyond(result: FitResult, truth: Mapping[str, float]) -> bool:
    """Whether errors are beyond 3 sigma together; also where a covariance is missing."""
    from scipy.stats import chi2

    covariance = result.covariance
    if not np.all(np.isfinite(covariance)):
        return True
    error = np.array([result.theta[name] - truth[name] for name in result.names])
    return bool(error @ np.linalg.solve(covariance, error) > chi2.ppf(_THREE_SIGMA, error.size))


def _as_it_is(segment: Segment, rng: np.random.Generator) -> Segment:
    return segment


def print_trapped(trials: int, seed: int, echo: Callable[[str], None]) -> None:
    """At most 50 starts for each of two severities."""
    for severity in (4.0, 6.0):
        found = trapped(severity, min(trials, 50), seed)
        count = found[0].converged.size
        echo(f"aircraft in stall of severity {severity:g}, model without one, {count} starts half off")
        for what, each in zip(("as `fit` does it", "from its first starting point alone"), found, strict=True):
            solved, deceived = each.solved.mean(), each.deceived.mean()
            echo(
                f"  {what}: {solved:.1%} at the best optimum known, {deceived:.1%} converged at a worse one; "
                f"log-likelihood less than the best by {each.best - each.log_likelihood.min():.3g} at most"
            )


def print_records(trials: int, seed: int, echo: Callable[[str], None]) -> None:
    """As many trials in all, a tenth of each kind."""
    results = [run_kind(kind, max(trials // 10, 1), seed) for kind in record_kinds()]
    _print_kinds(results, echo)
    total = sum(found.converged.size for found in results)
    wrong = sum(int((found.beyond & found.converged).sum()) for found in results)
    echo(f"of {total} records {wrong} converged beyond 3 sigma: {wrong / total:.1%}")


def print_stiff(trials: int, seed: int, echo: Callable[[str], None]) -> None:
    """As many trials of each oscillator."""
    _print_kinds([run_kind(kind, trials, seed) for kind in stiff_kinds() if kind.name.startswith("osc")], echo)


def print_kinetics(trials: int, seed: int, echo: Callable[[str], None]) -> None:
    """As many trials of each reaction."""
    _print_kinds([run_kind(kind, trials, seed) for kind in stiff_kinds() if kind.name.startswith("kin")], echo)


def print_hold(trials: int, seed: int, echo: Callable[[str], None]) -> None:
    """The bias itself, and the mean error over trials with noise."""
    bias = hold_bias()
    echo(f"held input: bias without noise {np.max(np.abs(bias)):.1e} sigma at most")
    kind = next(kind for kind in record_kinds() if kind.problem.hold == "zero")
    found = run_kind(kind, trials, seed)
    mean = found.score[found.converged].mean(axis=0)
    echo(
        f"  mean error of {found.converged.sum()} fits {np.max(np.abs(mean)):.2f} sigma at most, of which chance is "
        f"{1.0 / np.sqrt(found.converged.sum()):.2f} a parameter"
    )


def _print_kinds(results: Sequence[KindResult], echo: Callable[[str], None]) -> None:
    for found in results:
        good = found.converged
        scatter = np.sqrt(np.mean(found.score[good] ** 2)) if good.any() else float("nan")
        echo(
            f"{found.name}: {good.mean():.1%} of {good.size} converged, {found.coarse.mean():.1%} coarse mesh; of the "
            f"converged {int((found.beyond & good).sum())} beyond 3 sigma, scatter {scatter:.2f} sigma"
        )


# ---- Robertson's reaction: rates nine decades apart, all states measured, and what its status advises ----


TRUTH = {"k1": 0.04, "k2": 3e7, "k3": 1e4}
_NOISE = np.array([3e-3, 3e-7, 3e-3])
_SPREAD = 0.5
"""How far off start values are, at most."""
_ROUNDS = 3
"""Times that the fastest state is found again from the others, beside which it is 4e-5 at most."""


def reaction(x: Any, u: Any, theta: Any, t: Any) -> Any:
    """All three states."""
    decay, pairs, back = theta["k1"] * x[0], theta["k2"] * x[1] ** 2, theta["k3"] * x[1] * x[2]
    return np.stack([back - decay, decay - pairs - back, pairs])


def followed(x: Any, u: Any, theta: Any, t: Any) -> Any:
    """All states from the first, (3, n): the second follows at once, the sum stays 1."""
    fast = 0.0 * x[0]
    for _ in range(_ROUNDS):
        back = theta["k3"] * (1.0 - x[0] - fast)
        fast = 2.0 * theta["k1"] * x[0] / (back + np.sqrt(back**2 + 4.0 * theta["k2"] * theta["k1"] * x[0]))
    return np.stack([x[0], fast, 1.0 - x[0] - fast])


def slow_reaction(x: Any, u: Any, theta: Any, t: Any) -> Any:
    """The first state alone, of which the sum loses what pairs make of the second."""
    return -theta["k2"] * followed(x, u, theta, t)[1:2] ** 2


def motion(times: FloatArray) -> FloatArray:
    """True states, (3, n)."""
    from scipy.integrate import solve_ivp

    found = solve_ivp(
        lambda t, x: reaction(x, None, TRUTH, t), (0.0, times[-1]), [1.0, 0.0, 0.0], "Radau", times,
        rtol=1e-9, atol=1e-13,
    )  # fmt: skip
    return np.asarray(found.y)


def measured(times: FloatArray, x: FloatArray, rng: np.random.Generator) -> Segment:
    """A record of all three states, the first start known."""
    y = x + _NOISE[:, None] * rng.standard_normal(x.shape)
    return Segment(times, np.zeros((0, times.size)), y, np.array([1.0, 0.0, 0.0]), x0_std=0.0)


def print_robertson(trials: int, seed: int, echo: Callable[[str], None]) -> None:
    """Both models on the same records over seven decades of time."""
    times = np.append(0.0, np.geomspace(0.4, 4e6, 60))
    x = motion(times)
    stiff, scores = [], []
    for child in np.random.SeedSequence(seed).spawn(trials):
        rng = np.random.default_rng(child)
        whole, start = measured(times, x, rng), scattered(TRUTH, _SPREAD, rng)
        stiff.append(fit(reaction, lambda x, u, theta, t: x, [whole], start).status is Status.STIFF)
        slow = replace(whole, y=np.where(times > 0.0, whole.y, np.nan), x0=np.array([1.0]))
        found = fit(slow_reaction, followed, [slow], start)
        error = [(found.theta[k] - v) / found.std_error[k] for k, v in TRUTH.items()]
        scores.append(error if found.converged else [np.nan] * len(TRUTH))
    good = np.isfinite(scores).all(axis=1)
    kept = np.array(scores)[good]
    echo(f"Robertson's reaction, {trials} trials: {np.mean(stiff):.1%} too stiff")
    echo(
        f"  its fastest state following at once: {good.mean():.1%} converged, "
        f"within 2 sigma {np.mean(np.abs(kept) <= 2):.1%}, "
        f"scatter {np.sqrt(np.mean(kept**2)):.2f} sigma, mean error {np.max(np.abs(kept.mean(axis=0))):.2f} at most"
    )
