"""Statistics of `fit` over many simulated records: `python -m tests.studies.likelihood.study`.

coverage: how often 95 % intervals contain the truth, with white and with coloured noise, and the spread of the
estimates against the Cramer-Rao bound. hard: unstable motion, started half off, beside single shooting.
delay: a delay started a tenth of a second off. filter: coverage of parameters and of both noises, all estimated.
trapped: a model without the stall that was flown. records: gaps, missing samples, held inputs, coarse grids. hold: the
bias of a held input. stiff, kinetics: standard errors of motion that is fast for its samples. See `hard_study` for
these five. robertson: a reaction that is too stiff, and the remedy of its status.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.likelihood.fit import fit
from brv_hypo.likelihood.result import FitResult
from brv_hypo.likelihood.segment import Segment
from tests.studies.likelihood.hard_study import (
    print_hold,
    print_kinetics,
    print_records,
    print_robertson,
    print_stiff,
    print_trapped,
)
from tests.studies.likelihood.problems import ModelProblem, growing_body, lagging_body, short_period, spinning_body
from tests.studies.likelihood.single_shooting import fit_single_shooting

_NINETY_FIVE = 1.959964
_SAME_MINIMUM = 0.5
"""Difference in NLLF to the fit that starts at the truth below which a fit found the same minimum."""


@dataclass(frozen=True)
class Coverage:
    """Share of trials in which each parameter's 95 % interval contains the truth.

    `white` and `coloured` (p,) are the shares without and with the correction; `efficiency` (p,) the rms
    error over the Cramer-Rao bound (white noise of known covariance); `converged` the share of trials that
    converged.
    """

    names: tuple[str, ...]
    white: FloatArray
    coloured: FloatArray
    efficiency: FloatArray
    converged: float


@dataclass(frozen=True)
class HardMotion:
    """Trial by trial, (trials,): whether each method reached the minimum found from the truth."""

    growth: float
    collocation: BoolArray
    iterations: FloatArray
    shooting: BoolArray


@dataclass(frozen=True)
class DelayStudy:
    """Trial by trial, (trials,): error of the delay in standard errors, and in s; whether it converged."""

    score: FloatArray
    error: FloatArray
    converged: BoolArray


@dataclass(frozen=True)
class FilterStudy:
    """Trial by trial: errors in standard errors of `theta` (trials, p), of the standard deviations of `process`
    (trials, n_states) and `measurement` noise (trials, n_outputs); iterations, wall time in s, convergence (trials,).
    """

    theta: FloatArray
    process: FloatArray
    measurement: FloatArray
    iterations: FloatArray
    seconds: FloatArray
    converged: BoolArray


def coverage(problem: ModelProblem, samples: int, trials: int, seed: int, correlation: float = 0.0) -> Coverage:
    """Coverage over records that differ in their noise, started at 0.8 of the truth."""
    names = tuple(problem.truth)
    truth = np.array(list(problem.truth.values()))
    start = problem.start(0.8)
    errors, white, coloured, converged = [], [], [], []
    for segment in _records(problem, samples, trials, seed, correlation):
        result = fit(problem.dynamics, problem.outputs, [segment], start)
        converged.append(result.converged)
        errors.append(np.array([result.theta[name] for name in names]) - truth)
        white.append([result.std_error[name] for name in names])
        coloured.append([result.std_error_coloured[name] for name in names])
    error = np.abs(errors)
    return Coverage(
        names=names,
        white=np.mean(error <= _NINETY_FIVE * np.array(white), axis=0),
        coloured=np.mean(error <= _NINETY_FIVE * np.array(coloured), axis=0),
        efficiency=np.sqrt(np.mean(error**2, axis=0)) / cramer_rao(problem, samples),
        converged=float(np.mean(converged)),
    )


def cramer_rao(problem: ModelProblem, samples: int) -> FloatArray:
    """Least standard error of each parameter, (p,): the information at the truth, noise white and known."""
    quiet = replace(problem, noise=np.zeros_like(problem.noise), process_noise=None)
    known = problem.noise**2
    segment = quiet.simulate(samples, seed=0)
    exact = fit(problem.dynamics, problem.outputs, [segment], problem.truth, noise=known)
    return np.sqrt(np.diag(exact.covariance))


def hard_motion(trials: int, seed: int, samples: int = 75, shooting: bool = True) -> HardMotion:
    """Unstable motion whose angle of attack grows about twentyfold in 2 s, every start value half off, up or
    down.

    Single shooting starts from the same values and is given the true initial state.
    """
    problem = growing_body()
    rng = np.random.default_rng(seed)
    ours, theirs, iterations = [], [], []
    for segment in _records(problem, samples, trials, seed, 0.0):
        start = {name: value * (1 + 0.5 * rng.choice([-1.0, 1.0])) for name, value in problem.truth.items()}
        reference = fit(problem.dynamics, problem.outputs, [segment], problem.truth)
        result = fit(problem.dynamics, problem.outputs, [segment], start)
        ours.append(_same(result.converged, result.nllf, reference))
        iterations.append(float(result.iterations))
        if shooting:
            known = replace(segment, x0=problem.x0)
            shot = fit_single_shooting(problem.dynamics, problem.outputs, [known], start, substeps=1, max_iterations=50)
            theirs.append(_same(shot.status == "converged", shot.nllf, reference))
    return HardMotion(growth_in_two_seconds(problem), np.array(ours), np.array(iterations), np.array(theirs))


def growth_in_two_seconds(problem: ModelProblem) -> float:
    """Largest angle of attack in the half second after 2 s over that in the first half second."""
    t = np.arange(0, 75) / 25.0
    x = problem.trajectory(t, np.random.default_rng(0))
    angle = np.hypot(x[2], x[3])
    return float(angle[(t >= 2.0) & (t < 2.5)].max() / angle[t < 0.5].max())


def delay(trials: int, seed: int, start: float, samples: int = 1000) -> DelayStudy:
    """The delay of 0.2 s, started at `start`, the other parameters 0.7 of the truth."""
    problem = lagging_body()
    theta0 = problem.start(0.7) | {"delay": start}
    score, error, converged = [], [], []
    for segment in _records(problem, samples, trials, seed, 0.0):
        result = fit(problem.dynamics, problem.outputs, [segment], theta0, delays=problem.delays)
        error.append(result.theta["delay"] - problem.truth["delay"])
        score.append(error[-1] / result.std_error["delay"])
        converged.append(result.converged)
    return DelayStudy(np.array(score), np.array(error), np.array(converged))


def filter_error(trials: int, seed: int, samples: int = 500) -> FilterStudy:
    """The short period in turbulence; parameters start at 0.8 of the truth, process noise at twice it."""
    drive = np.array([0.005, 0.03])
    problem = replace(short_period(), process_noise=drive)
    start = problem.start(0.8)
    theta, process, measurement, iterations, seconds, converged = [], [], [], [], [], []
    for segment in _records(problem, samples, trials, seed, 0.0):
        began = time.perf_counter()
        result = fit(problem.dynamics, problem.outputs, [segment], start, 2.0 * drive, estimate_process_noise=True)
        seconds.append(time.perf_counter() - began)
        converged.append(result.converged)
        iterations.append(result.iterations)
        theta.append(problem.score(result))
        process.append((result.process_noise - drive) / result.process_noise_std_error)
        noise = np.sqrt(result.noise_variance)
        measurement.append((noise - problem.noise) / result.noise_std_error)
    return FilterStudy(*map(np.array, (theta, process, measurement, iterations, seconds, converged)))


def _records(problem: ModelProblem, samples: int, trials: int, seed: int, correlation: float) -> Iterator[Segment]:
    """Records with fresh noise; the motion is simulated once unless process noise drives it."""
    t = np.arange(samples) / problem.rate
    x = problem.trajectory(t, np.random.default_rng(seed))
    for child in np.random.SeedSequence(seed).spawn(trials):
        rng = np.random.default_rng(child)
        motion = x if problem.process_noise is None else problem.trajectory(t, rng)
        yield problem.measure(t, motion, rng, correlation)


def _same(converged: bool, nllf: float, reference: FitResult) -> bool:
    return converged and nllf < reference.nllf + _SAME_MINIMUM


def _print_coverage(trials: int, seed: int, echo: Callable[[str], None]) -> None:
    for name, problem, samples in (("short period", short_period(), 1252), ("spinning body", spinning_body(), 1080)):
        for correlation in (0.0, 0.8):
            found = coverage(problem, samples, trials, seed, correlation)
            kind = "white noise" if correlation == 0 else f"noise correlated {correlation:g} from sample to sample"
            echo(f"{name}, {samples} samples, {trials} trials, {kind}: {found.converged:.1%} converged")
            echo(_shares("  95 % intervals cover", found.white))
            echo(_shares("  corrected for colour", found.coloured))
            if correlation == 0:
                pooled = np.sqrt(np.mean(found.efficiency**2))
                low, high = found.efficiency.min(), found.efficiency.max()
                echo(f"  rms error over the Cramer-Rao bound: {pooled:.3f} pooled, {low:.3f} to {high:.3f}")


def _print_filter(trials: int, seed: int, echo: Callable[[str], None]) -> None:
    found = filter_error(trials, seed)
    echo(f"process and measurement noise estimated, {trials} trials: {found.converged.mean():.1%} converged")
    most = int(found.iterations.max())
    echo(f"  {found.iterations.mean():.1f} iterations, at most {most}; {np.median(found.seconds):.2f} s each")
    for what, scores in (("parameters", found.theta), ("Q", found.process), ("R", found.measurement)):
        echo(
            f"  {what} within 2 sigma: {np.mean(np.abs(scores) <= 2):.1%}; rms {np.sqrt(np.mean(scores**2)):.2f} sigma"
        )


def _print_hard(trials: int, seed: int, echo: Callable[[str], None]) -> None:
    found = hard_motion(trials, seed)
    echo(f"unstable motion, alpha grows {found.growth:.0f} times in 2 s, start 50 % off, {trials} trials")
    echo(f"  collocation: {found.collocation.mean():.1%} converge, {found.iterations.mean():.1f} iterations")
    echo(f"  single shooting, given the true initial state: {found.shooting.mean():.1%}")


def _print_delay(trials: int, seed: int, echo: Callable[[str], None]) -> None:
    for start in (0.1, 0.3):
        found = delay(trials, seed, start)
        within = np.abs(found.score) <= 2
        echo(f"delay of 0.2 s started at {start:g} s, {trials} trials: {found.converged.mean():.1%} converged")
        echo(f"  within 2 sigma: {within.mean():.1%}; rms error {np.sqrt(np.mean(found.error**2)):.4f} s")


def _shares(what: str, shares: FloatArray) -> str:
    return f"{what}: {shares.mean():.1%} on average, {shares.min():.1%} to {shares.max():.1%} by parameter"


_STUDIES: dict[str, Callable[[int, int, Callable[[str], None]], None]] = {
    "coverage": _print_coverage,
    "hard": _print_hard,
    "delay": _print_delay,
    "filter": _print_filter,
    "trapped": print_trapped,
    "records": print_records,
    "hold": print_hold,
    "stiff": print_stiff,
    "kinetics": print_kinetics,
    "robertson": print_robertson,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the named studies, or all."""
    parser = argparse.ArgumentParser(prog="python -m tests.studies.likelihood.study", description=__doc__)
    parser.add_argument("studies", nargs="*", help=f"of {', '.join(_STUDIES)}; all where none is named")
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args(arguments)
    unknown = sorted(set(chosen.studies) - set(_STUDIES))
    if unknown:
        parser.error(f"unknown studies {unknown}; there are {list(_STUDIES)}")
    for name in chosen.studies or _STUDIES:
        _STUDIES[name](chosen.trials, chosen.seed, print)


if __name__ == "__main__":
    main()
