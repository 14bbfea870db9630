from __future__ import annotations

from dataclasses import replace

import pytest

from brv_hypo.errors import UnanswerableError
from brv_hypo.motion import reconstruct
from tests.flights import nominal


@pytest.mark.parametrize(
    ("factors", "remedy"),
    [
        ({"q": 0.0, "r": 0.0}, "dead or missing gyro"),
        (dict.fromkeys(("p", "q", "r", "ax", "ay", "az"), 0.0), "dead"),
        ({"q": 1e8, "r": 1e8}, "units"),
        ({"dynamic_pressure": 1e-14}, "not yet in the air"),
    ],
)
def test_records_without_an_answer_are_refused_with_a_remedy(factors: dict[str, float], remedy: str) -> None:
    flight = nominal().flight
    changed = {name: factor * getattr(flight, name) for name, factor in factors.items()}
    with pytest.raises(UnanswerableError, match=remedy):
        reconstruct(replace(flight, **changed))


@pytest.mark.thorough
def test_a_quiet_flight_is_not_refused() -> None:
    """A hundredth of a degree a second is motion all the same."""
    flight = nominal().flight
    quiet = replace(flight, q=flight.q * 1e-3, r=flight.r * 1e-3)
    assert reconstruct(quiet).motion.alpha.size == flight.samples


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_forces_beyond_all_numbers_are_refused() -> None:
    flight = nominal().flight
    with pytest.raises(UnanswerableError, match="do not belong to one motion"):
        reconstruct(replace(flight, ay=1e150 * flight.ay))


WRONG = [("", 1.0), ("ay", -1.0), ("ax ay az", 9.81), ("ax ay az", 0.1), ("p q r", 0.0175)]


@pytest.mark.parametrize(("names", "factor"), WRONG, ids=["sound", "one sign", "in g", "tenths", "degrees"])
def test_a_force_that_no_motion_explains_is_warned_of(names: str, factor: float) -> None:
    flight = nominal().flight
    found = reconstruct(replace(flight, **{name: factor * getattr(flight, name) for name in names.split()}))
    assert any("no motion by these gyros explains" in warning for warning in found.warnings) == bool(names)


@pytest.mark.parametrize(("lost", "warned"), [(0, False), (8, False), (120, True)])
def test_a_gap_across_which_the_attitude_is_unknown_is_warned_of(lost: int, warned: bool) -> None:
    flight = nominal().flight
    gapped = replace(flight, segments=((0, 400), (400 + lost, flight.samples))) if lost else flight
    warnings = " ".join(reconstruct(gapped).warnings)
    assert ("what the vehicle did in it is unknown" in warnings) == warned
    if warned:
        assert f"from {flight.time[400]:.2f} s" in warnings
