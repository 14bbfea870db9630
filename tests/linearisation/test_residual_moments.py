"""Residual moments and the noise that the gyros make of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from brv_hypo.linearisation.frame import residual_moments
from brv_hypo.motion.signals import differentiate
from brv_hypo.tracing import TraceConfig
from brv_hypo.tracing.baseline import start_model
from brv_hypo.tracing.fit import Flights, correct
from tests.flights import nominal


@pytest.mark.parametrize("factor", [1.0, 30.0])
def test_their_noise_is_what_the_filter_makes_of_the_gyros_noise(factor: float) -> None:
    """Whatever filter the reconstruction of the motion chose: that of the record makes them.

    40 draws of white noise; of the 2 % that their mean square scatters, four standard deviations are allowed.
    """
    flight = nominal().flight
    source = Flights((flight,), TraceConfig())
    data = correct(source, start_model(source))
    record = data.records[0]
    spin = differentiate(record.spin_rate.signal, flight.step, factor * record.gyro_sigma, flight.segments)
    assert (spin.half_width > record.spin_rate.half_width) == (factor > 1.0)
    record = replace(record, spin_rate=spin)
    rng = np.random.default_rng(1)
    shape = (data.frame.observed.size, 40)
    noise = record.gyro_sigma * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape))
    found = residual_moments(data.frame, [record], noise)
    squares = np.abs(found.body[found.usable]) ** 2 / 2.0 / found.noise[found.usable, np.newaxis] ** 2
    assert np.mean(squares) == pytest.approx(1.0, abs=0.08)
