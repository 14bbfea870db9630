from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from brv_hypo.model.term import TimeBasis

TIMES = st.floats(-5.0, 5.0)


@given(start=TIMES, length=st.floats(0.1, 4.0))
def test_a_jump_that_ends_is_the_difference_of_two_jumps(start: float, length: float) -> None:
    time = np.linspace(-6.0, 10.0, 400)
    both = TimeBasis("jump", start)(time) - TimeBasis("jump", start + length)(time)
    np.testing.assert_array_equal(TimeBasis("jump", start, start + length)(time), both)


@given(start=TIMES, length=st.floats(0.1, 4.0))
def test_a_ramp_that_ends_holds_its_last_value(start: float, length: float) -> None:
    """Eq. 3.7: a ramp that stops is the difference of two truncated powers."""
    time = np.linspace(-6.0, 12.0, 400)
    both = TimeBasis("ramp", start)(time) - TimeBasis("ramp", start + length)(time)
    np.testing.assert_allclose(TimeBasis("ramp", start, start + length)(time), both, atol=1e-12)


@pytest.mark.parametrize(("kind", "units"), [("constant", "1/rad"), ("jump", "1/rad"), ("ramp", "1/rad/s")])
def test_the_units_of_a_ramp_are_per_second(kind: str, units: str) -> None:
    assert TimeBasis(kind, 0.0).units("1/rad") == units  # type: ignore[arg-type]
