"""A mechanism acts in regions, and nothing remains of it after them, unless the evidence clearly wants that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from brv_hypo.comparison import CompareConfig, Comparison, compare
from brv_hypo.comparison.diagnostics import delays_at_bounds
from brv_hypo.comparison.intervals import intervals
from brv_hypo.comparison.with_processes import Pair, likelier, price, with_its_evidence
from brv_hypo.inference.fit import HypothesisFit
from brv_hypo.model.term import TimeBasis
from brv_hypo.thresholds import FURTHER_REGION, ONSET_TAKES_TIME
from tests.chains import judged_cone
from tests.studies.independent.flights import Made
from tests.studies.independent.imperfect_study import LISTED, drawn_flight


def acting(*bases: TimeBasis, ends: bool) -> HypothesisFit:
    """The body-fixed moment of the research cone with these changes, each of both components."""
    found = judged_cone("bodyfixed")
    fit = found.leading.fit
    components = list({column.term: column for column in fit.selected}.values())
    columns = [column.at(column.theta, basis) for basis in bases for column in components]
    known = fit.columns[: fit.baseline_size]
    values = np.append(fit.values[: fit.baseline_size], np.ones(len(columns)))
    return replace(fit, columns=(*known, *columns), values=values, nonlinear=(), ends=ends)


TWO = (TimeBasis("jump", 1.0), TimeBasis("jump", 4.0), TimeBasis("ramp", 2.0, 2.5), TimeBasis("jump", 3.0))


def test_changes_are_where_a_region_begins_and_ends_in_turn() -> None:
    assert acting(*TWO, ends=True).regions == (((0, 2), (1, 3)), ((4, 6), (5, 7)))
    last = acting(*TWO[:3], ends=True)
    assert last.regions == (((0, 2), (1, 3)), ((4,), (5,)))
    assert last.estimated[last.baseline_size :] == [last.baseline_size + k for k in (0, 1, 4, 5)]
    assert [last.acts(0, time) for time in (0.5, 1.0, 3.9, 4.0)] == [False, True, True, False]
    assert last.acts(4, 5.0)  # to the end of the record
    assert acting(*TWO, ends=False).acts(0, 5.0)


def test_no_value_is_stated_where_a_mechanism_has_ended() -> None:
    found = judged_cone("bodyfixed")
    fit = found.leading.fit
    _, own = with_its_evidence(found.rows, acting(TWO[0], TWO[1], ends=True), found.leading.evidence.at)
    ended = replace(acting(TWO[0], TWO[1], ends=True), values=own.values, joint_covariance=own.covariance)
    assert [bool(each.values) for each in intervals(replace(ended, left_out=None))] == [False, True, False]
    free = replace(ended, ends=False, left_out=None)
    assert [bool(each.values) for each in intervals(free)] == [False, True, True]
    assert fit.ends


def test_a_form_costs_what_it_has_beyond_one_region() -> None:
    assert price(acting(TWO[0], TWO[1], ends=True)) == 0.0
    assert price(acting(TWO[0], TWO[1], ends=False)) == FURTHER_REGION
    assert price(acting(*TWO, ends=True)) == FURTHER_REGION + ONSET_TAKES_TIME
    assert price(acting(TWO[0], ends=False)) == 0.0
    found = judged_cone("bodyfixed")
    pair = found.leading
    more = pair.level + FURTHER_REGION - 0.1
    costly = Pair(replace(pair.fit, ends=False), replace(pair.evidence, level=more))
    assert likelier([costly, pair]) is pair


@pytest.mark.thorough
def test_a_delay_at_the_end_of_its_range_is_said_to_be_there() -> None:
    found = judged_cone("lag")
    fit = found.leading.fit
    assert delays_at_bounds(fit) == ()
    high = replace(fit, nonlinear=tuple(replace(each, value=each.bounds[1]) for each in fit.nonlinear))
    (said,) = delays_at_bounds(high)
    assert "lag delay is 0.45 s, at the end of the range searched" in said


def drawn(number: int) -> tuple[Made, Comparison]:
    made, _, _ = drawn_flight(number, number % 1000, "tactical", "all")
    return made, compare([made.flight], CompareConfig(mechanisms=LISTED, maximum_likelihood="none"))


@pytest.mark.slow
def test_a_mechanism_is_found_for_which_processes_had_made_up() -> None:
    """Beside damping as large as without it a lag was described 54 nats less likely, with pulses at its end."""
    made, found = drawn(967016)
    assert found.verdict.winner == "lag"
    begins = min(each.start_s for each in found.ranking[0].intervals if each.values)
    assert begins == pytest.approx(made.true.planted.start, abs=0.2)


@pytest.mark.slow
def test_a_fraction_follows_the_static_moment_that_is_found_beside_processes() -> None:
    """Of that without, which is too large beside lobes, it was 9 % too small: 8.6 stated errors."""
    made, found = drawn(971035)
    assert found.verdict.winner == "sticking"
    (eps,) = (each for interval in found.ranking[0].intervals for each in interval.values)
    assert eps.value == pytest.approx(made.true.planted.amplitude, rel=0.06)
