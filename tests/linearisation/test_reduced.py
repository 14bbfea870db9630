"""The projected problem against least squares on all rows."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from brv_hypo.inference.problem import Problem
from brv_hypo.inference.reduced import Reduced
from brv_hypo.inference.search import offers
from brv_hypo.linearisation.frame import RateFrame
from brv_hypo.linearisation.linear import solve_scaled
from brv_hypo.mechanisms import find
from brv_hypo.model.term import Regressor
from tests.chains import prepared


def problem() -> Problem:
    return prepared("bodyfixed", knot_count=3)


@cache
def offered(name: str) -> tuple[RateFrame, tuple[Regressor, ...]]:
    mechanism = find(name)
    frame = problem().frame.with_mechanisms([mechanism])
    return frame, offers(problem(), frame, [mechanism])[0]


@pytest.mark.parametrize("name", ["damping", "bodyfixed", "inplane", "lag"])
@pytest.mark.parametrize("count", [0, 1, 3])
def test_coefficients_and_residual_are_those_of_all_rows(name: str, count: int) -> None:
    frame, columns = offered(name)
    chosen = columns[1 : 1 + count]
    design = problem().design(frame, (*problem().baseline, *chosen))
    values = solve_scaled(design, problem().response)
    residual = problem().response - design @ values
    reduced = Reduced(problem(), frame)
    batch = reduced.batch(chosen)
    fitted = reduced.fit(batch)
    np.testing.assert_allclose(reduced.with_baseline(batch, fitted.values), values, rtol=1e-6)
    np.testing.assert_allclose(reduced.residual(batch, fitted.values), residual, atol=1e-6)
    assert fitted.rss == pytest.approx(float(residual @ residual), rel=1e-9)


def test_the_triangle_has_the_products_of_the_projected_columns() -> None:
    frame, columns = offered("inplane")
    reduced = Reduced(problem(), frame)
    batch = reduced.batch(columns)
    triangle = reduced.triangle(batch)
    products = batch.products(batch)
    np.testing.assert_allclose(triangle[:, :-1].T @ triangle[:, :-1], products, atol=1e-9 * products.max())


def test_a_column_of_the_baseline_is_spent() -> None:
    frame, columns = offered("damping")
    reduced = Reduced(problem(), frame)
    batch = reduced.batch((problem().baseline[0], columns[1]))
    assert reduced.spent(batch, reduced.triangle(batch)).tolist() == [0]
    fitted = reduced.fit(batch)
    assert fitted.values[0] == 0.0
    assert fitted.rss < reduced.rss
