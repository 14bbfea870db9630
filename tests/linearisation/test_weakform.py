"""The weak form against quadrature and against simulated moments."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from brv_hypo.linearisation.frame import WeakSegment, weak_segments
from brv_hypo.model.term import TimeBasis
from tests.flights import flown, nominal

TIME = np.linspace(2.0, 6.0, 401)


def moment(time: float) -> complex:
    return complex(np.cos(3.0 * time) + 0.3, np.sin(2.0 * time))


SEGMENT = WeakSegment(TIME, np.zeros(401, complex), np.ones(401, complex), 0, slice(0, 401))


@settings(max_examples=40)
@given(kind=st.sampled_from(["constant", "jump", "ramp"]), start=st.floats(1.0, 6.5), length=st.floats(0.2, 6.0))
def test_columns_are_integrals_for_any_time_of_the_knot(kind: str, start: float, length: float) -> None:
    """The knot need not be a sample, nor lie inside the segment."""
    time_basis = TimeBasis("constant") if kind == "constant" else TimeBasis(kind, start, start + length)  # type: ignore[arg-type]
    integrals = SEGMENT.integrate(np.array([[moment(t)] for t in TIME]))
    column = SEGMENT.columns(integrals, np.array([0]), [time_basis])[:, 0]
    corners = [t for t in (start, start + length) if 2.0 < t < 6.0]
    for index in (57, 230, 400):
        inside = [t for t in corners if t < TIME[index]] or None
        parts = [
            quad(lambda t, part=part: part(moment(t)) * time_basis(np.array(t)), 2.0, TIME[index], points=inside)[0]
            for part in (np.real, np.imag)
        ]
        assert column[index] == pytest.approx(complex(*parts), abs=2e-7)


@pytest.mark.parametrize(
    "config",
    ["research_cone", *(pytest.param(name, marks=pytest.mark.slow) for name in ("blunt_capsule", "sounding_rocket"))],
)
def test_derolled_rates_are_integrals_of_the_true_moments(config: str) -> None:
    """The white residual is the gyros' own noise: 0.02 deg/s, within what chance allows."""
    flight = flown(config)
    (segment,) = weak_segments(flight.flight, 0)
    truth = np.asarray(flight.truth.C_m) + 1j * np.asarray(flight.truth.C_n)
    predicted = segment.integrate((segment.factor * truth)[:, np.newaxis])[0].at_nodes[:, 0]
    residual = segment.observed - predicted
    residual -= residual.mean()
    noise = np.sqrt(np.mean(np.abs(residual) ** 2) / 2.0)
    assert noise == pytest.approx(3.5e-4, rel=0.1)


def test_short_segments_are_left_out() -> None:
    flight = nominal().flight.window(0.0, 1.0)
    cut = replace(flight, segments=((0, 50), (60, 65), (70, flight.samples)))
    assert [(s.rows.start, s.rows.stop) for s in weak_segments(cut, 0)] == [(0, 50), (70, flight.samples)]
