"""How much of the moment a planted mechanism is."""

from __future__ import annotations

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.simulation import Truth

# Below this part of its largest value what is planted counts as absent: rounding of the moments.
ABSENT = 1e-6


def effect_size(truth: Truth) -> tuple[float, float]:
    """Rms of what is planted in and out of plane over the rms of the whole moment, while it lasts.

    What is planted is the moment with the mechanism less the moment without it at the same state.
    """
    planted = np.hypot(truth.planted_in_plane, truth.planted_out_of_plane)
    if not truth.planted or not np.any(planted):
        return 0.0, 0.0
    lasts = planted > ABSENT * planted.max()
    whole = _rms(np.hypot(truth.C_N, truth.C_Z)[lasts])
    return _rms(truth.planted_in_plane[lasts]) / whole, _rms(truth.planted_out_of_plane[lasts]) / whole


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
