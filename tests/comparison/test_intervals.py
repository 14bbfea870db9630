"""Net values between knots: in time order, and what was planted."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest
from brv_hypo_mechanisms.bodyfixed import BodyFixed

from brv_hypo.comparison.intervals import SECOND_ORDER_VALUES, intervals, out_of_bounds, within_bounds
from brv_hypo.comparison.result import NetInterval
from brv_hypo.mechanisms import find
from brv_hypo.model.term import TimeBasis
from tests.comparison.pulse import fitted, pulse

INSIDE = 3.0
"""A time within the pulse, s."""


def at(time: float) -> NetInterval:
    return next(each for each in intervals(fitted("bodyfixed")) if each.start_s <= time < each.stop_s)


def test_intervals_follow_each_other_over_the_whole_record() -> None:
    found, time = intervals(fitted("bodyfixed")), fitted("bodyfixed").frame.time
    assert found[0].start_s == time.min()
    assert found[-1].stop_s == time.max()
    assert all(one.stop_s == following.start_s for one, following in itertools.pairwise(found))
    assert all(each.start_s < each.stop_s for each in found)


def test_the_order_of_the_columns_is_that_of_nothing() -> None:
    """A later knot may come first among the columns."""
    fit = fitted("bodyfixed")
    first, count = fit.baseline_size, len(fit.columns)
    order = [*range(first), *range(count - 2, first - 1, -2), *range(count - 1, first - 1, -2)]
    both = [*order, *range(count, count + len(fit.nonlinear))]
    turned = replace(
        fit,
        columns=tuple(fit.columns[j] for j in order),
        values=fit.values[order],
        joint_covariance=fit.joint_covariance[np.ix_(both, both)],
    )
    for one, other in zip(intervals(fit), intervals(turned), strict=True):
        assert (one.start_s, one.stop_s) == (other.start_s, other.stop_s)
        assert {net.name: pytest.approx(net.value) for net in one.values} == {
            net.name: net.value for net in other.values
        }


def test_magnitude_and_direction_of_a_pulse_are_the_planted_ones() -> None:
    (planted,) = pulse().config.mechanisms
    assert planted.start == pytest.approx(at(INSIDE).start_s, abs=0.02)
    assert planted.stop == pytest.approx(at(INSIDE).stop_s, abs=0.02)
    cosine, sine = planted.terms["C_b cos(phi_b)"], planted.terms["C_b sin(phi_b)"]
    derived = {each.name: each for each in at(INSIDE).values}
    for name, value, largest in (
        ("C_b", np.hypot(cosine, sine), 0.05 * np.hypot(cosine, sine)),
        ("phi_b", np.arctan2(sine, cosine), 0.05),
    ):
        assert abs(derived[name].value - value) < 4.0 * derived[name].std_error
        assert derived[name].std_error < largest


def test_the_net_change_is_zero_where_the_pulse_has_ended() -> None:
    after = at(float(fitted("bodyfixed").frame.time.max()) - 0.5)
    assert all(abs(net.value) < 4.0 * net.std_error for net in after.values)


def test_a_half_of_a_joined_hypothesis_that_needs_no_term_derives_nothing() -> None:
    """The other half's intervals are as they are without it."""
    fit = fitted("bodyfixed")
    joined = replace(fit, mechanisms=(*fit.mechanisms, find("sticking")))
    assert intervals(joined) == intervals(fit)


def test_the_null_has_no_intervals() -> None:
    assert intervals(fitted("none")) == ()
    assert out_of_bounds(fitted("none")) is None


def test_values_that_no_body_has_cost_what_their_bounds_take() -> None:
    """2 ln L falls by the square of the excess in standard errors; within the bounds by nothing."""
    fit = fitted("bodyfixed")
    largest = max((net for each in intervals(fit) for net in each.values), key=lambda net: abs(net.value))

    class Bounded(BodyFixed):
        bounds: ClassVar[Mapping[str, tuple[float, float]]] = {
            largest.name: (-0.5 * abs(largest.value), 0.5 * abs(largest.value))
        }

    bounded = replace(fit, mechanisms=(Bounded(),))
    excess = out_of_bounds(bounded)
    assert excess is not None
    assert largest.name in excess.words
    error = np.hypot(largest.std_error, np.sqrt(SECOND_ORDER_VALUES) * largest.value)
    assert excess.sigmas == pytest.approx(0.5 * abs(largest.value) / error)
    assert within_bounds(bounded).information == pytest.approx(fit.information + excess.sigmas**2)
    assert within_bounds(fit) is fit


def test_no_delay_makes_up_for_a_sign_that_is_not_possible() -> None:
    """Beyond 0 a value errs as with its delay known, beyond its other bound as with the delay free."""
    fit = fitted("lag")
    fraction, terms = replace(fit.selected[0], time_basis=TimeBasis("constant")), fit.baseline_size
    free = tuple(parameter for parameter in fit.nonlinear if parameter.kind == "theta")[:1]
    joint = np.zeros((terms + 2, terms + 2))
    joint[terms:, terms:] = [[9.01, 3.0], [3.0, 1.0]]  # of a correlation of nearly 1: their product is known
    values = np.append(np.zeros(terms), -3.0)
    columns = (*fit.columns[:terms], fraction)
    known = replace(fit, values=values, joint_covariance=joint, columns=columns, nonlinear=free)
    negative, large = out_of_bounds(known), out_of_bounds(replace(known, values=-values))
    assert negative is not None
    assert large is not None
    assert large.sigmas < 1.0
    assert negative.sigmas > 10.0
