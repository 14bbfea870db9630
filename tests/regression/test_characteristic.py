"""What a fit says of its mechanisms in particular."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.mechanisms import find
from brv_hypo.model.term import Regressor, TimeBasis
from brv_hypo.regression.fit import HypothesisFit, fit_hypothesis, settled, solved
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.reduced import Reduced
from brv_hypo.regression.unlisted import particular_share, plain_columns
from tests.ranking.pulse import problem


def fit_of(given: Problem, mechanism: str, *terms: str) -> HypothesisFit:
    """The fit of these terms, which jump in the middle of the record."""
    middle = TimeBasis("jump", float(np.median(given.frame.time)))
    columns = tuple(Regressor(mechanism, term, (), middle, "1") for term in terms)
    mechanisms = (find(mechanism),)
    reduced = Reduced(given, given.frame.with_mechanisms(mechanisms))
    return solved(reduced, mechanism, mechanisms, (*given.baseline, *columns), 0)


def test_what_is_lost_without_the_characteristic_term_is_a_share_of_what_is_explained() -> None:
    """The knot of the other term moves to where that alone fits best: less is lost than where it was."""
    given = problem()
    null = fit_hypothesis(given, "none", ())
    fit = fit_of(given, "inplane", "C_m0", "C_malpha")
    there, plain = fit_of(given, "inplane", "C_malpha"), plain_columns(fit)
    moved = settled(given, fit, (*given.baseline, *plain), plain)
    lost = (moved.rss - fit.rss) / (null.rss - fit.rss)
    assert [column.term for column in plain] == ["C_malpha"]
    assert moved.rss < there.rss
    assert particular_share(given, null, fit) == pytest.approx(lost, rel=1e-6)


@pytest.mark.parametrize(
    ("mechanism", "terms", "share"),
    [("inplane", ("C_malpha",), 0.0), ("inplane", ("C_m0",), 1.0), ("damping", ("C_mq",), 1.0)],
)
def test_terms_of_one_kind_are_particular_or_not(mechanism: str, terms: tuple[str, ...], share: float) -> None:
    given = problem()
    terms = (
        terms if mechanism == "inplane" else tuple(t.name for t in find(mechanism).terms(given.frame.motions[0], {}))
    )
    assert particular_share(given, fit_hypothesis(given, "none", ()), fit_of(given, mechanism, *terms)) == share
