"""What is as slow as the motion follows from the samples that are kept."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from brv_hypo.motion import interpolation as module
from brv_hypo.motion.interpolation import blocks, decimated_grid, spacing
from brv_hypo.motion.responses import RESPONSE_PER_CYCLE


@settings(max_examples=25)
@given(gap=st.integers(3_000, 20_000), stride=st.integers(2, 40), phase=st.floats(0.0, 6.0))
def test_all_samples_follow_from_those_kept(gap: int, stride: int, phase: float) -> None:
    count = 40_000
    rows = decimated_grid([(0, gap), (gap, count)], stride)
    place = np.arange(count)
    motion = np.exp(2j * np.pi * place / (stride * RESPONSE_PER_CYCLE) + 1j * phase) + 3.0
    values = np.stack([motion, (1.0 + place / count) * motion], axis=1)
    assert rows.size < count / stride + 20
    assert np.max(np.abs(rows.all_of(rows.of(values)) - values)) < 5e-5
    part = slice(gap - 50, gap + 70)
    assert np.array_equal(rows.all_of(rows.of(values), part), rows.all_of(rows.of(values))[part])


def test_a_step_between_pieces_stays_a_step() -> None:
    values = np.where(np.arange(30_000) < 11_000, 1.0, -2.0)
    rows = decimated_grid([(0, 11_000), (11_000, 30_000)], 50)
    assert np.max(np.abs(rows.all_of(rows.of(values)) - values)) < 1e-12


@pytest.mark.parametrize("stride", [1, 100])
def test_short_records_and_slow_sampling_keep_all(stride: int) -> None:
    count = module._MOST_KEPT + (stride == 1)
    values = np.random.default_rng(1).standard_normal(count)
    rows = decimated_grid([(0, count)], stride)
    assert rows.spread is None
    assert np.array_equal(rows.all_of(rows.of(values)), values)


@given(samples=st.integers(1, 100_000))
def test_blocks_have_every_sample_once(samples: int) -> None:
    assert np.array_equal(np.concatenate([np.arange(samples)[b] for b in blocks(samples)]), np.arange(samples))


def test_spacing_leaves_so_many_samples_to_a_cycle() -> None:
    rate, step = 5.0, 1e-4
    still = np.zeros(100)
    assert spacing(still, still + rate, step, 24) == int(2.0 * np.pi / rate / step / 24)
    assert spacing(still, still + 1e6, step, 24) == 1
