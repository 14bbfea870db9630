"""Mechanisms are found by entry point, by name, with helpful refusals."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from brv_hypo.errors import UsageError
from brv_hypo.mechanisms import find, find_installed, installed, mechanisms, parse_hypothesis, use_plugin_files
from brv_hypo.mechanisms.checked import fault
from tests.cli.conftest import brv_hypo

__all__ = ["brv_hypo"]

BUILT_IN = ("bodyfixed", "damping", "inplane", "lag", "sticking")


def test_the_five_built_ins_are_installed_with_their_package_and_version():
    found = installed()
    assert set(BUILT_IN) <= set(found)
    assert {found[name].package for name in BUILT_IN} == {"brv-hypo"}
    assert all(found[name].version for name in BUILT_IN)


def test_every_listed_mechanism_is_a_moment_mechanism():
    assert set(BUILT_IN) <= {mechanism.name for mechanism in mechanisms()}
    assert all(mechanism.kind == "mechanism" for mechanism in mechanisms())


@pytest.mark.parametrize(
    ("unknown", "meant"), [("stiking", "sticking"), ("bodyfix", "bodyfixed"), ("dampning", "damping")]
)
@pytest.mark.parametrize("look_up", [find, find_installed])
def test_an_unknown_name_is_refused_with_the_nearest(look_up, unknown, meant):
    with pytest.raises(UsageError, match=f"unknown mechanism '{unknown}'; did you mean .*{meant}"):
        look_up(unknown)


def test_a_name_that_is_like_none_lists_what_is_installed():
    with pytest.raises(UsageError, match=r"installed: .*sticking"):
        find("qqq")


def test_a_file_of_plugins_among_names_says_where_it_belongs():
    with pytest.raises(UsageError, match="--plugin"):
        find("mine.py")


def test_options_are_checked():
    assert find("sticking", {"form": "complete"}).form == "complete"
    with pytest.raises(UsageError, match=r"bad options for 'sticking': 'form': .* It has: form='printed' delays="):
        find("sticking", {"form": "square"})
    with pytest.raises(UsageError, match="bad options for 'damping'"):
        find("damping", {"colour": "red"})


@pytest.mark.parametrize("name", ["lag", "sticking"])
@pytest.mark.parametrize("delays", [[-1.0], [0.0, 0.1], [], [float("nan")], [float("inf")], ["a"]])
def test_delays_that_are_none_are_refused(name, delays):
    with pytest.raises(UsageError, match=f"bad options for '{name}': 'delays.*: expected .*got.* It has: .*delays="):
        find(name, {"delays": delays})


def test_options_are_checked_by_what_parameters_follow():
    with pytest.raises(UsageError, match="the grid of 'delay' does not increase"):
        find("lag", {"delays": [0.1, 0.05]})
    with pytest.raises(UsageError, match="'delay': grid or bounds are not finite"):
        find("lag", {"delays": [1e-3, 1.5e308]})


def test_a_hypothesis_joins_mechanisms_with_a_plus():
    assert [mechanism.name for mechanism in parse_hypothesis("sticking+bodyfixed")] == ["sticking", "bodyfixed"]
    assert parse_hypothesis("none") == ()


def test_options_reach_the_mechanism_that_they_name():
    (lag, sticking) = parse_hypothesis("lag+sticking", {"sticking": {"delays": (0.1, 0.2)}})
    assert sticking.delays == (0.1, 0.2)
    assert lag == find("lag")


def test_naming_a_mechanism_twice_is_refused():
    with pytest.raises(UsageError, match="twice"):
        parse_hypothesis("lag+lag")


@pytest.mark.parametrize("text", ["lag+", "", "+", "lag+none"])
def test_an_incomplete_hypothesis_is_refused(text):
    with pytest.raises(UsageError):
        parse_hypothesis(text)


@pytest.mark.slow  # the linter of imports says so of all that are written out
def test_the_engine_does_not_import_the_plugins():
    code = "import sys, brv_hypo.mechanisms; sys.exit('brv_hypo_mechanisms' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def plugin(folder, name, code):
    """An installed distribution of one module, found through its entry point."""
    (folder / f"{name}.py").write_text(code)
    metadata = folder / f"{name}-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(f"[brv_hypo.mechanisms]\n{name} = {name}\n")


def listing(folder, *arguments):
    """`brv-hypo mechanisms` as a process that has the distributions in `folder`."""
    paths = os.pathsep.join([str(folder), *(path for path in sys.path if path)])
    command = [sys.executable, "-m", "brv_hypo", "mechanisms", *arguments]
    return subprocess.run(command, env={**os.environ, "PYTHONPATH": paths}, capture_output=True, text=True, check=False)


@pytest.fixture
def listing_here(tmp_path, monkeypatch, brv_hypo):
    """The same in this process, which forgets the plugin afterwards."""
    with monkeypatch.context() as patch:
        patch.syspath_prepend(tmp_path)
        use_plugin_files(())
        yield lambda *arguments: brv_hypo("mechanisms", *arguments)
    for path in tmp_path.glob("*.py"):
        sys.modules.pop(path.stem, None)
    use_plugin_files(())


@pytest.mark.parametrize("arguments", [(), ("-q",), ("--json", "-")])
def test_a_plugin_that_cannot_be_imported_is_named_and_left_out(tmp_path, listing_here, arguments):
    plugin(tmp_path, "broken_plugin", "import no_such_module")
    done = listing_here(*arguments)
    assert done.returncode == 0
    assert "sticking" in done.stdout
    assert f"'broken_plugin' of broken_plugin breaks its contract ({tmp_path}/broken_plugin.py, line 1)" in done.stderr
    assert "no_such_module" in done.stderr
    assert "Traceback" not in done.stderr
    if "--json" in arguments:
        assert "no_such_module" in json.loads(done.stdout)["warnings"][0]


def test_an_unknown_name_that_was_left_out_is_explained(tmp_path, listing_here):
    plugin(tmp_path, "broken_plugin", "import no_such_module")
    with pytest.raises(UsageError, match=r"unknown mechanism 'broken_plugin'.*no_such_module"):
        find("broken_plugin")


def test_of_two_plugins_of_one_name_ours_is_kept_and_both_are_named(tmp_path, listing_here):
    plugin(tmp_path, "a_second_lag", "from brv_hypo_mechanisms.lag import brv_hypo_mechanisms")
    done = listing_here()
    assert done.returncode == 0
    assert "'lag' of a_second_lag has the name of one of brv-hypo" in done.stderr


@pytest.mark.thorough
def test_what_a_plugin_prints_is_not_in_the_json(tmp_path):
    plugin(tmp_path, "talking", "print('hello')\ndef brv_hypo_mechanisms(): return []")
    done = listing(tmp_path, "--json", "-")
    assert "hello" in done.stderr
    assert "warnings" not in json.loads(done.stdout)


def test_a_plugins_error_ends_in_one_full_stop():
    assert "are required. Repair it" in str(fault("four_lobes", "lobes.py", "ValueError: two are required."))
