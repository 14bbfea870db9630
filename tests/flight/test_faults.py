"""Faults of single channels: found and masked, and never found in a sound channel."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from brv_hypo.flight.cleaning import constant_runs, find_bursts, flat_tops, mask_faults
from brv_hypo.flight.clock import joint_jumps, sigma_of_differences, stamped_steps
from brv_hypo.flight.plausibility import nose_axis, powered_flight
from tests.flight.records import motion

SAMPLES = 800


def channels(seed=0, **changes):
    found = motion(SAMPLES, seed=seed)
    time = found.pop("time")
    return time, {**found, **changes}


def kinds(time, found):
    return [(one.channel, one.fault) for one in mask_faults(time, found)[-1]]


@given(st.floats(14.0, 2000.0), st.floats(0.0, 6.3), st.floats(0.0, 50.0), st.integers(0, 2**31))
@example(55.0, 0.0, 1.0, 14)
def test_motion_however_quantised_is_untouched(cycle, phase, quanta, seed):
    noise = np.random.default_rng(seed).standard_normal(SAMPLES)
    wave = 100.0 * np.sin(2.0 * np.pi * np.arange(SAMPLES) / cycle + phase) + noise
    values = np.rint(wave / quanta) * quanta if quanta > 0.1 else wave
    assert constant_runs(values) == ()
    assert not np.any(find_bursts(values))
    assert not np.any(flat_tops(values))


def test_digits_as_coarse_as_the_noise_are_not_stuck_where_a_wave_turns():
    """Counted over quiet stretches only, 17 of these 2,000 waves had a peak of four samples called stuck."""
    rng, stuck = np.random.default_rng(27), 0
    for _ in range(2000):
        cycle, quanta = np.exp(rng.uniform(np.log([14.0, 0.1]), np.log([2000.0, 10.0])))
        wave = 100.0 * np.sin(2.0 * np.pi * np.arange(SAMPLES) / cycle + rng.uniform(0.0, 6.3))
        stuck += constant_runs(np.rint((wave + rng.standard_normal(SAMPLES)) / quanta) * quanta) != ()
    assert stuck <= 2


def test_a_channel_sampled_and_held_is_untouched():
    held = np.repeat(np.random.default_rng(0).standard_normal(SAMPLES // 20), 20)
    assert constant_runs(held) == ()
    assert not np.any(flat_tops(held))


@given(st.integers(100, 600), st.integers(4, 100), st.integers(0, 2**31))
def test_a_stuck_channel_is_masked_exactly(start, length, seed):
    time, found = channels(seed)
    found["q"][start : start + length] = found["q"][start]
    _, masked, faults = mask_faults(time, found)
    assert np.flatnonzero(np.isnan(masked["q"])).tolist() == list(range(start, start + length))
    assert [(one.channel, one.fault, one.decisive) for one in faults] == [("q", "stuck", False)]


@pytest.mark.parametrize(("limit", "decisive"), [(0.999, False), (0.7, True)])
def test_clipping_is_masked_or_where_it_is_much_decides(limit, decisive):
    time, found = channels()
    found["az"] = np.clip(found["az"], -10.0, limit * 2.0)
    _, masked, faults = mask_faults(time, found)
    assert [(one.channel, one.fault, one.decisive) for one in faults] == [("az", "clipped", decisive)]
    assert bool(np.any(np.isnan(masked["az"]))) is not decisive


@pytest.mark.parametrize("name", ["q", "az", "velocity", "dynamic_pressure"])
def test_a_dead_channel_decides(name):
    time, found = channels()
    found[name] = np.full(SAMPLES, 0.0 if name in ("q", "az") else 900.0)
    assert (name, "dead") in kinds(time, found)


def test_a_record_without_noise_or_roll_has_no_dead_channel():
    time = np.arange(SAMPLES) * 0.01
    still = {name: np.sin(time + i) for i, name in enumerate(("q", "r", "ax", "ay", "az"))}
    constant = {"p": np.zeros(SAMPLES), "velocity": np.full(SAMPLES, 3e3)}
    assert kinds(time, {**still, **constant, "dynamic_pressure": np.full(SAMPLES, 1e3)}) == []


@given(st.integers(50, 700), st.integers(3, 30), st.floats(40.0, 1e4), st.integers(0, 2**31))
def test_a_burst_is_found_exactly(start, length, height, seed):
    values = 50.0 * np.sin(np.arange(SAMPLES) / 30.0) + np.random.default_rng(seed).standard_normal(SAMPLES)
    values[start : start + length] += height
    assert np.flatnonzero(find_bursts(values)).tolist() == list(range(start, start + length))


def test_a_clock_that_was_set_ahead_is_set_back_and_a_gap_is_not():
    time, found = channels()
    late = np.where(np.arange(SAMPLES) >= 400, time + 0.1, time)
    steady, _, faults = mask_faults(late, found)
    np.testing.assert_allclose(steady, time, atol=1e-9)
    assert [(one.channel, one.fault, one.decisive) for one in faults] == [("time", "clock step", False)]
    kept = np.delete(np.arange(SAMPLES), np.arange(400, 410))
    assert stamped_steps(time[kept], {name: values[kept] for name, values in found.items()}) == ()


@pytest.mark.parametrize("at", range(380, 460, 8))
def test_a_clock_step_in_motion_too_fast_for_a_cubic_is_one_all_the_same(at):
    """Some fifty samples a cycle, and next to no noise: a cubic through twelve misses them by more."""
    time, found = channels()
    wave = np.exp(2j * np.pi * np.arange(SAMPLES) / 45.0)
    fast = {"q": wave.real, "r": wave.imag, "ay": wave.real, "az": wave.imag}
    for name, values in fast.items():
        found[name] = found[name] + 1000.0 * sigma_of_differences([found[name]]) * values
    late = np.where(np.arange(SAMPLES) >= at, time + 0.1, time)
    assert [place for place, _ in stamped_steps(late, found)] == [at]
    kept = np.delete(np.arange(SAMPLES), np.arange(at, at + 10))
    assert stamped_steps(time[kept], {name: values[kept] for name, values in found.items()}) == ()


def test_samples_lost_without_a_trace_are_found():
    time, found = channels()
    assert joint_jumps(found) == ()
    kept = np.delete(np.arange(SAMPLES), np.arange(400, 420))
    (at,) = joint_jumps({name: values[kept] for name, values in found.items()})
    assert abs(at - 400) <= 1
    assert ("time", "clock step") in kinds(time[: kept.size], {name: values[kept] for name, values in found.items()})


@pytest.mark.parametrize("lost", [2, 10, 60])
def test_a_gap_in_the_stamps_is_no_fault(lost: int):
    """Neither a step of the clock, nor are the samples between two gaps a burst."""
    time, found = channels()
    missing = np.r_[400 : 400 + lost, 440 + lost : 440 + 2 * lost]
    kept = np.delete(np.arange(SAMPLES), missing)
    assert kinds(time[kept], {name: values[kept] for name, values in found.items()}) == kinds(time, found)


@pytest.mark.parametrize("within", [0.1, 0.5, 0.9])
def test_a_kink_of_the_rates_with_a_jump_of_the_forces_is_no_clock_step(within):
    """A moment that sets in: the accelerometers off the centre of gravity jump, the gyros do not."""
    _, found = channels()
    late = np.maximum(np.arange(SAMPLES) - 400.0 - within, 0.0)
    scale = 100.0 * np.std(np.diff(found["q"]))
    found["q"] = found["q"] + scale * late
    found["az"] = found["az"] + 50.0 * np.std(found["az"]) * (late > 0.0)
    assert joint_jumps(found) == ()


@pytest.mark.parametrize("turning", [100.0, 300.0])
def test_what_turns_about_the_vehicle_after_a_rest_is_no_thrust(turning: float) -> None:
    """A force across the axis that turns makes no speed along its own mean: there is nothing to lift off."""
    time = np.arange(0.0, 8.0, 0.005)
    force = np.where(time < 3.0, 0.0, 40.0)
    forces = np.stack([9.81 * (time < 3.0), force * np.cos(turning * time), force * np.sin(turning * time)])
    assert powered_flight(time, forces) is None
    assert nose_axis(time, np.zeros_like(forces), forces) is None
