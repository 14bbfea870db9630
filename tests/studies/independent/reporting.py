"""Studies by hand: every flight in a line as it is done, the counts at the end."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar

from joblib import Parallel

Outcome = TypeVar("Outcome")


def fly_and_report(
    runs: Iterable[Any], jobs: int, line: Callable[[Outcome], str], report: Callable[[Sequence[Outcome]], Iterable[str]]
) -> None:
    """Print what delayed calls come to; one that says in words why nothing came of it is not counted."""
    outcomes: list[Outcome] = []
    for found in Parallel(n_jobs=jobs, return_as="generator")(runs):
        print(found if isinstance(found, str) else line(found), flush=True)
        if not isinstance(found, str):
            outcomes.append(found)
    print("\n".join(report(outcomes)))
