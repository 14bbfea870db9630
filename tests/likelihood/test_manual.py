"""The manual's pages on the two kernels: what they show runs, and what they claim of it is true."""

from __future__ import annotations

import re
from typing import Any

import pytest

from brv_hypo.docs import text, topics

_BLOCK = re.compile(r"```python\n(.*?)```", re.DOTALL)


def blocks(topic: str) -> list[str]:
    return _BLOCK.findall(text(topic))


LIKELIHOOD = blocks("likelihood")
CASES = {1: (1,), 2: (2,), 3: (1, 3), 4: (2, 4)}
"""Blocks that each worked case needs, beside the first."""
MARKS = dict.fromkeys((2, 3, 4), pytest.mark.thorough)


@pytest.mark.parametrize("case", [pytest.param(c, marks=MARKS.get(c, ())) for c in CASES])
def test_a_worked_case_of_the_likelihood_runs(case: int) -> None:
    names: dict[str, Any] = {}
    for block in (0, *CASES[case]):
        exec(compile(LIKELIHOOD[block], f"likelihood.md, block {block}", "exec"), names)
    assert names["result"].converged


def test_the_page_on_subsets_runs() -> None:
    names: dict[str, Any] = {}
    for number, block in enumerate(blocks("subset")):
        exec(compile(block, f"subset.md, block {number}", "exec"), names)
    assert names["cut"].certificate.nodes > 0


def test_both_pages_are_found() -> None:
    assert {"likelihood", "subset"} <= set(topics())
    assert len(LIKELIHOOD) == len(CASES) + 1
