"""What the reconstruction does not know: errors of the crossflow, as columns with a prior.

The crossflow has an error of standard deviation alpha_sigma that is slow in axes that do not roll. Through
the static moment it looks like a moment that no mechanism made. It is written as cosines in time whose
amplitudes have a Gaussian prior, and projected out of data and columns: effects within the uncertainty of the
reconstruction are then not mistaken for mechanisms, and larger ones keep all but that share of their weight.
"""

from __future__ import annotations

import numpy as np

from brv_hypo.arrays import ComplexArray
from brv_hypo.model.time_variation import TimeFunction
from brv_hypo.motion.reconstruction import Reconstruction
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.weakform import integral

MODES = 9


def crossflow_errors(frame: RateFrame) -> ComplexArray:
    """Rate histories (rows, 2 MODES flights) of crossflow errors; each amplitude has prior N(0, 1)."""
    rows = frame.observed.size
    found = []
    for index, reconstruction in enumerate(frame.reconstructions):
        for moment in _moments(reconstruction).T:
            column = np.zeros(rows, dtype=complex)
            for segment, (a, b) in zip(frame.segments, frame.pieces, strict=True):
                if segment.flight == index:
                    integrals = segment.integrate(moment[segment.rows])
                    column[a:b] = segment.column(integrals, TimeFunction("constant"))
            found.extend([column, 1j * column])
    return np.column_stack(found)


def _moments(reconstruction: Reconstruction) -> ComplexArray:
    """C_m + i C_n (n, MODES) that a crossflow error of one standard deviation causes."""
    flight, motion = reconstruction.flight, reconstruction.motion
    design = np.column_stack([np.ones_like(motion.alpha), motion.alpha])
    slope = np.linalg.lstsq(design, motion.in_plane_moment, rcond=None)[0][1]
    derolled = np.exp(-1j * integral(flight.time, flight.p))
    scaled = (flight.time - flight.time[0]) / (flight.time[-1] - flight.time[0])
    cosines = np.cos(np.pi * np.outer(scaled, np.arange(MODES))) * np.sqrt(2.0 / MODES)
    size = -1j * slope * reconstruction.alpha_sigma * derolled
    return np.asarray(size[:, None] * cosines, dtype=complex)
