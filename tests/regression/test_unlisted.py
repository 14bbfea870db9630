"""Which shapes of a moment a list of mechanisms leaves for something else."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.constants import OUTSIDE
from brv_hypo.mechanisms import find
from brv_hypo.model.term import candidates, theta_grid
from brv_hypo.regression.fit import fit_hypothesis
from brv_hypo.regression.free_moment import SHAPES, shape_of
from brv_hypo.regression.unlisted import UnlistedMoment, unlisted_moment
from tests.ranking.pulse import problem


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
    found = unlisted_moment(problem(), [find(name) for name in listed], OUTSIDE)
    assert found is not None
    assert set(SHAPES) - set(found.shapes) == gone


def test_a_mechanism_with_a_delay_leaves_every_shape() -> None:
    found = unlisted_moment(problem(), [find("lag"), find("sticking")], OUTSIDE)
    assert found is not None
    assert found.shapes == SHAPES


def test_nothing_is_left_beside_a_mechanism_of_every_shape() -> None:
    assert unlisted_moment(problem(), [UnlistedMoment(shapes=SHAPES)], OUTSIDE) is None


def test_every_component_of_a_shape_is_a_term_of_its_own_name() -> None:
    motion = problem().frame.motions[0]
    terms = UnlistedMoment(shapes=SHAPES).terms(motion, {})
    names = [term.name for term in terms]
    assert len(set(names)) == len(names)
    assert {"side moment", "two-fold cosine", "two-fold sine"} <= set(names)
    expected = [part for name in SHAPES for part in shape_of(name, motion)]
    for term, values in zip(terms, expected, strict=True):
        assert np.array_equal(term.in_plane + 1j * term.out_of_plane, values)


def test_the_components_of_a_shape_enter_together_and_no_others() -> None:
    """Which body axes they stand along tells nothing; shapes are chosen one by one."""
    moment, motion = UnlistedMoment(shapes=SHAPES), problem().frame.motions[0]
    choices: dict[object, list[str]] = {}
    for column in candidates(moment, motion, problem().knots, theta_grid(moment)):
        if column.time_basis.kind == "constant":
            choices.setdefault(column.choice, []).append(column.term)
    assert sorted(map(len, choices.values())) == sorted(len(shape_of(name, motion)) for name in SHAPES)
    assert ["body-fixed cosine", "body-fixed sine"] in choices.values()


def test_it_is_fitted_beside_a_baseline_that_holds_some_of_its_shapes() -> None:
    """Offset and stiffness are the baseline's own, but for their changes in time."""
    anything = UnlistedMoment(shapes=SHAPES)
    fit = fit_hypothesis(problem(), anything.name, (anything,))
    assert np.isfinite(fit.information)
    assert fit.selected
