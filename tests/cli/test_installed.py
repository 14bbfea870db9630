"""What is installed but not requested changes no result, bit for bit: comparison, trace, simulation, study."""

from __future__ import annotations

import contextlib
import json
import sys

import pytest

from brv_hypo.flight import load_flight
from brv_hypo.mechanisms import use_plugin_files
from brv_hypo.mechanisms.registry import compared
from tests.mechanisms.test_registry import plugin
from tests.truth import load_truth

# A mechanism that would explain any moment, an effect that would explain any rate, and both are to be nuisances.
GREEDY = """
from dataclasses import replace
from brv_hypo.mechanisms import Component, Mechanism, RecordEffect, Term

class Greedy(Mechanism):
    name, title, claims, source = "greedy", "greedy", "whatever is there", "a test"

    def terms(self, motion, theta):
        return (Term("C_in", motion.alpha, 0.0 * motion.alpha, "1/rad"),
                Term("C_out", 0.0 * motion.alpha, motion.alpha, "1/rad"))

    def tolerance(self, flight):
        return (1.0, 1.0)

class GreedyGyros(RecordEffect):
    name, title, claims, source = "greedy_gyros", "greedy gyros", "all gyros read too much", "a test"
    kind, carried = "instrument", True

    def components(self, flight):
        return (Component("q", "rad/s", 1.0), Component("p", "rad/s", 1.0))

    def perturb(self, flight, component, value):
        return replace(flight, **{component: getattr(flight, component) + value})

def brv_hypo_mechanisms():
    return [Greedy()]

def brv_hypo_record_effects():
    return [GreedyGyros()]
"""
FIVE = ["bodyfixed", "damping", "inplane", "lag", "sticking"]
TRACE = "effects: [sticking, gyro_bias]\nmax_steps: 1\ndiscover: false\n"
STUDY = """
vehicles: [{vehicle}]
planted: [none]
flights: 1
draws: {{instruments: {{grade: tactical}}}}
compare: {{mechanisms: [bodyfixed], maximum_likelihood: none}}
"""


@pytest.fixture(scope="module")
def greedy(tmp_path_factory):
    """A folder that holds the plugin as an installed distribution."""
    folder = tmp_path_factory.mktemp("plugin")
    plugin(folder, "greedy", GREEDY)
    return folder


@contextlib.contextmanager
def installed_in(folder):
    """With the distributions of a folder, which are forgotten afterwards."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        use_plugin_files(())
        yield
    sys.modules.pop("greedy", None)
    use_plugin_files(())


def both(brv_hypo, greedy, *arguments):
    """JSON of a command without and with the plugin, less the seconds that it took."""
    results = []
    for there in (contextlib.nullcontext(), installed_in(greedy)):
        with there:
            done = brv_hypo(*arguments, "--json", "-")
        assert done.returncode == 0, done.stderr
        assert "greedy" not in done.stderr  # it is sound: nothing is left out for it
        results.append(without_seconds(json.loads(done.stdout)))
    return results


def without_seconds(value):
    if isinstance(value, dict):
        return {key: without_seconds(each) for key, each in value.items() if "seconds" not in key}
    return [without_seconds(each) for each in value] if isinstance(value, list) else value


def test_the_plugin_is_known_where_it_is_named(brv_hypo, greedy):
    with installed_in(greedy):
        listed = brv_hypo("mechanisms", "--json", "-").stdout
    assert {"greedy", "greedy_gyros"} <= {entry["name"] for entry in entries(json.loads(listed))}


def test_the_five_are_compared_by_default_and_all_installed_on_request(greedy):
    with installed_in(greedy):
        assert compared([]) == compared(FIVE) == FIVE
        assert compared(["installed"]) == sorted([*FIVE, "greedy"])


def entries(value):
    """Every mapping with a name, at any depth."""
    if isinstance(value, dict):
        yield from [value] if "name" in value else []
        value = list(value.values())
    for each in value if isinstance(value, list) else []:
        yield from entries(each)


@pytest.mark.thorough
def test_a_comparison_is_the_same(brv_hypo, greedy, planted_file, tmp_path):
    (tmp_path / "compare.yaml").write_text("mechanisms: [bodyfixed]\nmaximum_likelihood: none\n")
    alone, beside = both(brv_hypo, greedy, "compare", planted_file, "--config", tmp_path / "compare.yaml")
    assert alone == beside


@pytest.mark.slow
def test_a_trace_is_the_same(brv_hypo, greedy, simulated_file, tmp_path):
    (tmp_path / "trace.yaml").write_text(TRACE)
    alone, beside = both(brv_hypo, greedy, "trace", simulated_file, "--config", tmp_path / "trace.yaml")
    assert alone == beside


def test_a_simulated_flight_is_the_same(brv_hypo, greedy, tmp_path):
    drawn = tmp_path / "drawn.yaml"
    drawn.write_text(
        "base: research_cone\nduration: 0.5\nsample_rate: 100.0\ninstruments: {grade: tactical, draw: 1.0}\n"
    )
    flights = []
    for name, there in (("alone.h5", contextlib.nullcontext()), ("beside.h5", installed_in(greedy))):
        with there:
            done = brv_hypo("simulate", drawn, "-o", tmp_path / name, "--seed", 3)
        assert done.returncode == 0, done.stderr
        flights.append((load_flight(tmp_path / name), load_truth(tmp_path / name)))
    (one, truth), (other, other_truth) = flights
    for name in ("p", "q", "r", "ax", "ay", "az", "velocity", "dynamic_pressure"):
        assert (getattr(one, name) == getattr(other, name)).all(), name
    assert truth.keys() == other_truth.keys()


@pytest.mark.slow
def test_a_study_is_the_same(brv_hypo, greedy, short_config, tmp_path):
    (tmp_path / "study.yaml").write_text(STUDY.format(vehicle=short_config))
    results = []
    for name, there in (("alone", contextlib.nullcontext()), ("beside", installed_in(greedy))):
        with there:
            done = brv_hypo("study", tmp_path / "study.yaml", "-o", tmp_path / name, "--jobs", 1, "--json", "-")
        assert done.returncode == 0, done.stderr
        results.append(without_seconds(json.loads(done.stdout)))
    assert results[0] == results[1]
