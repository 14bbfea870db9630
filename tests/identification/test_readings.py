"""What noise-free instruments read."""

from __future__ import annotations

import numpy as np

from brv_hypo.identification.parameters import lever_force, noise_free_flights
from brv_hypo.motion.inputs import smooth_inputs

RNG = np.random.default_rng(3)
OMEGA, CHANGE = RNG.standard_normal((2, 3, 20))


def test_lever_force_is_that_of_the_conventions():
    arm = (0.3, -0.2, 0.1)
    expected = np.cross(CHANGE.T, arm) + np.cross(OMEGA.T, np.cross(OMEGA.T, arm))
    found = lever_force(arm, OMEGA[1] + 1j * OMEGA[2], CHANGE[1] + 1j * CHANGE[2], OMEGA[0], CHANGE[0])
    np.testing.assert_allclose(found, expected[:, 1] + 1j * expected[:, 2], atol=1e-14)


def test_noise_free_readings_differ_from_the_measured_ones_by_the_instruments_noise(bodyfixed):
    simulated, work, _ = bodyfixed
    frame = work.frame
    inputs = tuple(smooth_inputs(r) for r in frame.reconstructions)
    predicted, moments = (f(work.columns) @ work.values for f in (frame.columns, frame.moments))
    (quiet,) = noise_free_flights(frame, predicted, moments, inputs)
    instruments = simulated.config.instruments
    for channels, noise in (("qr", instruments.gyro.noise), (("ay", "az"), instruments.accelerometer.noise)):
        for channel in channels:
            difference = getattr(simulated.flight, channel) - getattr(quiet, channel)
            np.testing.assert_allclose(np.std(difference), noise, rtol=0.15)
