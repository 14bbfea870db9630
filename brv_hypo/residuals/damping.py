"""C_mq along a flight by Mach number, of the final model and all processes together.

The derivative of C_m,in by the transverse rate in the plane of alpha times d / 2V. A model with one C_mq and the
processes `damping_change` and `damping_bend` are one estimate, with one standard error.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray, IntArray
from brv_hypo.inference.evidence import Evidence
from brv_hypo.mechanisms.contract import rms_of_shapes
from brv_hypo.mechanisms.registry import moment_processes
from brv_hypo.motion.interpolation import time_splines
from brv_hypo.motion.motion import Motion
from brv_hypo.residuals.families import Beside
from brv_hypo.residuals.result import Derivative
from brv_hypo.residuals.static_slope import along_flight

_STEP = 1.0  # of the transverse rate, rad/s: moments of it are linear


def damping_along(beside: Beside) -> tuple[Derivative, ...]:
    """C_mq of each flight, at no angle of attack and at that flown."""
    own = beside.null
    motions = enumerate(own.rows.frame.motions)
    return tuple(along_flight(motion, number, partial(_damping, own, number, motion)) for number, motion in motions)


def _damping(
    own: Evidence, flight: int, motion: Motion, alpha: FloatArray, places: IntArray
) -> tuple[FloatArray, FloatArray]:
    """C_mq about angles of attack (samples,) rad and its standard errors, at some places (places,)."""
    frame, columns = own.rows.frame, own.rows.problem.baseline
    slower = replace(motion, alpha=alpha)
    turned = slower.to_body(np.full_like(alpha, _STEP), np.zeros_like(alpha))
    faster = replace(slower, alpha_rate=motion.alpha_rate + _STEP, q=motion.q + turned.real, r=motion.r + turned.imag)
    unit = (_STEP * motion.rate_factor)[places]

    def rise(slow: ComplexArray | FloatArray, fast: ComplexArray | FloatArray) -> FloatArray:
        return np.asarray(np.real(fast - slow)[places] / unit, dtype=float)

    values = np.zeros((places.size, len(columns)))
    for j, column in enumerate(columns):
        if column.acts_on(flight):
            slow, fast = (
                next(
                    t
                    for t in frame.mechanisms[column.mechanism].terms(each, dict(column.theta))
                    if t.name == column.term
                )
                for each in (slower, faster)
            )
            basis = column.time_basis(motion.coefficient_time)[places]
            values[:, j] = rise(slow.in_plane, fast.in_plane) * basis
    groups, splines = {group.name: k for k, group in enumerate(own.rows.groups)}, dict[int, FloatArray]()
    for process in moment_processes():
        scale = rms_of_shapes(process, motion)
        histories = time_splines(motion.time[places], float(motion.time[0]), float(motion.time[-1]), process.splines)
        pairs = zip(process.shapes(slower), process.shapes(faster), strict=True)
        splines[groups[process.name]] = np.concatenate(
            [rise(slow, fast)[:, np.newaxis] * histories / scale for slow, fast in pairs], axis=1
        )
    return own.along(flight, values, splines)
