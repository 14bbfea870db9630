"""Air data that a slower computer writes, held between its new values, are read at their instants."""

from dataclasses import replace

import numpy as np
import pytest

from brv_hypo.flight.cleaning import find_holds, interpolated_holds
from brv_hypo.flight.format import masked_flight
from tests.flights import nominal

TIME = np.arange(0.0, 6.0, 0.01)
SMOOTH = 9000.0 * np.exp(-((TIME - 4.0) ** 2) / 6.0)


def held(values, every, first=0):
    """`values` (n,), each kept over `every` samples, the first over less."""
    places = np.maximum((np.arange(values.size) - first) // every * every + first, 0)
    return values[places]


@pytest.mark.parametrize("every", [2, 3, 10, 25])
@pytest.mark.parametrize("first", [0, 1])
def test_new_values_are_those_of_their_instants(every, first):
    channel = held(SMOOTH, every, first)
    new = find_holds(channel)
    assert new is not None
    assert np.all((new - first) % every == 0)
    read, faults = interpolated_holds(TIME, {"velocity": channel})
    bend = np.max(np.abs(np.diff(SMOOTH, 2)))  # of a chord over `every` samples: within every^2 / 8 of it
    inside = slice(first, TIME.size - every)
    assert np.max(np.abs(read["velocity"] - SMOOTH)[inside]) <= bend * every**2 / 8.0 * 1.01
    assert np.max(np.abs(read["velocity"] - SMOOTH)) <= bend * every**2 * 1.01
    (fault,) = faults
    assert (fault.fault, fault.decisive) == ("held", False)
    assert f"{100.0 / every:.3g} Hz" in fault.action


def test_no_hold_is_found_where_there_is_none():
    noise = np.random.default_rng(4).normal(size=TIME.size)
    others = {
        "noisy": SMOOTH + noise,
        "rounded": np.round(SMOOTH / 40.0) * 40.0,
        "ramp, rounded": np.round(TIME * 7.0),
        "noisy, rounded": np.round(SMOOTH / 3.0 + 0.3 * noise),
        "constant": np.full(TIME.size, 3.0),
    }
    for name, channel in others.items():
        assert find_holds(channel) is None, name


def test_gyros_are_not_interpolated():
    channel = held(np.sin(TIME), 4)
    assert find_holds(channel) is not None
    read, faults = interpolated_holds(TIME, {"q": channel})
    assert read["q"] is channel
    assert not faults


def test_missing_samples_stay_missing():
    channel = held(SMOOTH, 10)
    channel[200:230] = np.nan
    read, _ = interpolated_holds(TIME, {"velocity": channel})
    assert np.array_equal(np.isnan(read["velocity"]), np.isnan(channel))


def test_a_flight_is_read_so_and_says_it():
    flight = nominal().flight
    slow = replace(flight, **{name: held(getattr(flight, name), 10) for name in ("velocity", "dynamic_pressure")})
    read, faults = masked_flight(slow)
    assert {fault.channel for fault in faults if fault.fault == "held"} == {"velocity", "dynamic_pressure"}
    for name in ("velocity", "dynamic_pressure"):
        true = getattr(flight, name)
        off, before = (np.abs(getattr(each, name) - true) for each in (read, slow))
        assert np.max(off[:-10]) < 0.3 * np.max(before)  # beside its noise
        assert np.max(off) < 0.5 * np.max(before)
    again, same = masked_flight(read)
    assert again is read
    assert set(same) == set(read.faults)
