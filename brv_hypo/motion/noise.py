"""White-noise level of a channel, from the record itself."""

from __future__ import annotations

import math

import numpy as np

from brv_hypo.arrays import FloatArray

# Differences of this order pass white noise and cut a motion of 14 samples per cycle by five decades.
_HIGHEST_ORDER = 8
_MAD_TO_SIGMA = 1.4826


def white_noise_level(channel: FloatArray, segments: tuple[tuple[int, int], ...]) -> float:
    """Standard deviation of the white noise of `channel` (n,), in its units.

    High-order differences, scaled by their noise gain sqrt(binom(2k, k)); the median absolute value keeps
    spikes and jumps out. A channel that stands still between its steps is credited with the noise of its
    quantisation.
    """
    pieces = [channel[a:b] for a, b in segments if b - a > _HIGHEST_ORDER + 2]
    if not pieces:
        return _quantisation(channel)
    differences = np.concatenate([np.diff(piece, _HIGHEST_ORDER) for piece in pieces])
    gain = math.sqrt(math.comb(2 * _HIGHEST_ORDER, _HIGHEST_ORDER))
    return max(float(_MAD_TO_SIGMA * np.median(np.abs(differences)) / gain), _quantisation(channel))


def _quantisation(channel: FloatArray) -> float:
    """Standard deviation of rounding to the channel's smallest step, or to double precision."""
    steps = np.abs(np.diff(channel))
    steps = steps[steps > 0.0]
    still = steps.size < 0.5 * max(channel.size - 1, 1)
    smallest = float(steps.min()) if steps.size and still else 0.0
    return max(smallest / math.sqrt(12.0), 1e-12 * float(np.max(np.abs(channel), initial=1.0)))
