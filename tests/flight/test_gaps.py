"""Uniform time and gaps: what is kept, resampled, bridged and cut, against the motion that was sampled."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from brv_hypo.flight import load_flight, save_flight
from brv_hypo.flight.clock import bridge, crossed, longest_gap, regularise
from brv_hypo.thresholds import BRIDGED_SAMPLES
from tests.flight.records import flight, motion, write_raw


def wave(time: Any, frequency: float = 1.0) -> Any:
    return np.sin(2.0 * np.pi * frequency * time)


@given(st.floats(1e-4, 2.0), st.floats(-1e4, 1e4), st.integers(16, 300), st.floats(0.0, 0.0049))
def test_time_uniform_within_one_percent_is_not_changed(step: float, start: float, samples: int, jitter: float) -> None:
    rng = np.random.default_rng(samples)
    time = start + step * (np.arange(samples) + jitter * rng.uniform(-1.0, 1.0, samples))
    values = wave(time)
    found, channels, notes = regularise(time, {"q": values})
    np.testing.assert_array_equal(found, time)
    np.testing.assert_array_equal(channels["q"], values)
    assert notes == ()


@given(st.integers(0, 2**31), st.floats(0.05, 0.2))
def test_jittered_time_is_resampled_to_the_motion(seed: int, jitter: float) -> None:
    rng = np.random.default_rng(seed)
    time = 0.01 * (np.arange(500) + jitter * rng.uniform(-1.0, 1.0, 500))
    found, channels, (note,) = regularise(time, {"q": wave(time)})
    np.testing.assert_allclose(np.diff(found), found[1] - found[0], rtol=1e-9)
    np.testing.assert_allclose(channels["q"], wave(found), atol=2e-5)
    assert "resampled" in note


@pytest.mark.parametrize(("digits", "within"), [(4, True), (3, False), (5, True)])
def test_stamps_within_their_rounding_are_those_of_an_even_clock(digits: int, within: bool) -> None:
    """342 Hz, printed to 0.1 ms, which is 1.7 % of the step; whole milliseconds tell no such rate."""
    even = 45296.0 + np.arange(1500) / 342.0
    stamps = np.round(even, digits)
    time, channels, notes = regularise(stamps, {"q": np.sin(even)})
    assert any("not uniform" in note for note in notes) is not within
    if within:
        assert np.array_equal(channels["q"], np.sin(even))
        np.testing.assert_allclose(time, even, atol=1e-5)


def test_stamps_that_err_by_more_than_their_rounding_are_resampled() -> None:
    uneven = np.arange(1500) / 342.0 + 2e-4 * np.sin(np.arange(1500))
    _, _, notes = regularise(np.round(uneven, 4), {"q": np.sin(uneven)})
    assert "not uniform" in notes[0]


def test_strongly_jittered_time_is_resampled_and_bridged(tmp_path: Path) -> None:
    channels = motion(500, 100.0, frequency=1.0)
    steady = channels["time"].copy()
    channels["time"] = steady + 0.004 * np.random.default_rng(6).uniform(-1.0, 1.0, 500)
    channels["q"] = wave(channels["time"])
    found = load_flight(write_raw(tmp_path / "f.h5", channels))
    assert found.segments == ((0, found.samples),)
    assert found.sample_rate == pytest.approx(100.0, rel=1e-3)
    np.testing.assert_allclose(found.q, wave(found.time), atol=1e-4)


def test_missing_rows_become_missing_samples() -> None:
    kept = np.delete(np.arange(200), [20, 21, 90])
    time = 0.02 * kept
    found, channels, (note,) = regularise(time, {"q": wave(time)})
    np.testing.assert_allclose(found, 0.02 * np.arange(200), atol=1e-12)
    assert np.flatnonzero(np.isnan(channels["q"])).tolist() == [20, 21, 90]
    np.testing.assert_array_equal(channels["q"][kept], wave(time))
    assert note.startswith("3 rows are missing")


def test_resampling_keeps_gaps() -> None:
    rng = np.random.default_rng(3)
    time = 0.01 * (np.arange(400) + 0.1 * rng.uniform(-1.0, 1.0, 400))
    values = np.where((time > 1.0) & (time < 1.5), np.nan, wave(time))
    found, channels, _ = regularise(time, {"q": values})
    missing = np.isnan(channels["q"])
    assert np.all(missing[(found > 1.0) & (found < 1.49)])
    assert not np.any(missing[(found < 0.97) | (found > 1.53)])


@pytest.mark.parametrize(
    ("rate", "frequency", "allowed"), [(200.0, 1.0, 5), (50.0, 2.0, 3), (8.0, 0.5, 2), (8.0, 2.0, 1)]
)
def test_the_longest_bridged_gap_is_an_eighth_of_a_cycle(rate: float, frequency: float, allowed: int) -> None:
    time = np.arange(800) / rate
    assert longest_gap(1.0 / rate, wave(time, frequency), 0.1 * wave(time, frequency)) == allowed
    assert longest_gap(1.0 / rate, np.zeros(800), np.ones(800)) == BRIDGED_SAMPLES


@given(st.floats(16.0, 400.0), st.floats(0.0, 6.3), st.integers(20, 170))
def test_a_bridged_gap_is_within_a_percent_of_the_amplitude(samples_per_cycle: float, phase: float, start: int) -> None:
    time = np.arange(200.0)
    truth = np.sin(2.0 * np.pi * time / samples_per_cycle + phase)
    length = min(BRIDGED_SAMPLES, int(samples_per_cycle / 8.0))
    values = truth.copy()
    values[start : start + length] = np.nan
    np.testing.assert_allclose(bridge(time, values, length), truth, atol=1e-2)


def test_a_longer_gap_and_the_ends_are_not_bridged() -> None:
    values = wave(0.01 * np.arange(100))
    for gap in (slice(0, 2), slice(50, 54), slice(98, 100)):
        gone = values.copy()
        gone[gap] = np.nan
        np.testing.assert_array_equal(bridge(np.arange(100.0), gone, 3), gone)


def record_with(gaps: dict[str, list[slice]], **more: Any) -> dict[str, Any]:
    channels = {**motion(1000, 100.0, frequency=1.0), **more}
    for name, cuts in gaps.items():
        for cut in cuts:
            channels[name] = np.array(channels[name])
            channels[name][cut] = np.nan
    return channels


def test_a_short_gap_is_bridged_and_a_long_one_cuts(tmp_path: Path) -> None:
    gaps = {"q": [slice(100, 105)], "ay": [slice(400, 406)]}
    found = load_flight(write_raw(tmp_path / "f.h5", record_with(gaps)))
    assert found.segments == ((0, 400), (406, 1000))
    truth = motion(1000, 100.0, frequency=1.0)
    np.testing.assert_allclose(found.q[100:105], truth["q"][100:105], atol=8e-3)
    assert np.all(np.isfinite(found.ay))
    assert any(note.startswith("q: 5 missing samples bridged") for note in found.notes)
    assert any("14.000 to 14.050 s (6 samples) left out" in note and "ay" in note for note in found.notes)


def test_air_data_are_bridged_over_a_second(tmp_path: Path) -> None:
    gaps = {"velocity": [slice(100, 200), slice(500, 601)]}
    found = load_flight(write_raw(tmp_path / "f.h5", record_with(gaps)))
    assert found.segments == ((0, 500), (601, 1000))
    np.testing.assert_allclose(found.velocity[100:200], motion(1000)["velocity"][100:200], rtol=1e-9)


def test_a_slow_channel_recorded_at_a_lower_rate_is_filled(tmp_path: Path) -> None:
    channels = motion(1000)
    slow = np.full(1000, np.nan)
    slow[::20] = channels["velocity"][::20]
    found = load_flight(write_raw(tmp_path / "f.h5", {**channels, "velocity": slow}))
    assert found.segments == ((0, 981),)
    np.testing.assert_allclose(found.velocity[:981], channels["velocity"][:981], rtol=1e-9)


def test_an_optional_channel_never_cuts(tmp_path: Path) -> None:
    channels = record_with({"mach": [slice(300, 800)]}, mach=np.linspace(20.0, 10.0, 1000))
    found = load_flight(write_raw(tmp_path / "f.h5", channels))
    assert found.segments == ((0, 1000),)
    assert found.mach is not None
    np.testing.assert_allclose(found.mach, np.linspace(20.0, 10.0, 1000))
    assert any(note.startswith("mach: 500 samples in long gaps") for note in found.notes)


def test_missing_ends_are_trimmed_and_scraps_left_out(tmp_path: Path) -> None:
    gaps = {"p": [slice(0, 50), slice(60, 100), slice(990, 1000)]}
    found = load_flight(write_raw(tmp_path / "f.h5", record_with(gaps)))
    assert found.time[0] == pytest.approx(11.0)
    assert found.segments == ((0, 890),)
    assert any("10.000 to 10.990 s (100 samples) left out" in note for note in found.notes)


def test_many_cuts_are_summed_up(tmp_path: Path) -> None:
    gaps = {"q": [slice(start, start + 10) for start in range(40, 1000, 60)]}
    found = load_flight(write_raw(tmp_path / "f.h5", record_with(gaps)))
    assert len(found.segments) == 17
    assert sum("left out" in note for note in found.notes) == 11
    assert "6 more such stretches (60 samples) left out" in found.notes


def test_a_cut_outlives_a_round_trip(tmp_path: Path) -> None:
    gaps = {"q": [slice(100, 105)], "ay": [slice(400, 460)]}
    first = load_flight(write_raw(tmp_path / "f.h5", record_with(gaps)))
    save_flight(first, tmp_path / "again.h5")
    second = load_flight(tmp_path / "again.h5")
    assert second.segments == first.segments
    np.testing.assert_array_equal(second.q[:400], first.q[:400])
    assert second.notes[: len(first.notes)] == first.notes


def test_a_clean_record_has_no_notes(tmp_path: Path) -> None:
    save_flight(flight(planet="mars", altitude=motion()["time"], mach=motion()["time"]), tmp_path / "f.h5")
    notes = load_flight(tmp_path / "f.h5").notes
    assert notes == (
        "density derived from dynamic pressure and velocity",
        "reynolds missing and not derived: the planet is mars, and the only atmosphere model is Earth's",
    )


@pytest.mark.parametrize("lost", [6, 10, 24])
@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_rates_that_fill_a_gap_give_the_attitude_after_it(lost: int, noise: float) -> None:
    """The integral over the gap errs by no more than a few samples' noise; along a straight line, by far more."""
    step, frequency = 0.005, 1.0
    time = step * np.arange(800)
    rate = np.sin(2.0 * np.pi * frequency * time + 0.7)
    measured = rate + noise * np.random.default_rng(lost).standard_normal(time.size)
    measured[300 : 300 + lost] = np.nan
    inside = slice(300, 300 + lost)
    error = step * abs(np.sum(crossed(measured, lost)[inside] - rate[inside]))
    assert error < step * (1e-3 * lost + 3.0 * noise * np.sqrt(lost))
    if noise == 0.0:
        straight = step * abs(np.sum(crossed(measured, lost - 1)[inside] - rate[inside]))
        assert error < 0.1 * straight
