"""The names that scripts import from `brv_hypo`, whatever was imported before."""

from __future__ import annotations

import subprocess
import sys

import pytest

NAMES = ("load_flight", "reconstruct", "compare", "simulate")


def run(code):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    "before",
    [
        "import brv_hypo.simulation",
        pytest.param("pass", marks=pytest.mark.slow),
        pytest.param("from brv_hypo.simulation import config_path", marks=pytest.mark.slow),
    ],
)
def test_the_public_names_are_functions(before):
    check = f"from brv_hypo import {', '.join(NAMES)}; print(all(map(callable, ({', '.join(NAMES)}))))"
    done = run(f"{before}; {check}; import brv_hypo; print(callable(brv_hypo.simulate))")
    assert done.stdout.split() == ["True", "True"], done.stderr


def test_the_package_costs_nothing_to_import():
    done = run("import sys, brv_hypo; print({'numpy', 'pydantic', 'scipy'} & set(sys.modules))")
    assert done.stdout.strip() == "set()", done.stderr


def test_an_unknown_name_is_refused():
    done = run("import brv_hypo; brv_hypo.nonsense")
    assert "has no attribute 'nonsense'" in done.stderr


def test_the_map_in_the_docstring_names_every_public_function():
    import brv_hypo

    assert all(f"\n{name}(" in brv_hypo.__doc__ for name in brv_hypo.__all__)
    assert len(brv_hypo.__doc__.strip().splitlines()) <= 12
