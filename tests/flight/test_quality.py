"""Inspection: noise estimates that are right or say that they are not, gaps, spikes, rates."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, sosfilt, sosfiltfilt

from brv_hypo.comparison.preparation import filter_warnings
from brv_hypo.errors import UsageError
from brv_hypo.flight import inspect_flight, white_noise
from brv_hypo.flight.clock import strongest_frequency
from brv_hypo.flight.inspection import FILTERED
from brv_hypo.simulation import simulate
from tests.flight.records import flight, motion, write_raw


@pytest.mark.parametrize("samples_per_cycle", [16.0, 40.0, 400.0])
@pytest.mark.parametrize("sigma", [1e-3, 0.1])
def test_white_noise_is_measured_beside_motion(samples_per_cycle: float, sigma: float) -> None:
    rng = np.random.default_rng(1)
    wave = np.sin(2.0 * np.pi * np.arange(1000) / samples_per_cycle)
    estimates = [white_noise(wave + sigma * rng.standard_normal(1000)) for _ in range(200)]
    sigmas = np.array([one.sigma for one in estimates])
    assert np.median(sigmas) == pytest.approx(sigma, rel=0.02)
    assert np.std(sigmas) < 0.08 * sigma
    assert np.mean([one.trusted for one in estimates]) > 0.97


def test_noise_that_is_not_white_is_not_trusted() -> None:
    rng = np.random.default_rng(1)
    white = rng.standard_normal(3000)
    coloured = np.convolve(white, np.ones(4) / 4.0, mode="valid")
    fast = np.sin(2.0 * np.pi * np.arange(3000) / 7.0)
    for values in (coloured, fast + 1e-4 * white, np.ones(3000), np.rint(0.2 * white), white[:40]):
        assert not white_noise(values).trusted


def test_gaps_do_not_disturb_the_noise() -> None:
    values = np.random.default_rng(4).standard_normal(4000)
    values[::50] = np.nan
    assert white_noise(values).sigma == pytest.approx(1.0, rel=0.1)


def test_a_trend_is_no_periodic_motion() -> None:
    """A trend in noise has none; beneath one a motion of 2 Hz is found."""
    time = np.arange(0.0, 10.0, 0.02)
    trend = 0.1 * (time - 3.0) ** 2 + 1e-3 * np.random.default_rng(1).standard_normal(500)
    cycle = 1e-2 * np.sin(4.0 * np.pi * time)
    assert strongest_frequency(trend, -trend, 0.02, ((0, 500),)) == 0.0
    assert strongest_frequency(trend + cycle, trend, 0.02, ((0, 500),)) == pytest.approx(2.0, abs=0.1)


def test_a_record_is_described_as_it_was_recorded(tmp_path: Path) -> None:
    channels = motion(2000, 200.0, frequency=2.0)
    channels["p"] = np.rad2deg(channels["p"])
    channels["q"][[300, 900]] += 0.5
    channels["ay"][1000:1040] = np.nan
    found = inspect_flight(write_raw(tmp_path / "f.h5", channels, units={"p": "deg/s"}))
    by_name = {channel.name: channel for channel in found.channels}
    assert found.sample_rate == pytest.approx(200.0)
    assert found.samples == 2000
    assert len(found.segments) == 2
    assert found.transverse_frequency == pytest.approx(2.0, abs=0.2)
    assert (by_name["p"].units, by_name["p"].si_units) == ("deg/s", "rad/s")
    assert by_name["p"].maximum == pytest.approx(6.0, abs=0.01)
    assert by_name["q"].spikes == 2
    assert by_name["q"].noise.sigma == pytest.approx(1e-3, rel=0.1)
    assert (by_name["ay"].missing, by_name["ay"].longest_gap) == (40, 40)
    assert by_name["mach"].derived
    assert found.absent == ("roll_rate_mag",)
    assert found.dynamic_pressure_range[0] == pytest.approx(4500.0, rel=0.01)
    assert found.warnings == ()


def test_a_flight_in_memory_is_inspected_as_one_from_a_file(tmp_path: Path) -> None:
    from_memory = inspect_flight(flight(planet="mars"))
    from_file = inspect_flight(write_raw(tmp_path / "f.h5", motion()))
    for a, b in zip(from_memory.channels, from_file.channels, strict=False):
        assert (a.name, a.noise, a.missing) == (b.name, b.noise, b.missing)


def test_a_window_is_inspected_as_it_was_recorded(tmp_path: Path) -> None:
    channels = motion(2000, 200.0, frequency=2.0)
    channels["q"][[300, 900]] += 0.5
    path = write_raw(tmp_path / "f.h5", channels)
    found = inspect_flight(path, start=11.0, stop=13.0)
    assert (found.start, found.stop, found.samples) == (11.0, 13.0, 401)
    assert next(channel for channel in found.channels if channel.name == "q").spikes == 1
    with pytest.raises(UsageError, match="window"):
        inspect_flight(path, start=50.0)


def test_few_samples_a_cycle_are_warned_of(tmp_path: Path) -> None:
    found = inspect_flight(write_raw(tmp_path / "f.h5", motion(400, 10.0, frequency=2.0)))
    assert found.samples_per_cycle == pytest.approx(5.0, rel=0.05)
    assert any("samples a cycle" in warning for warning in found.warnings)


@pytest.mark.thorough
@pytest.mark.parametrize("plant", ["", "bodyfixed"])
def test_a_record_that_was_low_passed_is_said_to_be(plant: str) -> None:
    """And none that was not, however quiet: where a moment jumps, rates fall with the square of the frequency."""
    quiet = {"gyro": {"noise": 1e-7}, "accelerometer": {"noise": 1e-5}}
    plants = (plant,) if plant else ()
    as_it_was, jumps = (
        simulate("research_cone", seed=2, plant=plants, duration=3.0, **changes).flight
        for changes in ({}, {"instruments": quiet})
    )
    assert FILTERED not in (*inspect_flight(as_it_was).warnings, *inspect_flight(jumps).warnings)
    for filtering, order in ((sosfilt, 2), (sosfiltfilt, 4)):
        low_pass = butter(order, 30.0, fs=as_it_was.sample_rate, output="sos")
        rates = {name: filtering(low_pass, getattr(as_it_was, name)) for name in ("q", "r")}
        filtered = replace(as_it_was, **rates)
        assert FILTERED in inspect_flight(filtered).warnings
        assert filter_warnings([filtered]) == (FILTERED,)
        assert filter_warnings([as_it_was, filtered, jumps]) == (f"flight 2: {FILTERED}",)
