"""A mechanism that comes on over a time, as it was flown by another simulator; one that comes on at once does not."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from brv_hypo import simulate
from brv_hypo.comparison import CompareConfig, Comparison, compare
from brv_hypo.comparison.intervals import intervals
from brv_hypo.comparison.limits import _every_region
from brv_hypo.comparison.with_processes import with_its_evidence
from brv_hypo.errors import FlightRecordError
from brv_hypo.inference.refinement import nonlinear_parameters
from brv_hypo.model.term import Regressor, TimeBasis
from tests.chains import judged_cone
from tests.comparison.pulse import fitted, problem
from tests.studies.independent.flights import Made, make_flight
from tests.studies.independent.imperfect_study import drawn_flight

FLOWN = [
    ("cone", "sticking", 13),
    *(pytest.param(*each, marks=pytest.mark.slow) for each in (("biconic", "damping", 12), ("slender", "lag", 14))),
]


@cache
def compared(vehicle: str, truth: str, seed: int, kinds: tuple[str, ...]) -> tuple[Made, Comparison]:
    made = make_flight(vehicle, truth, 0.7, seed, imperfect=kinds)
    return made, compare([made.flight], CompareConfig(mechanisms=(truth,), maximum_likelihood="none"))


@pytest.mark.thorough
@pytest.mark.parametrize(("vehicle", "truth", "seed"), FLOWN)
def test_its_width_is_estimated_about_its_knot(vehicle: str, truth: str, seed: int) -> None:
    """What was flown rises as a cubic: a straight rise that is like it takes about four fifths of that.

    Where little else moves the vehicle, further changes describe how the cubic differs; they come after.
    """
    made, found = compared(vehicle, truth, seed, ("gradual_onset",))
    width = next(each.value for each in found.ranking[0].derived if each.name == f"{truth} onset width")
    planted, first = made.true.planted, min(i.start_s for i in found.ranking[0].intervals if i.values)
    assert found.verdict.winner == truth
    assert 0.65 * planted.onset < width < planted.onset
    assert first < planted.start < first + planted.onset
    knots = [each for each in found.ranking[0].derived if each.name == f"{truth} knot"]
    assert min(abs(each.value - planted.start) / each.std_error for each in knots) < 3.0


@pytest.mark.slow
@pytest.mark.parametrize(("vehicle", "truth", "seed"), FLOWN)
def test_a_jump_has_none(vehicle: str, truth: str, seed: int) -> None:
    _, found = compared(vehicle, truth, seed, ())
    assert found.verdict.winner == truth
    assert not [each for each in found.ranking[0].derived if "onset width" in each.name]


@pytest.mark.slow
@pytest.mark.parametrize("number", [11, pytest.param(26, marks=pytest.mark.slow)])
def test_processes_do_not_replace_an_onset(number: int) -> None:
    """They and a jump at its end described it as the opposite moment after it, 25 to 110 nats less likely."""
    made, _, _ = drawn_flight(904000 + number, number, "tactical", "all")
    planted = made.true.planted
    found = compare([made.flight], CompareConfig(mechanisms=(made.truth,), maximum_likelihood="none"))
    (row,) = [each for each in found.ranking if each.mechanism == made.truth]
    begins, full, ends = (each.start_s for each in row.intervals[1:])
    assert begins < planted.start < full + 0.1
    assert ends == pytest.approx(planted.stop, abs=0.02)


def test_knot_and_width_of_an_onset_move_apart_from_each_other() -> None:
    best, whole = fitted("bodyfixed"), problem()
    column = best.selected[0]
    onset = column.at(column.theta, TimeBasis("ramp", 2.0, 2.4))
    knot, width = nonlinear_parameters((onset,), best.frame, whole.knots)
    assert (knot.kind, knot.value, width.kind) == ("knot", pytest.approx(2.2), "width")
    assert width.value == pytest.approx(0.4)
    assert ends(knot.moved((onset,), 2.5)) == pytest.approx((2.3, 2.7))
    assert ends(width.moved((onset,), 0.2)) == pytest.approx((2.1, 2.3))


def test_what_came_on_is_known_better_than_its_rate_and_its_width() -> None:
    """Where the two make up for one another the value reached is known."""
    best, whole = fitted("bodyfixed"), problem()
    ramps = tuple(c.at(c.theta, TimeBasis("ramp", 2.0, 2.5)) for c in best.selected[:2])
    knot, width = nonlinear_parameters(ramps, best.frame, whole.knots)
    first = best.baseline_size
    rate, error = np.append(best.values[:first], [3.0, 4.0]), 0.1 * width.value
    covariance = 1e-6 * np.eye(first + 4)
    along = np.append(np.zeros(first), [-3.0, -4.0, 0.0, width.value]) * error / width.value
    covariance += np.outer(along, along)
    fit = replace(
        best, columns=(*best.columns[:first], *ramps), values=rate, nonlinear=(knot, width), joint_covariance=covariance
    )
    reached = {each.name: each for each in intervals(fit)[-1].values}
    for name, value in zip((ramps[0].term, ramps[1].term), (1.5, 2.0), strict=True):
        assert reached[name].value == pytest.approx(value)
        assert reached[name].std_error == pytest.approx(1e-3 * np.hypot(width.value, value / width.value), rel=1e-6)


@pytest.mark.thorough
def test_knots_move_what_the_evidence_finds_and_not_what_the_fit_without_processes_had() -> None:
    found = judged_cone("bodyfixed")
    fit, own = found.leading
    other = replace(fit, values=np.append(fit.values[: fit.baseline_size], 3.0 * fit.values[fit.baseline_size :]))
    assert fit.nonlinear
    there, again = with_its_evidence(own.rows, other, own.at)
    assert again.level == pytest.approx(own.level, abs=0.01)
    assert np.diag(again.covariance) == pytest.approx(np.diag(own.covariance), rel=0.01)
    assert there.values[fit.baseline_size :] == pytest.approx(own.values[fit.baseline_size : fit.values.size], rel=0.01)


def ends(columns: tuple[Regressor, ...]) -> tuple[float, float]:
    return columns[0].time_basis.start, columns[0].time_basis.stop


def test_a_region_with_an_onset_has_the_sum_of_one_that_jumps() -> None:
    """Where its onset ends before it does; intervals with a share between 0 and 1 lie about its first edge."""
    places, shares = _every_region(8, (0, 2, 4))
    for (first, last, width), own in zip(places.tolist(), shares, strict=True):
        assert np.all((own >= 0.0) & (own <= 1.0))
        assert not np.any(own[last:])
        assert own.sum() == pytest.approx(last - first)
        assert np.count_nonzero((own > 0.0) & (own < 1.0)) == width


@pytest.mark.slow
def test_one_in_a_gap_errs_by_as_much_as_the_gap_hides(tmp_path: Path) -> None:
    """There it moves nothing, so that its linear error has no bound."""
    flight = simulate("research_cone", seed=1, plant=["bodyfixed"]).flight
    rate = flight.q.copy()
    rate[300:420] = np.nan  # 1.5 to 2.1 s; the moment acts from 2 to 4 s
    gap, record = replace(flight, q=rate), tmp_path / "gap.h5"
    with pytest.raises(FlightRecordError, match="not finite"):
        compare(gap)
    gap.save(record)
    found = compare(record, CompareConfig(mechanisms=("bodyfixed",), maximum_likelihood="none"))
    onset, end = (each for each in found.ranking[0].derived if each.name == "bodyfixed knot")
    assert 0.1 < onset.std_error < 0.6
    assert abs(onset.value - 2.0) < 2.0 * onset.std_error
    assert end.std_error < 0.01
    limit = next(each for each in found.verdict.limits if each.mechanism == "bodyfixed")
    assert limit.share_std_error < 0.1 * limit.share_of_moment
