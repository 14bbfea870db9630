"""Where criteria disagree on the order; stepwise search on a triangular factor."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from brv_hypo.comparison.summary import criteria_disagree
from tests.studies.subset.stepwise import stepwise_columns


def row(mechanism, f_ratio, cp, error, impossible=""):
    return SimpleNamespace(mechanism=mechanism, f_ratio=f_ratio, cp=cp, prediction_error=error, impossible=impossible)


def test_one_first_by_all_criteria_is_no_disagreement():
    ranking = [row("lag", 90.0, 4.0, 1.0), row("damping", 20.0, 9.0, 2.0), row("none", None, 50.0, 3.0)]
    assert criteria_disagree(ranking, {"lag": 0.9, "damping": 0.05, "none": 0.01, "other": 0.04}) == ()


def test_each_criterion_is_named_with_what_it_puts_first():
    ranking = [row("lag", 40.0, 4.0, 1.5), row("damping", 90.0, 9.0, 2.0), row("none", None, 50.0, 1.0)]
    (warning,) = criteria_disagree(ranking, {"lag": 0.9, "damping": 0.05, "none": 0.05})
    assert warning == (
        "the criteria put different hypotheses first: F-ratio: damping; C_p and probability: lag; "
        "prediction error: baseline only"
    )


def test_what_is_first_with_a_value_that_is_not_possible_says_so():
    ranking = [row("lag", 90.0, 4.0, 1.0, "lag fraction = -3"), row("none", None, 50.0, 3.0)]
    (warning,) = criteria_disagree(ranking, {"lag": 0.1, "none": 0.9})
    assert "lag (with lag fraction = -3); probability: baseline only" in warning


def test_where_all_probability_is_outside_the_list_probability_puts_none_first():
    ranking = [row("lag", 50.0, 5.0, 0.2), row("none", None, 90.0, 0.1)]
    (warning,) = criteria_disagree(ranking, {"none": 0.0, "lag": 0.0, "other": 1.0})
    assert "probability" not in warning


def test_a_record_that_was_refused_disagrees_on_nothing():
    assert criteria_disagree([], {}) == ()


def test_stepwise_on_a_triangle_counts_the_samples_of_the_whole_design():
    """The same path as on the rows themselves."""
    rng = np.random.default_rng(4)
    X = np.column_stack([np.ones(300), rng.standard_normal((300, 8))])
    y = X @ np.array([1.0, 0.5, 0.0, -0.4, 0.0, 0.3, 0.0, 0.0, 0.2]) + rng.standard_normal(300)
    triangle = np.linalg.qr(np.column_stack([X, y]), mode="r")
    whole = stepwise_columns(X, y, max_terms=6, samples=300)
    small = stepwise_columns(triangle[:, :-1], triangle[:, -1], max_terms=6, samples=300)
    assert [columns for _, columns in small] == [columns for _, columns in whole]
    assert small[-1][0] == pytest.approx(whole[-1][0])
