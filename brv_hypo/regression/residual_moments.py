"""Residual rates as moment coefficients: what a model leaves, in the terms in which it is told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.signals import derivatives
from brv_hypo.regression.frame import RateFrame


@dataclass(frozen=True)
class ResidualMoments:
    """C_m + i C_n measured less modelled (rows, ...) of a frame, and on which rows it is usable.

    `noise` (rows,) is the standard deviation of C_m and of C_n that the gyros' noise makes of them, by their filter.
    """

    body: ComplexArray
    usable: BoolArray
    noise: FloatArray


def residual_moments(
    frame: RateFrame, records: Sequence[InertialRecord], rates: ComplexArray
) -> ResidualMoments:
    """Moments from what a model leaves of the derolled rates, (rows,) rad/s, or several models (rows, models).

    The filter that differentiates the rates acts on measurement and model alike, so that it rounds no
    corner of the one that the other keeps.
    """
    body = np.zeros(rates.shape, dtype=complex)
    usable = np.zeros(rates.shape[0], dtype=bool)
    noise = np.full(rates.shape[0], np.inf)
    for segment, (a, b) in zip(frame.segments, frame.pieces, strict=True):
        record, rows = records[segment.flight], segment.rows
        spin = record.spin_rate
        if b - a <= 2 * spin.half_width:
            continue
        both = np.stack([rates[a:b].real.T, rates[a:b].imag.T])
        rate = derivatives(both, spin.order, spin.half_width, record.flight.step)
        body[a:b] = ((rate[0] + 1j * rate[1]) * (np.exp(-1j * record.spin_angle[rows]) / record.moment_scale[rows])).T
        usable[a:b] = (record.measured & spin.interior)[rows]
        noise[a:b] = (record.rate_noise / np.abs(record.moment_scale))[rows]
    return ResidualMoments(body, usable, noise)
