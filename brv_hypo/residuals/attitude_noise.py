"""What the gyros' noise leaves of moments once the model follows it.

The attitude is the integral of the very noise that the rates show, and the static moment follows the attitude: of noise
at a frequency f, the difference of measured and modelled moment has 1 - (f_n / f)^2, f_n being that of the motion.
"""

from __future__ import annotations

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import BAND_FREQUENCIES
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.signals import middle_weights


def noise_share(record: InertialRecord, stiffness: FloatArray, modes: int) -> FloatArray:
    """Variance of the residual moments' noise over that of the measured ones' (n,).

    `stiffness` (n,) 1/s^2 is the static moment's slope, times its scale; negative where it restores. Slower than the
    `modes` of the walk that is fitted, the noise is dealt with there.
    """
    spin, flight = record.spin_rate, record.flight
    frequency = np.pi * (np.arange(BAND_FREQUENCIES) + 0.5) / BAND_FREQUENCIES
    weights = middle_weights(spin.order, spin.half_width)
    power = np.abs(np.exp(1j * np.outer(frequency, np.arange(weights.size))) @ weights) ** 2
    faster = frequency > np.pi * modes * flight.step / record.time[-1]
    first, second = (float(np.sum((power / frequency**k)[faster]) / np.sum(power)) for k in (2, 4))
    turned = stiffness * flight.step**2
    return np.asarray(1.0 + 2.0 * first * turned + second * turned**2, dtype=float)
