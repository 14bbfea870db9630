"""Delays are where the evidence is largest, and their errors reach to where it falls."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from brv_hypo.comparison.with_processes import Pair, _with_columns, beyond_linear, scanned
from brv_hypo.inference.evidence import with_amplitudes
from tests.chains import judged_cone


def leading(*plant: str) -> Pair:
    return judged_cone(*plant).leading


def with_delay(pair: Pair, factor: float) -> Pair:
    """The same where its delay is another, all else fitted to that."""
    problem, (fit, own) = judged_cone("lag").problem, pair
    delay = next(each for each in fit.nonlinear if each.kind == "theta")
    columns = delay.moved(fit.selected, factor * delay.value)
    there = _with_columns(problem, fit, columns)
    return Pair(there, with_amplitudes(own.rows, own.rows.terms(there), own.at))


def delay_of(pair: Pair) -> float:
    return next(each.value for each in pair.fit.nonlinear if each.kind == "theta")


@pytest.mark.thorough
@pytest.mark.parametrize("factor", [pytest.param(0.7, marks=pytest.mark.slow), 1.3])
def test_a_scan_leads_back_to_the_delay_of_the_largest_evidence(factor: float) -> None:
    pair = leading("lag")
    back = scanned(judged_cone("lag").problem, with_delay(pair, factor))
    assert delay_of(back) == pytest.approx(delay_of(pair), rel=0.15)
    assert back.level > with_delay(pair, factor).level


@pytest.mark.thorough
def test_the_error_of_a_delay_reaches_to_where_the_evidence_has_fallen_by_a_half() -> None:
    """One that counts for little is known less well, and its fraction goes with it against it."""
    pair, weight = leading("lag"), 1e-4
    fit, own = pair
    place = len(fit.columns) + next(k for k, each in enumerate(fit.nonlinear) if each.kind == "theta")
    more = beyond_linear(judged_cone("lag").problem, pair, weight)
    whole = own.covariance / weight + more
    assert np.all(np.linalg.eigvalsh(whole) >= -1e-9 * np.trace(whole))
    size = float(np.sqrt(more[place, place] + own.covariance[place, place] / weight))
    falls = [
        weight
        * (
            own.level_without([len(fit.selected) + place - len(fit.columns)])
            - other.level_without([len(fit.selected) + place - len(fit.columns)])
        )
        for sign in (1.0, -1.0)
        if 1.0 + sign * size / delay_of(pair) > 0.2
        for _, other in [with_delay(pair, 1.0 + sign * size / delay_of(pair))]
    ]
    assert 0.2 < min(falls) < 1.5


@pytest.mark.thorough
def test_a_fraction_errs_along_the_curve_on_which_a_shorter_delay_makes_up_for_it() -> None:
    """On it the product of both is what the data give; the fraction errs by no more than its bounds are wide."""
    pair, weight = leading("lag"), 3e-5
    fit, own = pair
    place = len(fit.columns) + next(k for k, each in enumerate(fit.nonlinear) if each.kind == "theta")
    fraction = fit.baseline_size
    linear, whole = (
        own.covariance / weight,
        own.covariance / weight + beyond_linear(judged_cone("lag").problem, pair, weight),
    )
    error, delay = (float(np.sqrt(whole[k, k])) for k in (fraction, place))
    shorter = max(delay_of(pair) - delay, 0.1 * delay_of(pair))
    curve = abs(float(own.values[fraction])) * (delay_of(pair) / shorter - 1.0)
    assert error >= float(np.sqrt(linear[fraction, fraction])) * (1.0 - 1e-9)
    assert error > 0.5 * min(curve, 1.0)


def test_what_has_no_delay_has_no_such_error() -> None:
    pair = leading("bodyfixed")
    assert not np.any(beyond_linear(judged_cone("bodyfixed").problem, pair, 1.0))
    assert scanned(judged_cone("bodyfixed").problem, pair) is pair


def test_the_interval_of_a_knot_ends_before_another() -> None:
    """Where it reaches the other the two are one, of fewer coefficients: what errs is as at the last value before."""
    (fit, own), problem = leading("bodyfixed"), judged_cone("bodyfixed").problem
    first, last = (each for each in fit.nonlinear if each.kind == "knot")
    reaching = replace(first, bounds=(first.bounds[0], last.value))
    pair = Pair(replace(fit, nonlinear=(reaching, last)), own)
    more = beyond_linear(problem, pair, 1e-9)
    assert more.shape == own.covariance.shape
    assert np.all(np.isfinite(more))


def test_two_changes_at_one_time_are_one() -> None:
    """As where a further region ends where another begins; each would be undetermined beside the other."""
    pair, problem = leading("bodyfixed"), judged_cone("bodyfixed").problem
    again = _with_columns(problem, pair.fit, (*pair.fit.selected, *pair.fit.selected[-2:]))
    assert again.selected == pair.fit.selected
    assert len(again.nonlinear) == len(pair.fit.nonlinear)
