"""`python -m tests.harness.kill`: kill commands at random moments; exits with 1 where one leaves what it must not."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from pathlib import Path

from tests.harness.kill.commands import fly_inputs, write_inputs
from tests.harness.kill.run import Plan, Reference, judged, plans, reference


def main() -> int:
    """Carry the plans out, print what failed and a line at the end."""
    parser = argparse.ArgumentParser(prog="python -m tests.harness.kill", description=__doc__)
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--full", type=int, default=50, help="so many of them on a full disk")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="commands whose name holds this")
    options = parser.parse_args()
    usual: dict[str, Reference] = {}
    states: Counter[str] = Counter()
    with tempfile.TemporaryDirectory(prefix="kill.inputs.") as name:
        inputs = Path(name)
        write_inputs(inputs)
        fly_inputs(inputs)
        for plan in plans(options.runs, options.full, options.seed, options.only):
            label = plan.command.label
            if label not in usual:
                usual[label] = reference(plan.command, inputs)
            result = judged(plan, usual[label], inputs)
            states[f"{result.state}{', full disk' if plan.room is not None else ''}"] += 1
            if result.problem is not None:
                print(f"{_described(plan)}: {result.problem}", flush=True)
    print(f"{sum(states.values())} runs of {len(usual)} commands; {dict(states)}")
    return 1 if any(state.startswith("failed") for state in states) else 0


def _described(plan: Plan) -> str:
    when = f"{plan.after * 1e3:.1f} ms into writing" if plan.share is None else f"at {plan.share:.2f} of its time"
    place = "" if plan.room is None else f", disk for {plan.room:.2f} of the outputs"
    return f"{plan.command.label}, {when}{', old outputs' if plan.old else ''}{place}"


if __name__ == "__main__":
    sys.exit(main())
