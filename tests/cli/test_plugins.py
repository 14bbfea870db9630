"""Plugins and mechanisms as the command line names them."""

from __future__ import annotations

import json

import pytest

REGRESSION = "maximum_likelihood: none\nknot_count: 3\nmax_terms: 2\nexact_terms: 2\n"
GOOD = """
from brv_hypo.mechanisms import Mechanism, Term

class Own(Mechanism):
    name, title, claims, source = "own", "own", "a moment of one's own", "a test"

    def terms(self, motion, theta):
        print("talking")
        return (Term("C_own", 0.0 * motion.alpha, motion.alpha**2, "1/rad^2"),)

def brv_hypo_mechanisms():
    return [Own()]
"""


@pytest.mark.parametrize("given", ["", " ", ",", " , "])
@pytest.mark.parametrize("command", [["compare", "flight.h5"], ["demo"]])
def test_an_empty_list_of_mechanisms_is_wrong_usage(brv_hypo, tmp_path, command, given):
    done = brv_hypo(*command, "--mechanisms", given, cwd=tmp_path)
    assert done.returncode == 2
    assert "--mechanisms names none" in done.stderr


def test_an_empty_list_in_a_configuration_is_wrong_usage(brv_hypo, tmp_path):
    (tmp_path / "config.yaml").write_text("mechanisms: []")
    done = brv_hypo("compare", "flight.h5", "--config", "config.yaml", cwd=tmp_path)
    assert done.returncode == 2
    assert "'mechanisms'" in done.stderr


@pytest.mark.thorough
def test_a_file_s_mechanism_is_compared(brv_hypo, nominal_file, tmp_path):
    (tmp_path / "own.py").write_text(GOOD)
    (tmp_path / "settings.yaml").write_text(REGRESSION)
    chosen = ("--mechanisms", "own", "--config", tmp_path / "settings.yaml")
    arguments = ("--plugin", tmp_path / "own.py", *chosen, "--json", "-")
    done = brv_hypo("compare", nominal_file, *arguments)
    assert done.returncode == 0, done.stderr
    assert {row["mechanism"] for row in json.loads(done.stdout)["ranking"]} == {"none", "own"}


@pytest.mark.parametrize("command", [("compare", "flight.h5"), ("mechanisms",), ("simulate", "demo", "-o", "f.h5")])
def test_a_file_that_cannot_be_used_is_refused_before_anything_is_done(brv_hypo, tmp_path, command):
    (tmp_path / "bad.py").write_text(GOOD.replace('print("talking")', "raise OSError('gone')"))
    done = brv_hypo(*command, "--plugin", "bad.py", cwd=tmp_path)
    assert done.returncode == 2
    assert f"'own' of {tmp_path}/bad.py breaks its contract ({tmp_path}/bad.py, line 8)" in done.stderr
    assert "Repair it, or leave out --plugin" in done.stderr
    assert done.stdout == ""


@pytest.mark.parametrize("name", ["absent.py", "pipe.txt"])
def test_what_is_no_plugin_is_wrong_usage(brv_hypo, tmp_path, name):
    (tmp_path / "pipe.txt").write_text("")
    done = brv_hypo("mechanisms", "--plugin", name, cwd=tmp_path)
    assert done.returncode == 2
    assert name in done.stderr


def test_the_list_is_whole_on_a_narrow_terminal_and_names_where_a_plugin_came_from(brv_hypo, tmp_path):
    """No claim ends in an ellipsis, and none is squeezed into a column of single words."""
    (tmp_path / "own.py").write_text(GOOD)
    done = brv_hypo("mechanisms", "--plugin", "own.py", cwd=tmp_path, COLUMNS="80")
    lines = done.stdout.splitlines()
    assert "…" not in done.stdout
    assert max(map(len, lines)) <= 80
    assert len(lines) < 110
    (own,) = (number for number, line in enumerate(lines) if line.startswith("own "))
    assert "package: " in lines[own + 1]
