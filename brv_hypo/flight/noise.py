"""The one estimate of white noise in a channel: from its differences of high order."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray

# Differences of this order pass white noise and cut a motion of 14 samples per cycle by five decades: the one estimate
# of a channel's white noise.
NOISE_DIFFERENCES = 8


MAD_TO_SIGMA = 1.4826
MEDIAN_LENGTH_TO_SIGMA = 1.0 / math.sqrt(2.0 * math.log(2.0))  # of a vector of two such values: Rayleigh


def sigma_of_differences(pieces: Sequence[FloatArray | ComplexArray]) -> float:
    """White-noise sigma of a channel from its `pieces`, each (n,), NaN where missing; NaN where all are too short.

    The difference of order k scales white noise by sqrt(binomial(2 k, k)) and a sinusoid by (2 sin(w h / 2))^k;
    the median of its absolute value keeps spikes and jumps out. A complex channel is two real ones of one sigma.
    """
    differences = np.concatenate([np.diff(piece, NOISE_DIFFERENCES) for piece in pieces]) if pieces else np.zeros(0)
    finite = differences[np.isfinite(differences)]
    if not finite.size:
        return float("nan")
    scale = MEDIAN_LENGTH_TO_SIGMA if np.iscomplexobj(finite) else MAD_TO_SIGMA
    return scale * float(np.median(np.abs(finite))) / math.sqrt(math.comb(2 * NOISE_DIFFERENCES, NOISE_DIFFERENCES))
