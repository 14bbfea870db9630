"""A nuisance of another distribution, by a tolerance of its own, is in every hypothesis once it is requested."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from brv_hypo.flight import load_flight, save_flight
from tests.cli.test_installed import installed_in
from tests.mechanisms.test_registry import plugin

# All that is needed of an effect: one file.
DRIFT = """
from dataclasses import replace
from brv_hypo.mechanisms import Component, RecordEffect

class Drift(RecordEffect):
    name, title, claims, source = "drift", "drift of a gyro", "a gyro reads ever more", "a test"
    kind, carried = "instrument", True

    def components(self, flight):
        return (Component("q", "rad/s", {size}),)

    def perturb(self, flight, component, value):
        {early}
        elapsed = (flight.time - flight.time[0]) / (flight.time[-1] - flight.time[0])
        return replace(flight, q=flight.q + value * elapsed)

def brv_hypo_record_effects():
    return [Drift()]
"""
SIZE, PLANTED = 0.02, 0.03  # rad/s
SETTINGS = """
mechanisms: [{names}]
max_terms: 2
exact_terms: 2
knot_count: 3
refine: {refine}
maximum_likelihood: {ml}
"""


@pytest.fixture(scope="module")
def drifted(simulated_file, tmp_path_factory):
    """A flight with the drift in its record."""
    flight = load_flight(simulated_file)
    elapsed = (flight.time - flight.time[0]) / (flight.time[-1] - flight.time[0])
    path = tmp_path_factory.mktemp("drifted") / "drifted.h5"
    save_flight(replace(flight, q=flight.q + PLANTED * elapsed), path)
    return path


def compared(brv_hypo, folder, flight, *arguments, names="bodyfixed", ml="none", refine="false"):
    (folder / "compare.yaml").write_text(SETTINGS.format(names=names, ml=ml, refine=refine))
    done = brv_hypo("compare", flight, "--config", folder / "compare.yaml", "--json", "-", *arguments)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def unrequested(brv_hypo, nominal_file, tmp_path_factory):
    """A comparison in which no effect is requested."""
    return compared(brv_hypo, tmp_path_factory.mktemp("unrequested"), nominal_file)


def information(comparison):
    return {row["mechanism"]: (row["bic"], row["log_evidence"]) for row in comparison["ranking"]}


def written(folder, **parts):
    path = folder / "drift.py"
    path.write_text(DRIFT.format(**{"size": SIZE, "early": "", **parts}))
    return path


@pytest.mark.thorough
def test_a_file_is_enough_for_an_effect_whose_estimate_is_in_the_result(brv_hypo, drifted, tmp_path):
    settings = {"names": "sticking", "ml": "full", "refine": "true"}  # a delay of the grid alone is off
    found = compared(brv_hypo, tmp_path, drifted, "--plugin", written(tmp_path), **settings)
    assert found["verdict"]["winner"] == "sticking"
    blocks = [row["ml"] for row in found["ranking"] if row["ml"] is not None]
    assert found["ranking"][0]["ml"] in blocks
    for block in blocks:
        (estimate,) = (term for term in block["instrument"] if term["name"] == "drift q")
        assert estimate["units"] == "rad/s"
        assert 0.0 < estimate["std_error"] < SIZE
        assert abs(estimate["value"] - PLANTED) < max(4.0 * estimate["std_error"], 0.1 * PLANTED)


@pytest.mark.slow
def test_its_name_in_the_comparison_requests_it(brv_hypo, drifted, tmp_path):
    unrequested = compared(brv_hypo, tmp_path, drifted)
    by_file = compared(brv_hypo, tmp_path, drifted, "--plugin", written(tmp_path))
    plugin(tmp_path, "drifting", written(tmp_path).read_text())
    with installed_in(tmp_path):
        not_named = compared(brv_hypo, tmp_path, drifted)
        by_name = compared(brv_hypo, tmp_path, drifted, names="bodyfixed, drift")
    assert information(by_name) == information(by_file) != information(not_named)
    assert information(not_named) == information(unrequested)


@pytest.mark.thorough
def test_one_that_breaks_on_the_flight_is_named_and_left_out(brv_hypo, nominal_file, unrequested, tmp_path):
    """The kit's sample is of 600 samples: there it is sound."""
    path = written(tmp_path, early="assert flight.samples == 600")
    found = compared(brv_hypo, tmp_path, nominal_file, "--plugin", path)
    assert information(found) == information(unrequested)
    (reason,) = (text for text in found["warnings"] if "drift" in text)
    assert "AssertionError" in reason
    assert str(path) in reason


TILT = """
import numpy as np
from brv_hypo.mechanisms import Mechanism, Term

class Tilt(Mechanism):
    name, title, claims, source = "tilt", "tilt", "a constant moment in the body", "a test"

    def terms(self, motion, theta):
        return (Term("C_t", np.cos(motion.windward_meridian), np.sin(motion.windward_meridian), "1"),)

    def tolerance(self, flight):
        return ({size},)

def brv_hypo_mechanisms():
    return [Tilt()]
"""


@pytest.mark.thorough
def test_a_mechanism_with_a_tolerance_is_in_every_hypothesis(brv_hypo, nominal_file, tmp_path):
    """Criteria hardly change where its tolerance is next to nothing; with a large one they do.

    One unknown more moves the noise that the search is under, and with it where knots come to lie: of evidences beside
    processes, in which a mechanism may act in several regions, by several nats.
    """
    path = tmp_path / "tilt.py"
    found = []
    for size in (1e-12, 1e-2):
        path.write_text(TILT.format(size=size))
        found.append(information(compared(brv_hypo, tmp_path, nominal_file, "--plugin", path, names="sticking")))
    own = information(compared(brv_hypo, tmp_path, nominal_file, names="sticking"))
    negligible, large = (max(abs(bic - own[name][0]) for name, (bic, _) in each.items()) for each in found)
    assert large > 5.0 * negligible
