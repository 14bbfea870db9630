"""Where nodes are placed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from brv_hypo.identification.nodes import Meridian

TIME = np.arange(0.0, 4.0, 0.005)


def passing(nearest: float, at: float = 2.0, speed: float = 0.2) -> CubicSpline:
    """Crossflow on a straight line that passes zero at `nearest` rad."""
    return CubicSpline(TIME, speed * (TIME - at) + 1j * nearest)


def test_slow_motion_needs_no_nodes_between():
    circle = CubicSpline(TIME, 0.05 * np.exp(5j * TIME))
    nodes = TIME[2::5]
    np.testing.assert_array_equal(Meridian(circle, ()).with_nodes_between(nodes), nodes)


@given(nearest=st.floats(1e-4, 2e-3), delay=st.sampled_from([0.0, 0.03, 0.2]))
@settings(max_examples=25)
def test_the_meridian_turns_little_between_nodes(nearest: float, delay: float):
    crossflow = passing(nearest)
    found = Meridian(crossflow, (delay,) if delay else ()).with_nodes_between(TIME)
    assert set(TIME) <= set(found)
    turn = np.abs(np.diff(np.unwrap(np.angle(crossflow(found)))))
    assert np.all((turn <= 0.5 + 1e-9) | (np.diff(found) <= 0.005 / 16 + 1e-12))


def test_a_delay_has_nodes_where_the_meridian_turned_that_much_earlier():
    found = Meridian(passing(1e-3), (0.2,)).with_nodes_between(TIME)
    step = np.interp(2.2, found[:-1], np.diff(found))
    assert step < 0.004
    alone = Meridian(passing(1e-3), ()).with_nodes_between(TIME)
    assert np.interp(2.2, alone[:-1], np.diff(alone)) == pytest.approx(0.005)
