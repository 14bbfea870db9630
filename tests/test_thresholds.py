"""What decides a fault of a record is in one file, each entry with its unit, its meaning and its source."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import brv_hypo
from brv_hypo import thresholds
from brv_hypo.thresholds import THRESHOLDS, Threshold

PACKAGE = Path(brv_hypo.__file__).parent
NAMES = [
    node.targets[0].id
    for node in ast.parse(Path(thresholds.__file__).read_text()).body
    if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id.isupper()
    if not node.targets[0].id.startswith("_") and isinstance(node.value, ast.Call)
]


def test_few_enough_to_be_read() -> None:
    assert len(NAMES) == len(THRESHOLDS) <= 120


@pytest.mark.parametrize("entry", THRESHOLDS, ids=NAMES)
def test_each_says_what_it_decides(entry: Threshold) -> None:
    assert entry.unit
    assert len(entry.decides.split()) >= 3
    assert entry.source


def test_a_named_study_or_test_exists() -> None:
    root = Path(__file__).parents[1]
    for entry in THRESHOLDS:
        for word in entry.source.replace(",", " ").replace(";", " ").split():
            if word.startswith("tests/"):
                assert (root / word.rstrip(".")).exists(), entry
            elif word.startswith("tests."):
                path = root / word.rstrip(".").replace(".", "/")
                assert path.is_dir() or path.with_suffix(".py").is_file(), entry


def test_each_is_used() -> None:
    used = "\n".join(path.read_text() for path in PACKAGE.rglob("*.py") if path.name != "thresholds.py")
    assert [name for name in NAMES if name not in used] == []
