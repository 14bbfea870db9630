"""Two changes that bracket one are joined to one between them."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.inference.fit import joined
from brv_hypo.model.term import Regressor, TimeBasis

KNOTS = np.arange(1.0, 6.0)


def jump(start: float) -> Regressor:
    return Regressor("lag", "lag fraction", (("delay", 0.03),), TimeBasis("jump", start), "1")


def test_two_changes_of_like_direction_become_one_between_them_nearer_to_the_larger() -> None:
    (found,) = joined((jump(2.0), jump(3.0), jump(5.0)), np.array([1.0, 3.0, -4.0]), KNOTS)
    assert [column.time_basis.start for column in found] == [2.75, 5.0]


def test_every_two_that_bracket_one_are_offered() -> None:
    """The first two alone were, and a search ended where these were two."""
    found = joined(tuple(map(jump, (1.0, 2.0, 4.0, 5.0))), np.array([1.0, 1.0, -2.0, -2.0]), KNOTS)
    starts = [[column.time_basis.start for column in columns] for columns in found]
    assert starts == [[1.5, 4.0, 5.0], [1.0, 2.0, 4.5]]


@pytest.mark.parametrize(("starts", "values"), [((2.0, 3.0), (1.0, -1.0)), ((2.0, 4.0), (1.0, 1.0)), ((2.0,), (1.0,))])
def test_changes_against_one_another_or_far_apart_stay(starts: tuple[float, ...], values: tuple[float, ...]) -> None:
    assert joined(tuple(map(jump, starts)), np.array(values), KNOTS) == []
