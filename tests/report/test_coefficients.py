"""The coefficients of a comparison over time, as its page draws them."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.ranking import CompareConfig, Comparison, compare
from brv_hypo.report.compare_page import comparison_page
from brv_hypo.report.figures import Uncertain, coefficient_figure
from brv_hypo.simulation import load_config, simulate_batch


@pytest.fixture(scope="module")
def comparison() -> Comparison:
    cone = load_config("research_cone").model_copy(update={"duration": 1.5, "sample_rate": 100.0})
    flights = [simulated.flight for simulated in simulate_batch(cone, seeds=(5, 6))]
    return compare(flights, CompareConfig(mechanisms=("bodyfixed",)))


def test_the_band_is_two_standard_deviations_to_either_side() -> None:
    time, sigma = np.arange(4.0), np.array([0.1, 0.2, 0.3, 0.4])
    before, after = Uncertain(time, 2.0 + time, sigma), Uncertain(time + 10.0, 5.0 - time, sigma)
    figure = coefficient_figure({"C_N' by alpha": [before, after], "C_N'": [before]})
    band, line = figure.data[:2]
    np.testing.assert_allclose(band.y[:4] - line.y, 2.0 * sigma, rtol=1e-6)
    np.testing.assert_allclose(line.y - band.y[:3:-1], 2.0 * sigma, rtol=1e-6)
    assert [trace.x.min() for trace in figure.data] == [0.0, 0.0, 10.0, 10.0, 0.0, 0.0]
    assert "1/rad" in figure.layout.yaxis.title.text
    np.testing.assert_allclose(figure.data[-1].y, 1e3 * (2.0 + time))


def test_a_page_has_every_flights_coefficients_by_their_method(comparison) -> None:
    page = comparison_page(comparison)
    for row in comparison.ranking:
        converged = row.ml is not None and row.ml.status == "converged"
        method = "maximum likelihood" if converged else "regression"
        assert page.count(f"<h2>Coefficients of {row.mechanism} by {method}") == len(comparison.flights)
    assert "C_Nalpha_force: " in page
    assert "by maximum likelihood: converged" in page


def test_what_a_model_does_not_have_is_not_drawn(comparison) -> None:
    """Without a mechanism nothing out of plane depends on alpha: the difference quotient is rounding."""
    alone = comparison.model_copy(
        update={"coefficients": tuple(s for s in comparison.coefficients if s.mechanism == "none")}
    )
    page = comparison_page(alone)
    assert "C_N&#x27; by alpha: " in page
    assert "C_Z&#x27; by alpha: " not in page
