"""The names that scripts import from `brv_hypo`, whatever was imported before."""

from __future__ import annotations

import subprocess
import sys

import pytest

import brv_hypo

NAMES = ("load_flight", "reconstruct", "compare", "simulate")


def run(code):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    "before", ["import brv_hypo.simulation", "pass", "from brv_hypo.simulation import config_path"]
)
@pytest.mark.thorough
def test_the_public_names_are_functions(before):
    check = f"from brv_hypo import {', '.join(NAMES)}; print(all(map(callable, ({', '.join(NAMES)}))))"
    done = run(f"{before}; {check}; import brv_hypo; print(callable(brv_hypo.simulate))")
    assert done.stdout.split() == ["True", "True"], done.stderr


def test_the_package_costs_nothing_to_import():
    done = run("import sys, brv_hypo; print({'numpy', 'pydantic', 'scipy'} & set(sys.modules))")
    assert done.stdout.strip() == "set()", done.stderr


def test_every_name_is_a_function_here():
    assert all(callable(getattr(brv_hypo, name)) for name in NAMES)


def test_an_unknown_name_is_refused():
    with pytest.raises(AttributeError, match="has no attribute 'nonsense'"):
        _ = brv_hypo.nonsense


def test_the_map_in_the_docstring_names_every_public_function():
    assert all(f"\n{name}(" in brv_hypo.__doc__ for name in brv_hypo.__all__)
    functions, _, places = brv_hypo.__doc__.strip().partition("\n\nWhere things are")
    assert len(functions.splitlines()) <= 12
    assert len(places.splitlines()) <= 4
