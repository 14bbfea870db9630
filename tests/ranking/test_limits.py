"""How large a mechanism may be: never less than it was planted."""

from __future__ import annotations

from functools import cache

import numpy as np

from brv_hypo.mechanisms import find
from brv_hypo.ranking.limits import limits
from tests.ranking.pulse import fitted, problem, pulse

MECHANISMS = ("bodyfixed", "damping")


@cache
def found() -> dict[str, float]:
    groups = {"none": (), **{name: (find(name),) for name in MECHANISMS}}
    each = limits(problem(), groups, [fitted(name) for name in groups])
    assert len(each) == len({limit.mechanism for limit in each})
    return {limit.mechanism: limit.share_of_moment for limit in each}


def test_there_is_one_for_every_mechanism_and_none_for_the_null() -> None:
    assert set(found()) == set(MECHANISMS)


def test_they_are_positive_numbers() -> None:
    assert all(0.0 < share < np.inf for share in found().values())


def test_the_planted_amplitude_is_within_and_near() -> None:
    planted = float(np.hypot(*pulse().truth.planted_share))
    assert planted < found()["bodyfixed"] < 1.2 * planted


def test_what_the_baseline_holds_over_the_whole_record_sets_no_limit() -> None:
    """An in-plane moment that lasts is the vehicle's own; parts of the record bound the mechanism."""
    groups = {"none": (), "inplane": (find("inplane"),)}
    (limit,) = limits(problem(), groups, [fitted(name) for name in groups])
    assert 0.0 < limit.share_of_moment < 2.0
