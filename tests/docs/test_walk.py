"""The walk goes through what the manual shows, in its order."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import pytest

from tests.docs.walk import TASKS, Walk

TYPED: list[list[str]] = []


class Noted(Walk):
    """A walk that writes down what it would run."""

    def _run(self, command: Sequence[str], exit_code: int) -> None:
        assert exit_code == 0
        TYPED.append(list(command))


@pytest.mark.parametrize(
    ("task", "expected"),
    [
        ("demo", ["demo"]),
        ("mechanism", [*["mechanisms", "simulate", "compare", "compare"] * 2]),
        ("effect", ["mechanisms", "mechanisms", "python", "trace"]),
        ("sisters", ["simulate", "trace", "simulate", "predict"]),
        ("seed", ["simulate", "inspect", "compare"]),
    ],
)
def test_a_task_types_what_is_shown(task, expected, tmp_path) -> None:
    TYPED.clear()
    TASKS[task](Noted(sys.executable, tmp_path))
    commands = [line[3] if line[1:3] == ["-m", "brv_hypo"] else "python" for line in TYPED]
    assert commands == expected
    assert all(line[0] == sys.executable for line in TYPED)


def test_a_command_with_an_unexpected_exit_code_ends_the_walk(tmp_path) -> None:
    with pytest.raises(SystemExit, match=r"(?s)brv_hypo no-such ended with 2: .*No such command"):
        Walk(sys.executable, tmp_path).typed("no-such")
