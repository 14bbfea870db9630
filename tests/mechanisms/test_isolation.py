"""Plugins kept apart: twelve ways to be bad, each named with package, file and line, the others untouched."""

from __future__ import annotations

import copy
import pickle
import re
import sys
import textwrap
import time

import numpy as np
import pytest

from brv_hypo.errors import MechanismError, UsageError
from brv_hypo.mechanisms import checked as apart
from brv_hypo.mechanisms import find, installed, left_out, plugin_files, registry, use_plugin_files
from brv_hypo.mechanisms.conformance import sample_flight, sample_motion, uniform_time

pytestmark = pytest.mark.thorough

PLUGIN = """
import sys, time
import numpy as np
from brv_hypo.mechanisms import Mechanism, Parameter, Term, hookimpl
{top}

class Bad(Mechanism):
    \"\"\"A mechanism to test with.\"\"\"

    name, title, claims, source = "bad", "bad", "none", "a test"

    {parameters}

    def terms(self, motion, theta):
        \"\"\"One term.\"\"\"
        {terms}
        return (Term("C", 0.0 * motion.alpha, motion.alpha, "1/rad"),)

@hookimpl
def brv_hypo_mechanisms():
    {hook}
    return [Bad()]
"""
HANGING = "time.sleep(60)"
# What is wrong, and what the message says of it.
BAD = {
    "import": ({"top": "import no_such_module"}, "line 5.*no_such_module"),
    "syntax": ({"top": "def ("}, "line 5.*SyntaxError"),
    "exit": ({"top": "sys.exit(0)"}, "SystemExit"),
    "ends the process": ({"top": "import os; os._exit(0)"}, r"os\._exit\(0\)"),
    "ends it when asked": ({"terms": "__import__('os')._exit(0)"}, r"os\._exit\(0\)"),
    "hook raises": ({"hook": "1 / 0"}, "ZeroDivisionError"),
    "hook gives none": ({"hook": "return None"}, "expected a list"),
    "hook gives another": ({"hook": "return [7]"}, "gave 7, expected a Mechanism"),
    "hook hangs": ({"hook": HANGING}, "no answer"),
    "raises": ({"terms": "1 / 0"}, "ZeroDivisionError"),
    "gives none": ({"terms": "return None"}, "`terms` gave None"),
    "not finite": (
        {"terms": "motion = __import__('dataclasses').replace(motion, alpha=motion.alpha * np.nan)"},
        "finite",
    ),
    "wrong shape": ({"terms": "return (Term('C', np.zeros(3), np.zeros(3)),)"}, "shape"),
    "mutates": ({"terms": "motion.alpha[:] = 0.0"}, "read-only"),
    "hangs": ({"terms": HANGING}, "no answer"),
    "loops": ({"terms": "while True: pass"}, "no answer"),
    "swallows": (
        {"terms": "\n        while True:\n            try: time.sleep(9)\n            except Exception: pass"},
        "no answer",
    ),
    "text": ({"terms": "return (Term('C', motion.alpha, np.full(motion.alpha.shape, 'x')),)"}, "real numbers"),
    "recurses": ({"terms": "return self.terms(motion, theta)"}, "RecursionError"),
    "no grid": (
        {"parameters": "def parameters(self): return (Parameter('d', 's', (), (0.0, 1.0), 'delay'),)"},
        "grid|IndexError",
    ),
    "name": ({"parameters": "name = 'none'"}, "the name 'none'"),
    "taken": ({"parameters": "name = 'lag'"}, "has the name of one of brv-hypo"),
}


def written(folder, **parts):
    filled = {"top": "", "hook": "pass", "terms": "pass", "parameters": "pass", **parts}
    path = folder / "bad_plugin.py"
    path.write_text(PLUGIN.format(**filled))
    return path


@pytest.fixture(autouse=True)
def unloaded(monkeypatch):
    """Short patience, and no file left in the registry."""
    monkeypatch.setattr(apart, "ANSWER_SECONDS", 0.5)
    yield
    use_plugin_files(())


@pytest.mark.parametrize("how", BAD)
def test_a_bad_plugin_file_is_refused_and_what_is_installed_is_as_before(tmp_path, how):
    before = dict(installed())
    parts, says = BAD[how]
    path = written(tmp_path, **parts)
    with pytest.raises(MechanismError) as refusal:
        use_plugin_files([path])
    reason = str(refusal.value)
    assert str(path) in reason
    assert re.search(says, reason)
    assert "line" in reason or how in ("taken", "hook gives another")
    assert "--plugin" in reason or how == "taken"
    assert dict(installed()) == before


def test_a_good_plugin_file_is_used_and_its_answers_are_checked(tmp_path):
    path = written(tmp_path)
    use_plugin_files([path])
    assert left_out() == ()
    assert installed()["bad"].package == str(path)
    found = find("bad")
    motion = sample_motion(uniform_time(60))
    np.testing.assert_array_equal(found.terms(motion, {})[0].out_of_plane, motion.alpha)


def test_a_mechanism_file_is_a_plugin_too(tmp_path):
    path = tmp_path / "turning.yaml"
    path.write_text(
        textwrap.dedent("""
        name: turning
        title: turning moment
        claims: a moment that turns
        source: a test
        terms: [{name: along, axis: body_y, turn: {of: time, rate: 5.0}}]
        """)
    )
    use_plugin_files([path])
    assert find("turning").title == "turning moment"
    path.write_text("name: turning")
    with pytest.raises(UsageError, match="is not a mechanism file"):
        use_plugin_files([path])


@pytest.mark.parametrize("name", ["absent.py", "notes.txt"])
def test_what_is_no_plugin_is_wrong_usage(tmp_path, name):
    (tmp_path / "notes.txt").write_text("")
    good = written(tmp_path)
    use_plugin_files([good])
    with pytest.raises(UsageError, match=name):
        use_plugin_files([tmp_path / name])
    assert plugin_files() == (str(good),)
    assert "bad" in installed()


@pytest.mark.parametrize("over_samples", ["np.cumsum", "np.gradient"])
def test_terms_that_use_neighbours_are_told_what_to_use_instead(tmp_path, over_samples):
    path = written(tmp_path, terms=f'return (Term("k", 0 * motion.alpha, {over_samples}(motion.alpha)),)')
    path.write_text(f"import numpy as np\n{path.read_text()}")
    with pytest.raises(MechanismError, match=r"Each sample is evaluated alone.*`motion.delayed\(tau\)`"):
        use_plugin_files([path])


def foreign(tmp_path, terms):
    """A guarded mechanism that turned bad only after it was loaded."""
    use_plugin_files([written(tmp_path, terms=f"\n        if theta.get('bad'):\n            {terms}")])
    return find("bad")


@pytest.mark.parametrize(
    ("terms", "says"),
    [
        ("1 / 0", "ZeroDivisionError.*"),
        ("motion.alpha *= 2.0", "read-only"),
        ("motion.delayed(0.1).alpha[:] = 0.0", "read-only"),
        ("return None", "gave None"),
        ("return ()", "gave the names"),
        ("time.sleep(60)", "no answer in 0.5 s"),
        ("raise KeyboardInterrupt if False else SystemExit", "SystemExit"),
    ],
)
def test_what_breaks_later_is_an_error_with_name_file_and_line(tmp_path, terms, says):
    mechanism = foreign(tmp_path, terms)
    motion = sample_motion(uniform_time(60))
    before = motion.alpha.copy()
    begun = time.monotonic()
    with pytest.raises(MechanismError, match=says) as broken:
        mechanism.terms(motion, {"bad": 1.0})
    assert time.monotonic() - begun < 10.0
    assert broken.value.mechanism == "bad"
    assert "bad_plugin.py, line 1" in str(broken.value)
    np.testing.assert_array_equal(motion.alpha, before)
    assert mechanism.terms(motion, {})[0].name == "C"


def test_foreign_code_leaves_the_rules_of_arithmetic_as_they_were(tmp_path):
    mechanism = foreign(tmp_path, "np.seterr(all='raise')")
    before = np.geterr()
    mechanism.terms(sample_motion(uniform_time(60)), {"bad": 1.0})
    assert np.geterr() == before


def test_a_guarded_mechanism_is_still_itself(tmp_path):
    mechanism = find("sticking")
    checked = apart.checked(mechanism)
    assert isinstance(checked, type(mechanism))
    assert (checked.name, checked.title) == (mechanism.name, mechanism.title)
    assert apart.checked(checked) is checked
    assert apart.unchecked(checked) == mechanism
    assert checked.parameters() == mechanism.parameters()
    assert pickle.loads(pickle.dumps(checked)) == checked == copy.deepcopy(checked)
    motion = sample_motion(uniform_time(60))
    theta = {p.name: p.grid[0] for p in mechanism.parameters()}
    for one, other in zip(mechanism.terms(motion, theta), checked.terms(motion, theta), strict=True):
        np.testing.assert_array_equal(one.out_of_plane, other.out_of_plane)


def test_a_record_effect_cannot_write_into_the_record():
    effect = find_effect()

    class Writing(type(effect)):
        def perturb(self, flight, component, value):
            flight.q[:] = 0.0
            return flight

    flight = sample_flight()
    with pytest.raises(MechanismError, match="read-only"):
        apart.checked(Writing()).perturb(flight, "any", 1.0)
    assert np.any(flight.q != 0.0)


def find_effect():
    return registry.record_effects()[0]


def test_an_analysis_is_repeated_without_what_broke_its_contract():
    calls = []

    def analysis(without):
        calls.append(without)
        for name in ("one", "two"):
            if name not in without:
                raise MechanismError(f"{name} is broken", name)
        return "result"

    result, reasons = apart.without_faulty(analysis)
    assert result == "result"
    assert reasons == ("one is left out: one is broken", "two is left out: two is broken")
    assert calls == [frozenset(), {"one"}, {"one", "two"}]
    with pytest.raises(MechanismError):
        apart.without_faulty(lambda without: (_ for _ in ()).throw(MechanismError("again", "same")))
    assert "bad_plugin" not in sys.modules
