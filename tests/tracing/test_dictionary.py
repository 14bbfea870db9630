"""Generic terms: their names, when they begin and end, and what they pay for being chosen among many."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from brv_hypo.inference.fit import HypothesisFit, fit_hypothesis
from brv_hypo.inference.problem import Problem
from brv_hypo.inference.rows import rows_of
from brv_hypo.mechanisms.conformance import sample_motion
from brv_hypo.mechanisms.yaml_mechanism import Factor, Turn, YamlMechanism, YamlTerm, mechanism_of
from brv_hypo.model.term import Regressor, TimeBasis
from brv_hypo.tracing.acceptance import Candidate
from brv_hypo.tracing.description import described, described_in_part, entries
from brv_hypo.tracing.families import Beside
from tests.chains import prepared


def test_moments_that_turn_at_nearly_the_same_rate_have_names_of_their_own() -> None:
    turning = next(e for e in entries([sample_motion(np.linspace(0.0, 6.0, 600))]) if e.terms[0].turn is not None)
    assert turning.at is not None
    names = [term.name for rate in (-14.171, -14.174, -14.1741) for term in turning.at(rate).terms]
    assert len(set(names)) == len(names)


def test_steps_of_every_width_have_names_of_their_own() -> None:
    steps = [e for e in entries([sample_motion(np.linspace(0.0, 6.0, 600))]) if ", step" in e.terms[0].name]
    widths = {factor.width for e in steps for factor in e.terms[0].factors if factor.function == "step"}
    assert len(widths) >= 3
    assert len({e.terms[0].name for e in steps}) == len({e.words for e in steps}) == len(steps)
    assert all(e.at is not None and e.at(e.position).terms == e.terms for e in steps)


TURNING = YamlTerm(name="along", axis="body_y", turn=Turn(of="time", rate=3.0))


def with_moment(given: Problem, term: YamlTerm, time_basis: TimeBasis, size: float) -> Problem:
    """The problem with the rates that so large a moment makes added to those of its flight."""
    mechanism = YamlMechanism(definition=(term,))
    frame = given.frame.with_mechanisms([mechanism])
    column = Regressor(mechanism.name, term.name, (), time_basis, "1")
    own = given.rows.of_moments(frame.columns([column]))[:, 0]
    planted = replace(given)
    vars(planted)["raw_response"] = given.raw_response + size / np.linalg.norm(own) * own
    return planted


def candidate(fit: HypothesisFit) -> Candidate:
    """What is described, as a candidate."""
    return Candidate("discovered", fit, fit)


@cache
def turning_for_a_while() -> tuple[Problem, HypothesisFit]:
    """A problem with a moment that turns from 2 to 4.5 s, and what describes a part of it."""
    given = with_moment(prepared(), TURNING, TimeBasis("jump", 2.0, 4.5), 600.0)
    null = fit_hypothesis(given, "none", ())
    rows = rows_of(given, null)
    start = np.array([0.0, *(group.prior[0] for group in rows.groups)])
    beside = Beside(null, rows, {}, {}, start, problem_with=lambda _: given)
    found = described_in_part(beside, replace(null, name="discovered_1"))
    assert found is not None
    return given, found


@pytest.mark.thorough
def test_a_moment_that_turns_from_one_time_to_another_is_described_with_its_times() -> None:
    file = candidate(turning_for_a_while()[1]).file
    assert file is not None
    rates = [term.turn.rate for term in file.terms if term.turn is not None]
    times = sorted({f.at for term in file.terms for f in term.factors if f.of == "time"})
    assert rates == pytest.approx([3.0] * 4, abs=0.2)
    assert times == pytest.approx([2.0, 4.5], abs=0.1)
    said = file.title.partition(", that changes at ")[2]
    assert re.fullmatch(r"\d+(\.\d{1,2})? s(, \d+(\.\d{1,2})? s)*", said)  # as all times are


@pytest.mark.thorough
def test_the_file_of_a_description_makes_the_moment_that_was_fitted() -> None:
    given, fit = turning_for_a_while()
    file = candidate(fit).file
    assert file is not None
    read, motion = mechanism_of(file), given.frame.motions[0]
    values = [term.value or 0.0 for term in file.terms]
    of_file = sum(v * (t.in_plane + 1j * t.out_of_plane) for v, t in zip(values, read.terms(motion, {}), strict=True))
    fitted = fit.frame.moments(fit.selected) @ fit.values[fit.baseline_size :]
    turned = of_file * np.exp(-1j * motion.windward_meridian)
    assert turned[: fitted.size] == pytest.approx(fitted, abs=1e-9)


@pytest.mark.thorough
def test_a_constant_moment_counts_one_choice_of_the_dictionary() -> None:
    given = with_moment(prepared(), TURNING, TimeBasis("constant"), 600.0)
    found = described(given, "discovered_1")
    assert found is not None
    assert len({column.choice for column in found.selected}) == 1
    assert found.searched == len(entries(given.frame.motions))


@pytest.mark.thorough
@pytest.mark.parametrize("at", [2.0, 4.0])
def test_of_histories_that_fit_a_flight_equally_mach_number_comes_first(at: float) -> None:
    given = prepared()
    motion = given.frame.motions[0]
    step = Factor(of="time", function="step", at=at, width=0.1)
    term = YamlTerm(name="later", axis="in_plane", factors=(step, Factor(of="alpha")), units="1/rad")
    given = with_moment(given, term, TimeBasis("constant"), 1500.0)
    found = described(given, "discovered_1")
    assert found is not None
    file = candidate(found).file
    assert file is not None
    places = [factor.at for term in file.terms for factor in term.factors if factor.of == "mach"]
    assert places == pytest.approx([float(np.interp(at, motion.time, motion.mach))], abs=0.01)
