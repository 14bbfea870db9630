"""The likelihood and the subset search work alone: copied out with four small modules they pass their tests."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import brv_hypo

PACKAGE = Path(brv_hypo.__file__).parent
TESTS = Path(__file__).parent
SMALL = ("arrays.py", "errors.py", "progress.py", "results.py")
FOREIGN = ("pydantic", "pluggy", "h5py", "rich", "typer", "pint", "statsmodels", "pandas")
BORROWED = {"test_manual.py", "test_accuracy.py", "test_published_answers.py", "test_criteria.py"}
"""Tests that need the manual, shared data or another package to compare with."""


@pytest.fixture
def empty(tmp_path: Path) -> Path:
    """A folder with the two kernels and their tests only."""
    home = tmp_path / "brv_hypo"
    for kernel in ("likelihood", "subset"):
        shutil.copytree(PACKAGE / kernel, home / kernel)  # with what numba has compiled, which takes half a minute
        shutil.copytree(
            TESTS / kernel, tmp_path / "tests" / kernel, ignore=shutil.ignore_patterns("__pycache__", *BORROWED)
        )
    for name in SMALL:
        shutil.copy(PACKAGE / name, home / name)
    (home / "__init__.py").touch()
    (tmp_path / "tests" / "__init__.py").touch()
    for kernel in ("likelihood", "subset"):
        shutil.copytree(TESTS / "studies" / kernel, tmp_path / "tests" / "studies" / kernel)
    (tmp_path / "tests" / "studies" / "__init__.py").touch()
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers =\n    slow\n    thorough\n")
    return tmp_path


def run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    command = [sys.executable, *arguments]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def test_they_import_without_the_rest_and_without_its_dependencies(empty: Path) -> None:
    script = (
        "import sys, brv_hypo.likelihood as l, brv_hypo.subset as s\n"
        "assert l.fit and s.best_subsets\n"
        f"print(l.__file__, sorted(set({FOREIGN}) & set(sys.modules)))"
    )
    done = run(empty, "-c", script)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(str(empty))
    assert done.stdout.rstrip().endswith("[]")


@pytest.mark.parametrize(
    ("files", "chosen"),
    [
        pytest.param(
            ("subset/test_dependent_columns.py", "likelihood/test_hold.py"),
            "not slow and not thorough",
            marks=pytest.mark.thorough,
        ),
        pytest.param(("likelihood", "subset"), "slow or not slow", marks=pytest.mark.slow),
    ],
)
def test_they_pass_their_tests_there(empty: Path, files: tuple[str, ...], chosen: str) -> None:
    paths = (f"tests/{file}" for file in files)
    done = run(empty, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-m", chosen, *paths)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]
