"""Derivatives of the residual by errors of the record: to neither side, so that a mirror changes their sign alone."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from brv_hypo.inference.build import linearised
from brv_hypo.linearisation.channels import Channels, first_values
from brv_hypo.linearisation.response import LinearisedFlight
from brv_hypo.mechanisms.contract import RecordEffect
from brv_hypo.mechanisms.registry import nuisance_effects
from brv_hypo.motion.responses import perturbed
from tests.chains import prepared
from tests.harness.last_digit import flight_last_digit_off

EFFECTS = [effect for effect in nuisance_effects() if effect.name != "wind"]


@cache
def flight() -> LinearisedFlight:
    problem = prepared()
    columns = problem.baseline
    frame, part = problem.frame, problem.rows.part
    return linearised(problem.records[0], 0, frame, columns, first_values(frame, part, columns))


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_the_opposite_error_does_the_opposite(effect: RecordEffect) -> None:
    """To a part in a million: one-sided differences of a thousandth of a tolerance are not."""
    here = flight()
    for component in effect.components(here.record.flight):
        more, less = (
            next(iter(here.effects([(effect, component.name, sign * component.size)]))) for sign in (1.0, -1.0)
        )
        for one, other in ((more.rates, less.rates), (more.force, less.force)):
            np.testing.assert_allclose(one, -other, atol=1e-6 * max(float(np.max(np.abs(one))), 1e-300))


def test_the_last_digit_of_the_record_moves_the_columns_of_the_walk_by_no_more_than_a_hundred_millionth() -> None:
    """One-sided differences of 1e-4 standard deviations, as they were, move them by more."""
    here = flight()
    (other,) = perturbed(here.record, [flight_last_digit_off(here.record.flight, 1)])
    pairs = zip(here.random_walk(), replace(here, record=other).random_walk(), strict=True)
    apart = [_size(after - before) / _size(before) for (_, _, before, *_), (_, _, after, *_) in pairs]
    assert 0.0 < max(apart) < 1e-7


def _size(rows: Channels) -> float:
    return float(np.linalg.norm(rows.rates))
