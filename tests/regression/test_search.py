"""Episodes: all terms of a mechanism switched on at one knot, and off at another."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from brv_hypo.constants import SEARCH_FINER_KNOTS
from brv_hypo.mechanisms import find
from brv_hypo.model.term import candidates
from brv_hypo.regression.reduced import Reduced
from brv_hypo.regression.search import episodes
from tests.chains import prepared

INPLANE = (find("inplane"),)


def test_an_episode_begins_and_ends_beside_the_planted_knots() -> None:
    given = prepared("inplane", max_terms=4, exact_terms=2)
    spacing = float(np.diff(given.knots).min()) / SEARCH_FINER_KNOTS
    one, two = sorted(episodes(given, given.frame.with_mechanisms(INPLANE), INPLANE), key=len)
    assert [column.term for column in one] == ["C_m0", "C_malpha"]
    assert [column.term for column in two] == ["C_m0", "C_malpha"] * 2
    assert sorted({column.time_basis.start for column in two}) == pytest.approx([2.0, 4.0], abs=spacing)


def test_the_episode_leaves_least_of_all_pairs_of_knots() -> None:
    """Against every pair of the same knots, fitted one by one."""
    given = prepared("inplane", max_terms=4, exact_terms=2)
    frame = given.frame.with_mechanisms(INPLANE)
    reduced, (motion, *_) = Reduced(given, frame), frame.motions
    found = max(episodes(given, frame, INPLANE), key=len)

    def left(columns: tuple[object, ...]) -> float:
        triangle = reduced.triangle(reduced.batch(columns))  # type: ignore[arg-type]
        return float(np.sum(triangle[len(columns) :, -1] ** 2))

    places = np.arange(given.knots.size)
    finer = np.interp(np.linspace(0, places[-1], SEARCH_FINER_KNOTS * places[-1] + 1), places, given.knots)
    jumps = [
        tuple(c for c in candidates(INPLANE[0], motion, np.array([knot]), [()]) if c.time_basis.kind == "jump")
        for knot in finer[:: SEARCH_FINER_KNOTS // 2]
    ]
    assert left(found) <= min(left((*one, *other)) for one, other in combinations(jumps, 2)) * (1.0 + 1e-9)


@pytest.mark.parametrize("name", ["damping", "bodyfixed", "lag", "sticking"])
def test_what_has_no_ramps_has_no_episodes(name: str) -> None:
    """The search on the grid, and the steps of its knots, find those."""
    given, mechanisms = prepared("inplane", max_terms=4, exact_terms=2), (find(name),)
    assert episodes(given, given.frame.with_mechanisms(mechanisms), mechanisms) == []


def test_episodes_are_no_larger_than_a_hypothesis_may_be() -> None:
    given = prepared("inplane", max_terms=2, exact_terms=2)
    assert [len(columns) for columns in episodes(given, given.frame.with_mechanisms(INPLANE), INPLANE)] == [2]
