"""What a fit says of its mechanisms in particular."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.inference.fit import HypothesisFit, solved
from brv_hypo.inference.problem import Problem
from brv_hypo.inference.reduced import Reduced
from brv_hypo.inference.unmodelled import plain_columns
from brv_hypo.mechanisms import find
from brv_hypo.model.term import Regressor, TimeBasis
from tests.comparison.pulse import problem


def fit_of(given: Problem, mechanism: str, *terms: str) -> HypothesisFit:
    """The fit of these terms, which jump in the middle of the record."""
    middle = TimeBasis("jump", float(np.median(given.frame.time)))
    columns = tuple(Regressor(mechanism, term, (), middle, "1") for term in terms)
    mechanisms = (find(mechanism),)
    reduced = Reduced(given, given.frame.with_mechanisms(mechanisms))
    return solved(reduced, mechanism, mechanisms, (*given.baseline, *columns), 0)


@pytest.mark.parametrize(
    ("mechanism", "terms", "plain"),
    [
        ("inplane", ("C_m0", "C_malpha"), ["C_malpha"]),
        ("inplane", ("C_malpha",), ["C_malpha"]),
        ("inplane", ("C_m0",), []),
    ],
)
def test_terms_that_are_characteristic_of_a_mechanism_are_not_plain(
    mechanism: str, terms: tuple[str, ...], plain: list[str]
) -> None:
    assert [column.term for column in plain_columns(fit_of(problem(), mechanism, *terms))] == plain
