"""Moment coefficients from the gyros: Euler's equations inverted (Eq. 2.3, Section 3.2.4)."""

from __future__ import annotations

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.motion.effect_responses import EffectFit
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.reconstruction import MomentEstimate


def moment_estimate(record: InertialRecord, effects: EffectFit) -> MomentEstimate:
    """C_m + i C_n and its standard deviation, in which noise and estimated bias of the differentiation count.

    With y = (q + i r) exp(i (1 - Ix/I) roll) the spin coupling drops out, y' = exp(i ...) q_inf S d / I
    (C_m + i C_n): it is y that is differentiated. `record` has lost `known` of its errors; the
    rest of what was found is taken out here, and what they may be beyond that counts in `sigma`.
    """
    spin = record.spin_rate
    responses = effects.responses.moment
    noise = error_of_differentiation(record)
    return MomentEstimate(
        body=record.moment - responses.of(effects.value - effects.known),
        sigma=np.sqrt(noise**2 + 0.5 * responses.variance(effects.covariance)),
        noise_sigma=noise,
        usable=record.measured & spin.interior,
        filter_half_width=spin.half_width,
        noise_correlation=spin.noise_correlation,
        spin_angle=record.spin_angle,
    )


def error_of_differentiation(record: InertialRecord) -> FloatArray:
    """Standard deviation (n,) of C_m and of C_n by the gyros' noise and the estimated bias of their differentiation.

    Positive too where errors that were taken out of an accepted record turned the sign of its dynamic pressure.
    """
    return np.asarray(np.hypot(record.rate_noise, record.spin_rate.rate_bias) / np.abs(record.moment_scale))


def static_in_plane(in_plane: FloatArray, alpha: FloatArray, weight: FloatArray) -> FloatArray:
    """C_N0 + C_Nalpha alpha (n,) fitted to the in-plane moment by weighted least squares."""
    root = np.sqrt(weight)
    columns = np.column_stack([np.ones_like(alpha), alpha])
    answer = np.linalg.lstsq(columns * root[:, None], in_plane * root, rcond=None)[0]
    return np.asarray(columns @ answer)
