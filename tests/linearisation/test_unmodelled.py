"""Which moments a list of mechanisms has not, for something else: shapes, and rates at which one turns in the body."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from brv_hypo.inference.fit import fit_hypothesis
from brv_hypo.inference.unmodelled import (
    RATE,
    SHAPES,
    TurningMoment,
    UnmodelledMoment,
    plain_instead,
    turning_moment,
    unmodelled_moments,
)
from brv_hypo.mechanisms import Mechanism, Parameter, Term, find
from brv_hypo.model.term import Regressor, TimeBasis, candidates, theta_grid
from brv_hypo.motion.motion import Motion
from tests.comparison.pulse import fitted, problem


@pytest.mark.parametrize(
    ("listed", "gone"),
    [
        ((), set()),
        (("inplane",), {"offset", "stiffness"}),
        (("bodyfixed",), {"body-fixed"}),
        (("magnus",), {"side moment"}),
        (("bodyfixed", "magnus"), {"body-fixed", "side moment"}),
    ],
)
def test_a_shape_that_a_listed_mechanism_has_is_not_something_else(listed: tuple[str, ...], gone: set[str]) -> None:
    found = unmodelled_moments(problem(), [find(name) for name in listed])
    assert set(SHAPES) - {name for each in found for name in each.shapes} == gone


def test_beside_a_mechanism_with_a_delay_every_shape_is_unmodelled() -> None:
    found = unmodelled_moments(problem(), [find("lag"), find("sticking")])
    assert [each.shapes for each in found] == [(name,) for name in SHAPES]


def test_beside_a_mechanism_of_every_shape_none_is_unmodelled() -> None:
    assert unmodelled_moments(problem(), [UnmodelledMoment(shapes=tuple(SHAPES))]) == ()


def test_every_component_of_a_shape_is_a_term_of_its_own_name() -> None:
    motion = problem().frame.motions[0]
    terms = UnmodelledMoment(shapes=tuple(SHAPES)).terms(motion, {})
    names = [term.name for term in terms]
    assert len(set(names)) == len(names)
    assert {"side moment", "two-fold cosine", "two-fold sine"} <= set(names)
    expected = [part for name in SHAPES for part in SHAPES[name](motion)]
    for term, values in zip(terms, expected, strict=True):
        assert np.array_equal(term.in_plane + 1j * term.out_of_plane, values)


def test_the_components_of_a_shape_enter_together_and_no_others() -> None:
    """Along which body axes they are decides nothing; shapes are chosen one by one."""
    moment, motion = UnmodelledMoment(shapes=tuple(SHAPES)), problem().frame.motions[0]
    choices: dict[object, list[str]] = {}
    for column in candidates(moment, motion, problem().knots, theta_grid(moment)):
        if column.time_basis.kind == "constant":
            choices.setdefault(column.choice, []).append(column.term)
    assert sorted(map(len, choices.values())) == sorted(len(SHAPES[name](motion)) for name in SHAPES)
    assert ["body-fixed cosine", "body-fixed sine"] in choices.values()


@pytest.mark.thorough
def test_it_is_fitted_beside_a_baseline_that_has_some_of_its_shapes() -> None:
    """Offset and stiffness are the baseline's own, but for their changes in time."""
    anything = UnmodelledMoment(shapes=tuple(SHAPES))
    fit = fit_hypothesis(problem(), anything.name, (anything,))
    assert np.isfinite(fit.information)
    assert fit.selected


# ---- One that turns in the body ----


START, STOP = 1.0, 4.5


def test_rates_are_half_a_turn_apart_and_a_moment_at_rest_is_none_of_them() -> None:
    found = turning_moment(problem(), [], START, STOP)
    assert found is not None
    apart = np.pi / (STOP - START)
    rates = np.array(found.rates)
    assert np.min(np.abs(rates)) == pytest.approx(apart)
    assert np.diff(rates) == pytest.approx(np.where(np.diff(rates) > 1.5 * apart, 2.0, 1.0) * apart)
    assert found.parameters()[0].grid == found.rates
    each = [found.at(rate).parameters()[0] for rate in found.rates]
    assert [one.grid for one in each] == [(rate,) for rate in found.rates]
    assert all(min(map(abs, one.bounds)) >= 0.5 * apart - 1e-9 for one in each)


def test_a_rate_at_which_a_listed_mechanism_does_the_same_is_left_out() -> None:
    """A mechanism that turns at some rate itself excludes that rate alone."""
    free = turning_moment(problem(), [], START, STOP)
    assert free is not None
    rate = free.rates[3]
    beside = turning_moment(problem(), [Turns(**dict(free.at(rate)))], START, STOP)
    assert beside is not None
    assert rate not in beside.rates
    assert set(beside.rates) < set(free.rates)


class Turns(TurningMoment):
    """At one rate."""

    def parameters(self) -> tuple[Parameter, ...]:
        return ()

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        return super().terms(motion, {RATE: self.rates[0]})


@pytest.mark.parametrize("rate", [-4.7, 9.1])
def test_its_size_is_the_same_at_all_times_and_its_direction_turns(rate: float) -> None:
    motion = problem().frame.motions[0]
    along, across = TurningMoment(about=0.0, rates=(rate,), apart=1.0).terms(motion, {RATE: rate})
    body = (along.in_plane + 1j * along.out_of_plane) * np.exp(-1j * motion.windward_meridian)
    assert np.abs(body) == pytest.approx(np.ones(motion.time.size))
    turned = np.unwrap(np.angle(body))
    assert np.diff(turned) == pytest.approx(-rate * np.diff(motion.time), abs=1e-9)
    assert across.in_plane + 1j * across.out_of_plane == pytest.approx(1j * (along.in_plane + 1j * along.out_of_plane))


def test_there_is_none_where_it_can_turn_by_no_half_turn() -> None:
    start = float(problem().frame.time[0])
    assert turning_moment(problem(), [], start, start + 1e-3) is None


class SideByRoll(Mechanism):
    """Across the plane of alpha: in proportion to the roll rate, which hardly varies here, or to the transverse one."""

    name, title, claims, source = "side_by_roll", "a side moment by a rate", "none", "a test"
    by_roll: bool

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        return (Term("k", np.zeros_like(motion.alpha), (motion.p if self.by_roll else motion.q) * motion.rate_factor),)


@pytest.mark.parametrize(
    ("mechanism", "said"),
    [(SideByRoll(by_roll=True), ["constant across"]), (SideByRoll(by_roll=False), []), (find("inplane"), [])],
    ids=["roll rate", "transverse rate", "in plane"],
)
def test_a_law_that_a_record_does_not_test_is_said(mechanism: Mechanism, said: list[str]) -> None:
    """The roll rate varies by some per cent, a transverse rate oscillates; a constant has no other law than its own."""
    own = problem()
    frame = own.frame.with_mechanisms([mechanism])
    terms = [term.name for term in mechanism.terms(frame.motions[0], {})]
    selected = [Regressor(mechanism.name, name, (), TimeBasis("jump", at)) for name in terms for at in (2.0, 3.0)]
    values = np.array([*np.ones(len(own.baseline)), *(sign for _ in terms for sign in (1.0, -1.0))])
    fit = replace(fitted("none"), mechanisms=(mechanism,), frame=frame, columns=(*own.baseline, *selected))
    columns, words = plain_instead(replace(fit, values=values))
    assert list(dict.fromkeys(each.term for each in columns)) == said
    assert bool(words) == bool(said)
    assert [each.time_basis for each in columns] == [each.time_basis for each in selected if said]
