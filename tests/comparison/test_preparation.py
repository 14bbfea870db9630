"""What is linearised about, and what is done where a record has no motion there."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from brv_hypo import compare
from brv_hypo.comparison import CompareConfig, preparation
from brv_hypo.errors import UnanswerableError, UsageError
from brv_hypo.flight.record import Flight
from brv_hypo.motion import reconstruct
from tests.chains import judged_cone
from tests.flights import flown


@pytest.mark.thorough
@pytest.mark.parametrize("where", ["require_answerable", pytest.param("reconstruct", marks=pytest.mark.slow)])
def test_a_record_that_has_no_motion_without_its_errors_or_under_its_noise_is_compared_as_it_is(
    monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    """As the record reads it has a motion: it was reconstructed from that."""
    calls: list[Any] = []
    flight = flown("research_cone", "bodyfixed").flight.window(0.0, 3.5)

    def runs_away(record: Flight, *settings: Any) -> None:
        if where == "reconstruct" or not np.array_equal(record.q, flight.q):
            calls.append((record, settings))
            raise UnanswerableError("the attitude runs away")

    monkeypatch.setattr(preparation, "COLOURED", 0.0)  # so that the noise of every record counts as coloured
    monkeypatch.setattr(preparation, where, runs_away)
    config = CompareConfig(mechanisms=("bodyfixed", "damping"), maximum_likelihood="none", knot_count=3)
    verdict = compare(flight, config).verdict
    assert verdict.outcome in ("named", "undecided", "none adequate")
    assert verdict.probability["damping"] < 0.02
    assert calls


@pytest.mark.parametrize(
    "planted", ["bodyfixed", *(pytest.param(name, marks=pytest.mark.slow) for name in ("damping", "sticking"))]
)
def test_the_noise_beside_a_large_mechanism_is_that_of_the_instruments(planted: str) -> None:
    """Beside a smooth moment alone it was 1.3 to 15 times as large, for that follows no jump."""
    simulated = flown("research_cone", planted)
    found = judged_cone(planted)
    noise, known = found.problem.rows.noise, simulated.config.instruments
    assert noise.rates.sigma == pytest.approx(known.gyro.noise, rel=0.06)
    assert noise.force.sigma == pytest.approx(known.accelerometer.noise, rel=0.06)
    leader = found.leading.fit
    assert np.sqrt(leader.rss / found.problem.samples) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("outside", [-1.0, 1e3])
def test_a_knot_outside_the_record_is_refused_by_name(outside: float) -> None:
    """Nothing can change there, and as a parameter it would have bounds that end before they begin."""
    config = CompareConfig(mechanisms=("inplane",), knots=(2.0, outside), maximum_likelihood="none")
    with pytest.raises(UsageError, match=rf"knots at {outside:g} s, expected times between 0 and "):
        compare(flown("research_cone", "bodyfixed").flight, config)


def test_order_and_repetition_of_knots_change_nothing() -> None:
    shuffled = CompareConfig(mechanisms=("inplane",), knots=(3.0, 1.0, 2.0, 1.0))
    problem, _ = preparation.shared_problem([reconstruct(flown("research_cone", "inplane").flight)], shuffled)
    np.testing.assert_array_equal(problem.knots, [1.0, 2.0, 3.0])


def test_a_window_of_less_than_a_cycle_is_said_to_be_short() -> None:
    """Its rms frequency and length say so; one of many cycles is not."""
    flight = flown("research_cone", "bodyfixed").flight
    whole = reconstruct(flight)
    per_cycle = (flight.time[-1] - flight.time[0]) / preparation.cycles(whole.motion)
    short = reconstruct(flight.window(2.0, 2.0 + 0.5 * per_cycle))
    assert preparation.short_warnings([whole]) == ()
    (said,) = preparation.short_warnings([short])
    assert "cycles of the transverse motion, expected one at least" in said
