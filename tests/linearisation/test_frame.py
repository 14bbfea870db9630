"""The in-plane moment C_mw that delayed flow lags behind."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from brv_hypo.model.baseline import StaticBend
from brv_hypo.model.term import Regressor, TimeBasis
from tests.comparison.pulse import problem


def test_the_design_of_the_vehicle_is_part_of_the_in_plane_moment() -> None:
    """The bend of the static moment is fitted within its prior, beside the columns."""
    given = problem()
    frame = given.frame.with_mechanisms([StaticBend(slope=-0.5)])
    values = np.linspace(-0.5, 0.5, len(given.baseline))
    straight = frame.with_in_plane_moment(given.baseline, values).finer[0]
    column = Regressor("static_bend", "C_malpha3", (), TimeBasis("constant"), "1/rad^3")
    design = frame.in_plane_moments((column,), np.array([2.0]))
    bent = replace(frame, design=design).with_in_plane_moment(given.baseline, values).finer[0]
    expected = straight.in_plane_moment + 2.0 * straight.alpha**3
    np.testing.assert_allclose(bent.in_plane_moment, expected, rtol=1e-12)
    late = 0.1
    np.testing.assert_array_equal(bent.delayed(late).alpha, straight.delayed(late).alpha)
    assert np.any(bent.delayed(late).in_plane_moment != straight.delayed(late).in_plane_moment)
