"""Prediction of stretches that took no part in the fit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.errors import UnanswerableError
from brv_hypo.identification.result import Identification
from brv_hypo.regression.frame import Piece


def coefficients_without(found: Identification, rows: Sequence[Piece]) -> FloatArray:
    """Coefficients (columns,) from the measurements outside of some rows [a, b) of the frame.

    The model is that of `found`, with its delays, knots and instrument errors estimated anew too, to first
    order; the states go on through the rows left out by the equations of motion.

    Raises:
        UnanswerableError: the identification has not converged.
    """
    if found.problem is None or not found.converged:
        raise UnanswerableError(
            f"held-out prediction needs a converged identification, got status '{found.status}': {found.message}"
        )
    intervals = _times(found, rows)
    left_out = []
    for record in found.problem.records:
        time = record.segment.t
        mask = np.zeros(time.size, dtype=np.bool_)
        for flight, first, last in intervals:
            if flight == record.context.flight:
                mask |= (time >= first) & (time <= last)
        left_out.append(mask)
    assert found.fit is not None
    return found.problem.structure.values(found.fit.theta_without(left_out))


def predicted_moments(found: Identification, values: FloatArray | None = None) -> ComplexArray:
    """C_m + i C_n (rows,) of the frame's motion by the identified columns; `values` (columns,) instead of the
    estimates.
    """
    return np.asarray(found.frame.moments(found.columns) @ (found.values if values is None else values))


def _times(found: Identification, rows: Sequence[Piece]) -> list[tuple[int, float, float]]:
    """(flight, first, last time in s) of each range of rows."""
    time, flights = found.frame.time, found.frame.flight_of_row
    return [(int(flights[a]), float(time[a]), float(time[b - 1])) for a, b in rows]
