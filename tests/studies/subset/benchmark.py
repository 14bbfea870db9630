"""``python -m tests.studies.subset.benchmark``: the exact search beside R leaps on the same data, in the same run.

R with the package leaps (Debian: r-cran-leaps) is called through Rscript where it is installed. Times of one thread
are CPU seconds, which other work on the machine does not lengthen: for this package the whole of ``best_subsets``,
best of ``--repeats`` after one call that loads the kernel; for leaps its ``regsubsets`` call alone, without the start
of R. Times of several threads are wall clock. ``--curve`` runs three problems over a range of noise, from R^2 0.3 to
0.9999: how hard a search is depends on that more than on anything else. ``--long`` runs one of them to 15 terms,
which ends with its gap where the noise is large. ``--to-target`` stops leaps once it has taken the target times as
long, which is then the lower bound of the ratio.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from math import ceil
from pathlib import Path

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.subset import SubsetResult, best_subsets
from brv_hypo.subset.criteria import least_squares
from tests.studies.subset.problems import (
    correlated_problem,
    delay_problem,
    polynomial_problem,
    spline_problem,
    with_r_squared,
)
from tests.subset.kernels import best_subsets_by

# Prints the seconds, then one line a size: the columns chosen (1 is the first after the constant).
LEAPS = """
suppressMessages(library(leaps)); a <- commandArgs(TRUE)
d <- as.matrix(read.csv(a[1], header = FALSE)); k <- as.integer(a[2])
s <- system.time(r <- suppressWarnings(regsubsets(d[, -1], d[, 1], nvmax = k, method = "exhaustive",
                                                  really.big = TRUE)))
cat(s[1] + s[2], "\\n"); w <- summary(r)$which[, -1, drop = FALSE]
for (i in seq_len(nrow(w))) cat(which(w[i, ]), "\\n")
"""

START_OF_R_S = 2.0

CURVE_ROW = "{:20}{:>4}{:>8}{:>10}{:>10}{:>11}{:>9}  {}"
ROW = "{:24}{:>4}{:>9}{:>10}{:>10}{:>11}{:>8}  {}"


@dataclass(frozen=True)
class Case:
    """One row of the table; ``target``: the ratio to leaps to reach, ``limit_s``: seconds not to exceed."""

    name: str
    problem: Callable[[], tuple[FloatArray, FloatArray]]
    terms: int
    leaps: bool = True
    threads: int = 1
    target: float = 1.0
    limit_s: float = float("inf")


CASES = (
    Case("60 spline columns", spline_problem, 8),
    Case("60 spline columns", spline_problem, 10, target=80.0),
    Case("60 spline columns", spline_problem, 12, leaps=False, threads=2, limit_s=1.5),
    Case("60 spline columns", spline_problem, 15, leaps=False, threads=2, limit_s=12.0),
    Case("62 delay columns", delay_problem, 10, target=100.0),
    Case("80 spline columns", lambda: spline_problem(20), 8, target=80.0),
    Case("80 spline columns", lambda: spline_problem(20), 10, leaps=False),
    Case("28 polynomial columns", polynomial_problem, 10),
    Case("28 polynomial columns", polynomial_problem, 15),
    Case("40 correlated columns", correlated_problem, 39),
)

SHARES = (0.3, 0.6, 0.9, 0.99, 0.999, 0.9999)
CURVES = (
    Case("60 spline columns", lambda: spline_problem(noise=0.0), 10, target=80.0),
    Case("80 spline columns", lambda: spline_problem(20, noise=0.0), 8, target=80.0),
    Case("62 delay columns", lambda: delay_problem(noise=0.0), 10, target=100.0),
)


# Terms, threads and wall-clock seconds of the search that may end with its gap.
LONG_TERMS, LONG_THREADS, LONG_LIMIT_S = 15, 2, 12.0


def main() -> None:
    """Run every case and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=3, help="timed calls of this package, best counts")
    parser.add_argument("--leaps-limit", type=float, default=900.0, help="seconds that leaps may take a case")
    parser.add_argument("--to-target", action="store_true", help="stop leaps where the target ratio is reached")
    parser.add_argument("--only", default="", help="only the cases whose name contains this")
    parser.add_argument("--curve", action="store_true", help="the cases over a range of noise")
    parser.add_argument("--long", action="store_true", help="15 of 60 spline columns, two threads")
    parser.add_argument("--shares", type=float, nargs="+", default=SHARES, help="R^2 of the points of the curve")
    parser.add_argument("--limit", type=float, default=60.0, help="seconds for this package on the curve")
    options = parser.parse_args()
    with_leaps = shutil.which("Rscript") is not None
    load = os.getloadavg()[0]
    print(f"{os.cpu_count()} cores, load {load:.1f}; R leaps {'found' if with_leaps else 'absent'}")
    allowed = _Allowed(options.leaps_limit if with_leaps else 0.0, options.to_target)
    best_subsets_by("numba-schur", *spline_problem(5), 3)  # loads the kernel
    if options.long:
        _print_long(options.shares)
        return
    if options.curve:
        _print_curve(options.only, options.shares, options.repeats, options.limit, allowed)
        return
    print(ROW.format("problem", "k", "threads", "here [s]", "nodes", "leaps [s]", "ratio", "verdict"))
    for case in CASES:
        if options.only in case.name:
            _run(case, options.repeats, allowed)


@dataclass(frozen=True)
class _Allowed:
    """CPU seconds that leaps is given for a case, no more than the target ratio needs where that is requested."""

    limit_s: float
    to_target: bool

    def seconds(self, case: Case, ours: float) -> float:
        """The limit where this package took `ours`; 0 where leaps is not to run."""
        return min(self.limit_s, case.target * ours) if self.to_target else self.limit_s


def _print_curve(only: str, shares: Sequence[float], repeats: int, limit_s: float, allowed: _Allowed) -> None:
    """One row for each problem and R^2; a limit that struck is shown as such, with the gap that was proved."""
    print(CURVE_ROW.format("problem", "k", "R^2", "here [s]", "nodes", "leaps [s]", "ratio", "verdict"))
    for case in CURVES:
        if only not in case.name:
            continue
        for share in shares:
            X, y = with_r_squared(case.problem(), share)
            seconds, point = min(
                (timed(lambda: curve_point(case, share, limit_s)) for _ in range(repeats)),  # noqa: B023
                key=lambda pair: pair[0],
            )
            certificate = point.certificate
            verdict = "" if certificate.exact else f"stopped, gap {certificate.gap:.2%}"
            theirs, ratio, compared = _beside(X, y, case, point, seconds, allowed)
            row = (case.name, case.terms, f"{share:g}", f"{seconds:.4f}", certificate.nodes)
            print(CURVE_ROW.format(*row, theirs, ratio, verdict or compared), flush=True)


def _print_long(shares: Sequence[float]) -> None:
    """For each R^2 the seconds and the nodes, or where the limit struck the certified gap of the sizes not proved."""
    for share in shares:
        X, y = with_r_squared(spline_problem(noise=0.0), share)
        certificate = best_subsets(X, y, LONG_TERMS, threads=LONG_THREADS, time_limit_s=LONG_LIMIT_S).certificate
        proved = sum(gap == 0.0 for gap in certificate.gaps)
        print(
            f"R^2 {share:g}: {certificate.seconds:.2f} s, {certificate.nodes} nodes, "
            f"{proved} of {LONG_TERMS} sizes proved, gap {certificate.gap:.2%}",
            flush=True,
        )


def timed(search: Callable[[], SubsetResult]) -> tuple[float, SubsetResult]:
    """CPU seconds and what was found."""
    began = time.process_time()
    found = search()
    return time.process_time() - began, found


def _beside(
    X: FloatArray, y: FloatArray, case: Case, result: SubsetResult, seconds: float, allowed: _Allowed
) -> tuple[str, str, str]:
    """What leaps takes, the ratio and the verdict, as printed; ">" where leaps was stopped."""
    limit = allowed.seconds(case, seconds)
    if limit <= 0.0:
        return "-", "-", ""
    answer = _leaps(X, y, case.terms, limit)
    took = limit if answer is None else answer.seconds
    more = ">" if answer is None else ""
    met = took >= case.target * seconds
    verdict = f"target {case.target:g} {'met' if met else 'not shown' if answer is None else 'MISSED'}"
    if answer is not None:
        verdict += f"; {_compared(X, y, result, answer)}"
    return f"{more}{took:.3f}", f"{more}{took / seconds:.1f}", verdict


def curve_point(case: Case, share: float, limit_s: float) -> SubsetResult:
    """The case with noise that leaves the true model this R^2, searched for no longer than the limit."""
    X, y = with_r_squared(case.problem(), share)
    return best_subsets(X, y, case.terms, time_limit_s=limit_s)


def _run(case: Case, repeats: int, allowed: _Allowed) -> None:
    X, y = case.problem()
    clock = time.process_time if case.threads == 1 else time.perf_counter
    seconds, result = float("inf"), best_subsets(X, y, case.terms, threads=case.threads)
    for _ in range(repeats):
        started = clock()
        result = best_subsets(X, y, case.terms, threads=case.threads)
        seconds = min(seconds, clock() - started)
    ours = (case.name, case.terms, case.threads, f"{seconds:.4f}", result.certificate.nodes)
    if case.leaps and allowed.limit_s > 0.0:
        print(ROW.format(*ours, *_beside(X, y, case, result, seconds, allowed)), flush=True)
        return
    verdict = "within the limit" if seconds <= case.limit_s else f"OVER the limit of {case.limit_s} s"
    print(ROW.format(*ours, "-", "-", verdict if np.isfinite(case.limit_s) else ""), flush=True)


@dataclass(frozen=True)
class _Answer:
    seconds: float
    subsets: dict[int, tuple[int, ...]]


def _leaps(X: FloatArray, y: FloatArray, terms: int, limit_s: float) -> _Answer | None:
    """What R leaps takes and finds; None where it does not finish in its CPU seconds."""
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder) / "problem.csv"
        np.savetxt(data, np.column_stack([y, X[:, 1:]]), delimiter=",", fmt="%.17g")
        script = Path(folder) / "leaps.R"
        script.write_text(LEAPS)
        command = ["Rscript", str(script), str(data), str(terms)]
        try:
            run = subprocess.run(
                command, capture_output=True, text=True, check=True, preexec_fn=partial(_limit_cpu, limit_s)
            )
        except subprocess.CalledProcessError:
            return None
    lines = run.stdout.splitlines()
    subsets = [tuple(int(c) for c in line.split()) for line in lines[1:]]
    return _Answer(float(lines[0]), {len(s): s for s in subsets})


def _limit_cpu(seconds: float) -> None:
    """End this process once it has used so many CPU seconds beside those of the start of R."""
    whole = ceil(seconds + START_OF_R_S)
    resource.setrlimit(resource.RLIMIT_CPU, (whole, whole))


def _compared(X: FloatArray, y: FloatArray, result: SubsetResult, answer: _Answer) -> str:
    """Where the answers differ, both fitted in the same way."""
    worse: list[int] = []
    better: list[int] = []
    missing: list[int] = []
    for subset in result.subsets:
        theirs = answer.subsets.get(subset.size)
        if theirs is None:
            missing.append(subset.size)
        elif theirs != subset.columns:
            rss = least_squares(X[:, [0, *theirs]], y).rss
            (worse if rss > subset.rss else better).append(subset.size)
    notes = [
        f"leaps {what} at sizes {sizes}"
        for what, sizes in (("is beaten", worse), ("FINDS BETTER", better), ("loses a model", missing))
        if sizes
    ]
    return "; ".join(notes) or "same subsets"


if __name__ == "__main__":
    main()
