"""`python -m tests.harness.fuzz`: the fuzzing command; exits with 1 where an input fails."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path

from tests.harness.fuzz.run import failure_of, inputs


def main() -> int:
    """Run the inputs, print what failed and a line at the end."""
    parser = argparse.ArgumentParser(prog="python -m tests.harness.fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--save", type=Path, help="folder for the inputs that fail, made as small as they could be")
    options = parser.parse_args()
    tried: Counter[str] = Counter()
    failures = []
    for case in inputs(options.inputs, options.seed):
        tried[case.target.label] += 1
        failure = failure_of(case, options.save)
        if failure is not None:
            failures.append(failure)
            print(f"{case.target.label} {failure.input.seeds} {failure.operations}: {failure.problem}", flush=True)
    print(f"{sum(tried.values())} inputs, {len(failures)} failed; {dict(tried)}")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
