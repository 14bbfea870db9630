"""Frames of panels: a few far values and wide bands do not flatten what is drawn, and the caption says so."""

from __future__ import annotations

import numpy as np

from brv_hypo.report.document import Band, Line, Panel
from brv_hypo.report.motion_charts import Setting, cut_text, framed, motion_chart
from tests.chains import histories

TIME = np.linspace(0.0, 10.0, 1000)
WAVE = np.sin(TIME)


def test_a_spike_at_the_edge_lies_beyond_the_frame() -> None:
    spiked = WAVE.copy()
    spiked[-3:] = [40.0, -900.0, 3000.0]
    panel = framed(Panel("y", [Line(TIME, spiked, "first")]))
    assert panel.range is not None
    assert -3.0 < panel.range[0] < -1.0 < 1.0 < panel.range[1] < 3.0
    assert cut_text([panel]) == "A few values far from all others lie beyond the frame."


def test_what_is_not_flattened_keeps_its_frame() -> None:
    noisy = np.random.default_rng(1).standard_t(5, 1000)
    for values in (WAVE, noisy, np.zeros(1000), np.where(TIME > 5.0, 1e6, 0.0), np.full(1000, np.nan)):
        panel = framed(Panel("y", [Line(TIME, values, "first")]))
        assert panel.range is None
        assert not cut_text([panel])


def test_a_band_far_wider_than_its_histories_goes_beyond_the_frame() -> None:
    panel = framed(Panel("y", [Band(TIME, WAVE - TIME**2, WAVE + TIME**2), Line(TIME, WAVE, "first")]))
    assert panel.range is not None
    assert abs(panel.range[1]) < 4.0
    assert cut_text([panel]) == "The band goes beyond the frame."


def test_the_band_of_an_unknown_angle_is_the_range_of_angles() -> None:
    chart = motion_chart(Setting((0.0, 10.0)), histories(TIME, np.abs(WAVE), WAVE, sigma=1e16))
    band = chart.panels[0].layers[0]
    assert (np.min(band.low), np.max(band.high)) == (0.0, 180.0)
