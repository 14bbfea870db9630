"""The model follows the gyros' noise through the attitude: what is then in residual moments."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.model.model import SavedModel
from brv_hypo.motion.inertial import InertialRecord, inertial_record
from brv_hypo.motion.methods import ReconstructionConfig
from brv_hypo.motion.signals import derivatives
from brv_hypo.prediction import predict
from brv_hypo.prediction.band import BAND_SIGMAS, noise_share
from brv_hypo.simulation import simulate
from brv_hypo.simulation.config import InstrumentsConfig
from tests.chains import TRIM, traced_trim, trimmed_cone
from tests.flights import nominal

MODES = 18
FLIGHTS = 5


@pytest.fixture(scope="module")
def record() -> InertialRecord:
    return inertial_record(nominal().flight, ReconstructionConfig())


def fast(noise: FloatArray) -> FloatArray:
    """White noise (..., n) without the slowest waves, which the fit knows."""
    at = (np.arange(noise.shape[-1]) + 0.5) / noise.shape[-1]
    waves = np.cos(np.pi * np.outer(np.arange(MODES), at))
    waves /= np.linalg.norm(waves, axis=1, keepdims=True)
    return noise - (noise @ waves.T) @ waves


@pytest.mark.parametrize("frequency", [3.0, 6.0])
def test_a_model_that_follows_the_noise_has_less_of_it_in_its_residual(
    record: InertialRecord, frequency: float
) -> None:
    step, spin = record.flight.step, record.spin_rate
    noise = np.random.default_rng(3).standard_normal((200, record.time.size))
    walk = step * np.cumsum(fast(noise), axis=1)
    followed = noise + cumulative_trapezoid(frequency**2 * walk, dx=step, initial=0, axis=1)
    measured, residual = (
        derivatives(each, spin.order, spin.half_width, step)[:, spin.interior] for each in (noise, followed)
    )
    stated = noise_share(record, np.full(1, -(frequency**2)), MODES)
    assert stated < 0.98
    assert np.mean(residual**2) / np.mean(measured**2) == pytest.approx(stated[0], abs=0.01)


def test_with_a_moment_that_does_not_restore_all_noise_is_residual(record: InertialRecord) -> None:
    assert noise_share(record, np.zeros(3), MODES) == pytest.approx(np.ones(3))
    assert np.all(noise_share(record, np.full(3, 9.0), MODES) > 1.0)


@pytest.fixture(scope="module")
def exact() -> SavedModel:
    """The model of the flights below with its true coefficients."""
    found, flown = traced_trim().model.definition, trimmed_cone(TRIM)
    trim, baseline = flown.mechanisms[0].terms, flown.aerodynamics.model_dump()
    true = [(trim if c.mechanism == "trim" else baseline).get(c.term, 0.0) for c in found.columns]
    columns = [
        c.model_copy(update={"value": value, "std_error": 0.0}) for c, value in zip(found.columns, true, strict=True)
    ]
    return found.model_copy(update={"columns": tuple(columns), "covariance": (), "error": None})


def noise_in_moments(flight: Flight, noise: ComplexArray) -> float:
    """Mean square of either moment coefficient that this noise of the gyros (n,) makes."""
    record = inertial_record(flight, ReconstructionConfig())
    spin, derolled = record.spin_rate, noise * np.exp(1j * record.spin_angle)
    parts = np.stack([derolled.real, derolled.imag])
    rate = derivatives(parts, spin.order, spin.half_width, flight.step) / record.moment_scale
    return float(np.mean(rate[:, spin.interior] ** 2))


@pytest.mark.slow
def test_the_residual_of_a_known_model_is_the_noise_in_the_band(exact: SavedModel) -> None:
    """Of the noise in the record: its size over a few seconds is no part of it."""
    config = trimmed_cone(TRIM)
    quiet = simulate(config.model_copy(update={"instruments": InstrumentsConfig()}), seed=0).flight
    residual, stated = [], []
    for seed in range(FLIGHTS):
        flight = simulate(config, seed=40 + seed).flight
        there = noise_in_moments(flight, flight.q - quiet.q + 1j * (flight.r - quiet.r))
        found = predict(flight, exact, ("trim", "instruments"))
        residual.append(found.error.frozen / there)
        stated.append(np.mean(np.square(found.band.half_width)) / BAND_SIGMAS**2 / found.error.noise)
    assert np.mean(stated) < 0.95
    assert np.mean(residual) == pytest.approx(np.mean(stated), abs=0.03)
