"""Effects planted into a record that was made without them, through the motion that they would have made."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.errors import UnanswerableError
from brv_hypo.flight import Flight
from brv_hypo.mechanisms import Mechanism, find
from brv_hypo.model.model import restored
from brv_hypo.tracing import TraceConfig, trace
from brv_hypo.tracing.fit import Fit, Flights, converged
from tests.chains import ONE_EFFECT, traced_trim, trimmed
from tests.flights import nominal
from tests.studies.loop import record_study
from tests.studies.loop.planting import DETECTED
from tests.studies.loop.planting_on_record import with_moment
from tests.studies.loop.record_study import Ground, found_in, ground, limits_there, line, planted

MAGNUS = -1.0


@pytest.fixture(scope="module")
def base() -> Ground:
    return ground(nominal().flight, 0)


@pytest.fixture(scope="module")
def state() -> Fit:
    """What the flight's least-squares problem is linearised about."""
    flights = (trimmed().flight,)
    return converged(Flights(flights, ONE_EFFECT), restored(traced_trim().model.definition, flights))


@pytest.mark.thorough
def test_nothing_planted_changes_nothing(state: Fit) -> None:
    flight = trimmed().flight
    again = with_moment(flight, state, find("magnus"), [0.0])
    for name in ("q", "r", "ay", "az"):
        np.testing.assert_array_equal(getattr(again, name), getattr(flight, name))


@pytest.mark.slow
def test_what_is_planted_is_found_at_its_size(base: Ground) -> None:
    flight = with_moment(base.flight, base.state, find("magnus"), [MAGNUS])
    settings = TraceConfig(effects=("magnus", "trim"), discover=False, max_steps=2)
    result = trace(flight, settings)
    assert result.added == ("magnus",)
    term = next(term for term in result.model.terms if term.mechanism == "magnus")
    assert abs(term.value - MAGNUS) < 0.1 * abs(MAGNUS)


@pytest.mark.thorough
def test_little_is_planted_in_proportion(state: Fit) -> None:
    """Much of it acts on the motion that it changed."""
    flight = trimmed().flight

    def change(value: float) -> np.ndarray:
        changed = with_moment(flight, state, find("magnus"), [value])
        return np.concatenate([changed.q - flight.q, changed.az - flight.az])

    little = change(1e-3 * MAGNUS)
    assert np.linalg.norm(change(2e-3 * MAGNUS) - 2.0 * little) < 1e-2 * np.linalg.norm(little)


@pytest.mark.thorough
def test_nothing_is_planted_before_its_onset(state: Fit) -> None:
    flight = trimmed().flight
    onset = float(flight.time[flight.samples // 2])
    changed = with_moment(flight, state, find("magnus"), [MAGNUS], onset)
    before = flight.time < onset - 0.1
    np.testing.assert_array_equal(changed.q[before], flight.q[before])
    assert np.max(np.abs(changed.q - flight.q)[~before]) > 0.0


@pytest.mark.thorough
def test_what_turns_the_vehicle_too_far_is_refused(state: Fit) -> None:
    with pytest.raises(UnanswerableError, match="would turn the vehicle to"):
        with_moment(trimmed().flight, state, find("trim"), [1.0, 0.0])


@pytest.mark.slow
def test_beside_noise_a_record_shows_as_many_limits_as_are_planted(base: Ground) -> None:
    flight = with_moment(base.flight, base.state, find("magnus"), [MAGNUS])
    there, shown = limits_there(base, flight, find("magnus"), np.array([MAGNUS]), None)
    assert there > 5.0
    assert shown == pytest.approx(there, abs=3.0 / DETECTED)


@pytest.mark.slow
def test_where_the_record_has_the_opposite_of_it_nothing_shows(base: Ground) -> None:
    other = ground(with_moment(base.flight, base.state, find("magnus"), [-MAGNUS]), 0)
    flight = with_moment(other.flight, other.state, find("magnus"), [MAGNUS])
    there, shown = limits_there(other, flight, find("magnus"), np.array([MAGNUS]), None)
    assert there > 5.0
    assert abs(shown) < 0.2 * there


@pytest.mark.slow
def test_the_study_reports_a_planted_effect(base: Ground) -> None:
    flight, size = planted(base, "stiffness_asymmetry", 8.0, 1)
    said = line("stiffness_asymmetry", size, found_in(base, flight))
    assert " found: " in said


@pytest.mark.thorough
def test_a_moment_that_the_vehicle_cannot_bear_is_planted_with_the_other_sign(
    base: Ground, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: list[list[float]] = []

    def bears_the_second(flight: Flight, state: Fit, item: Mechanism, values: list[float], onset: float) -> Flight:
        tried.append(values)
        if len(tried) == 1:
            raise UnanswerableError("too far")
        return flight

    monkeypatch.setattr(record_study, "with_moment", bears_the_second)
    _, size = planted(base, "magnus", 3.0, 1)
    assert tried[1] == [-value for value in tried[0]]
    assert f"{tried[1][0]:.3g}" in size


@pytest.mark.thorough
def test_a_mechanism_with_a_delay_is_not_planted(base: Ground) -> None:
    with pytest.raises(UnanswerableError, match="looks back in time"):
        planted(base, "sticking", 3.0, 1)


@pytest.mark.thorough
def test_an_error_of_an_instrument_is_planted_at_its_own_limit(base: Ground) -> None:
    """Within its prior nothing is detected below five tolerances: twice that is ten at least."""
    flight, size = planted(base, "time_skew", 2.0, 1)
    tolerances = float(size.split(", ")[1].split(" ")[0])
    assert 10.0 <= tolerances <= 30.0
    assert np.any(flight.q != base.flight.q) or np.any(flight.ay != base.flight.ay)


@pytest.mark.thorough
def test_an_error_that_no_instrument_has_is_not_planted(base: Ground) -> None:
    with pytest.raises(UnanswerableError, match="no instrument errs so much"):
        planted(base, "gyro_bias", 100.0, 1)
