"""White-noise level of a channel, from the record itself."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import NOISE_STILL
from brv_hypo.flight.noise import sigma_of_differences


@dataclass(frozen=True)
class ColouredNoise:
    """A first-order autoregression: sigma of its innovations, in the channel's units, correlation of neighbours."""

    innovation: float
    colour: float = 0.0

    def times(self, factor: float) -> ColouredNoise:
        """The noise so many times as loud."""
        return ColouredNoise(factor * self.innovation, self.colour)

    def sigma_at(self, frequency: FloatArray | float) -> FloatArray:
        """Sigma of white noise as loud as this is at frequencies in rad a sample."""
        return np.asarray(self.innovation / np.sqrt(inverse_spectrum(self.colour, frequency)), dtype=float)


def inverse_spectrum(colour: FloatArray | float, frequency: FloatArray | float) -> FloatArray:
    """One over the spectrum of a first-order autoregression of unit innovations, at frequencies in rad a sample."""
    return np.asarray(1.0 + colour**2 - 2.0 * colour * np.cos(frequency), dtype=float)


def white_noise_level(channel: FloatArray, segments: tuple[tuple[int, int], ...]) -> float:
    """Standard deviation of the white noise of `channel` (n,), in its units.

    A channel that stands still between its steps, or is too short to tell, is credited with the noise of its
    quantisation.
    """
    sigma = sigma_of_differences([channel[a:b] for a, b in segments])
    return float(np.fmax(sigma, _quantisation(channel)))


def transverse_noise_level(y: FloatArray, z: FloatArray, segments: tuple[tuple[int, int], ...]) -> float:
    """Standard deviation of the white noise of either of two channels (n,) that body axes y and z share alike.

    Of the two as one vector: whichever way the axes are rolled, it is the same.
    """
    vector = y + 1j * z
    sigma = sigma_of_differences([vector[a:b] for a, b in segments])
    return float(np.fmax(sigma, np.hypot(_quantisation(y), _quantisation(z)) / math.sqrt(2.0)))


def _quantisation(channel: FloatArray) -> float:
    """Standard deviation of rounding to the channel's smallest step, or to double precision."""
    steps = np.abs(np.diff(channel))
    steps = steps[steps > 0.0]
    still = steps.size < NOISE_STILL * max(channel.size - 1, 1)
    smallest = float(steps.min()) if steps.size and still else 0.0
    return max(smallest / math.sqrt(12.0), 1e-12 * float(np.max(np.abs(channel), initial=1.0)))
