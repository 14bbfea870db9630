"""A moment that turns in the body: its rate is found, and it is told from what is listed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from brv_hypo.constants import OUTSIDE
from brv_hypo.mechanisms import Parameter, Term, find
from brv_hypo.model.term import Regressor, TimeBasis
from brv_hypo.motion.motion import Motion
from brv_hypo.regression.fit import fit_hypothesis
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.unlisted import RATE, TurningMoment, turning_moment
from tests.chains import prepared

START, STOP = 1.0, 4.5
SIZE = 2e-3


def problem() -> Problem:
    """A flight on which nothing acts, for models of few terms."""
    return prepared(max_terms=4, exact_terms=4)


def flown_with(rate: float) -> Problem:
    """The problem as if this moment had acted on the same motion besides."""
    moment = TurningMoment(about=0.0, rates=(rate,), apart=1.0)
    frame = problem().frame.with_mechanisms([moment])
    column = Regressor(moment.name, "turning y", ((RATE, rate),), TimeBasis("jump", START, STOP), "1")
    added = SIZE * frame.columns([column])[:, 0]
    segments = tuple(
        replace(segment, observed=segment.observed + added[a:b])
        for segment, (a, b) in zip(frame.segments, frame.pieces, strict=True)
    )
    return replace(problem(), frame=replace(problem().frame, segments=segments))


@pytest.mark.parametrize("rate", [-4.7, 2.3, 9.1])
def test_the_rate_of_turning_is_found_and_refined(rate: float) -> None:
    flown = flown_with(rate)
    found = turning_moment(flown, [find("bodyfixed"), find("inplane")], OUTSIDE, START, STOP)
    assert found is not None
    assert abs(found.rates[0] - rate) <= 0.5 * np.pi / (STOP - START)
    fit = fit_hypothesis(flown, found.name, (found,))
    (refined,) = {parameter.value for parameter in fit.nonlinear if parameter.name == RATE}
    assert refined == pytest.approx(rate, abs=0.02)
    follower = fit_hypothesis(flown, "bodyfixed", (find("bodyfixed"),))
    assert fit.information < follower.information - 100.0


def test_a_rate_at_which_a_listed_mechanism_does_the_same_is_left_out() -> None:
    """A mechanism that turns at some rate itself leaves the others."""
    flown = flown_with(2.3)
    free = turning_moment(flown, [], OUTSIDE, START, STOP)
    assert free is not None

    class Listed(TurningMoment):
        def parameters(self) -> tuple[Parameter, ...]:
            return ()

        def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
            return super().terms(motion, {RATE: self.rates[0]})

    same = Listed(about=START, rates=free.rates, apart=free.apart)
    other = turning_moment(flown, [same], OUTSIDE, START, STOP)
    assert other is not None
    assert other.rates != free.rates


@pytest.mark.parametrize("rate", [-4.7, 9.1])
def test_its_size_is_the_same_at_all_times_and_its_direction_turns(rate: float) -> None:
    motion = problem().frame.motions[0]
    along, across = TurningMoment(about=0.0, rates=(rate,), apart=1.0).terms(motion, {RATE: rate})
    body = (along.in_plane + 1j * along.out_of_plane) * np.exp(-1j * motion.windward_meridian)
    assert np.abs(body) == pytest.approx(np.ones(motion.time.size))
    turned = np.unwrap(np.angle(body))
    assert np.diff(turned) == pytest.approx(-rate * np.diff(motion.time), abs=1e-9)
    assert across.in_plane + 1j * across.out_of_plane == pytest.approx(1j * (along.in_plane + 1j * along.out_of_plane))


def test_nothing_is_left_where_it_can_turn_by_no_half_turn() -> None:
    time = problem().frame.time
    assert turning_moment(problem(), [], OUTSIDE, float(time[0]), float(time[0]) + 1e-3) is None
