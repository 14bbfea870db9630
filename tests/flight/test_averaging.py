"""Means of a record that is sampled far more finely than its motion needs."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from brv_hypo.flight import Flight
from brv_hypo.flight.derived import AVERAGED_BEYOND, AVERAGED_PER_CYCLE, averaged
from brv_hypo.model.reconstruction import reconstruct
from brv_hypo.motion import ReconstructionConfig
from tests.flights import nominal
from tests.studies.comparison.benchmark import finer, flights

SAMPLES = 24_001


@cache
def fine() -> Flight:
    """More samples than are analysed, at 4 kHz."""
    return finer(nominal().flight, SAMPLES)


def test_a_short_record_is_analysed_as_it_is() -> None:
    short = fine().window(0.0, 1.0)
    assert short.samples < AVERAGED_BEYOND
    assert averaged(short) is short


def test_a_long_record_without_samples_to_spare_is_analysed_as_it_is() -> None:
    """The same samples, said to be taken over so long a time that the spin alone needs them all."""
    slow = replace(fine(), time=fine().time * 100.0)
    assert averaged(slow) is slow


def test_means_are_enough_for_the_motion_and_far_fewer() -> None:
    lean = averaged(fine())
    assert lean.samples < SAMPLES / 4
    assert lean.sample_rate > AVERAGED_PER_CYCLE * np.max(np.abs(lean.p)) / (2.0 * np.pi)
    assert "means of" in lean.notes[-1]


def test_time_and_channels_are_means_of_the_same_samples() -> None:
    whole, lean = fine(), averaged(fine())
    every = round(lean.step / whole.step)
    for own, mean in ((whole.time, lean.time), (whole.q, lean.q), (whole.dynamic_pressure, lean.dynamic_pressure)):
        assert mean[7] == pytest.approx(np.mean(own[7 * every : 8 * every]), rel=1e-12)
    assert np.ptp(np.diff(lean.time)) < 1e-9


@pytest.mark.parametrize("gap", [(12_000, 12_500), (11_999, 15_001)])
def test_no_mean_reaches_into_a_gap(gap: tuple[int, int]) -> None:
    holed = replace(fine(), segments=((0, gap[0]), (gap[1], SAMPLES)))
    lean = averaged(holed)
    every = round(lean.step / holed.step)
    for (a, b), (first, last) in zip(holed.segments, lean.segments, strict=True):
        assert a <= first * every < last * every <= b
        assert b - a - (last - first) * every < 2 * every


@pytest.mark.slow
def test_the_motion_of_the_means_is_that_of_the_record_within_its_noise() -> None:
    """Coning and spin are damped alike in all channels: alpha keeps its size."""
    flight = finer(flights([], 1_201, ["none"])["none"], SAMPLES)
    dense = flight.window(0.5, 2.0)
    assert dense.samples <= AVERAGED_BEYOND
    whole = reconstruct(dense, ReconstructionConfig())
    lean = reconstruct(averaged(flight).window(0.5, 2.0), ReconstructionConfig())
    alpha = np.interp(lean.motion.time, whole.motion.time, whole.motion.alpha)
    assert np.sqrt(np.mean((lean.motion.alpha - alpha) ** 2)) < 0.5 * lean.alpha_rms_sigma
    assert lean.alpha_rms_sigma == pytest.approx(whole.alpha_rms_sigma, rel=0.3)
