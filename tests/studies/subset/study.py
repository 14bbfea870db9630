"""``python -m tests.studies.subset.study``: the two constants of the compiled search beside others.

CPU seconds of ``best_subsets``, best of three, on the problems and some of the noise of the benchmark's curve. What is
found never depends on them.
"""

from __future__ import annotations

import argparse

from brv_hypo.subset import compiled
from tests.studies.subset.benchmark import CURVES, curve_point, timed
from tests.studies.subset.problems import spline_problem
from tests.subset.kernels import best_subsets_by

PAIRS = ((4, 3000), (3, 3000), (2, 3000), (4, 0), (4, 300), (4, 1000), (4, 10000))
SHARES = (0.3, 0.9, 0.99)


def main() -> None:
    """One row for each problem and R^2, one column for each pair of constants."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shares", type=float, nargs="+", default=SHARES, help="R^2 of the points of the curve")
    shares = parser.parse_args().shares
    best_subsets_by("numba-schur", *spline_problem(5), 3)  # loads the kernel
    print("CPU s with (scored, most prefixes)", *PAIRS)
    for case in CURVES:
        for share in shares:
            row = []
            for compiled.SCORED, compiled.MOST_PREFIXES in PAIRS:
                row.append(min(timed(lambda: curve_point(case, share, 60.0))[0] for _ in range(3)))  # noqa: B023
            print(f"{case.name}, R^2 {share:g}:", *(f"{seconds:.3f}" for seconds in row), flush=True)


if __name__ == "__main__":
    main()
