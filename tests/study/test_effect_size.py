"""The size of what is planted."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.simulation import Truth
from brv_hypo.study.run import effect_size
from tests.flights import flown, nominal


def truth_of(in_plane, out_of_plane, whole) -> Truth:
    zeros = np.zeros_like(in_plane)
    return Truth(
        time=np.arange(in_plane.size) * 0.01,
        alpha=zeros,
        windward_meridian=zeros,
        C_m=zeros,
        C_n=zeros,
        C_N=whole,
        C_Z=zeros,
        planted_in_plane=in_plane,
        planted_out_of_plane=out_of_plane,
        planted=("any",),
        parameters={},
    )


def test_the_effect_is_measured_while_it_lasts():
    lasts = np.arange(100) >= 75
    whole = np.where(lasts, 2.0, 50.0)
    assert effect_size(truth_of(0.2 * lasts, 0.1 * lasts, whole)) == pytest.approx((0.1, 0.05))


def test_nothing_planted_is_no_effect():
    assert effect_size(nominal().truth) == (0.0, 0.0)


@pytest.mark.slow
def test_the_effect_of_a_planted_flight_is_the_planted_columns_rms():
    truth = flown("research_cone", "sticking").truth
    lasts = (truth.time >= 2.0) & (truth.time < 4.0)
    whole = np.sqrt(np.mean((truth.C_N**2 + truth.C_Z**2)[lasts]))
    expected = np.sqrt(np.mean(truth.planted_out_of_plane[lasts] ** 2)) / whole
    in_plane, out_of_plane = effect_size(truth)
    assert in_plane < 1e-9
    assert out_of_plane == pytest.approx(expected, rel=0.02)
