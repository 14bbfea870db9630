"""Coefficients over time with their uncertainty: Section 3.4, Figures 4.10 to 4.14 of the report.

A coefficient is f(x)' theta and its variance f' M^-1 f, at the estimated motion; the motion's own error is
not in it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legvander

from brv_hypo.arrays import FloatArray
from brv_hypo.identification.model import Shapes, point
from brv_hypo.identification.problem import Problem
from brv_hypo.identification.result import Identification
from brv_hypo.likelihood import Delayed
from brv_hypo.likelihood.interpolation import Interpolator


@dataclass(frozen=True)
class CoefficientHistory:
    """A coefficient over time (n,) s of one segment of one flight: `value` and `std_error`, (n,); the band is
    2 sigma.
    """

    name: str
    flight: int
    time: FloatArray
    value: FloatArray
    std_error: FloatArray

    @property
    def band(self) -> tuple[FloatArray, FloatArray]:
        """Value less and plus two standard deviations."""
        return self.value - 2.0 * self.std_error, self.value + 2.0 * self.std_error


def coefficient_histories(found: Identification) -> tuple[CoefficientHistory, ...]:
    """In-plane and out-of-plane moment and their derivatives by alpha, and the normal-force slope, of every
    segment.

    "C_N'", "C_Z'", "C_N' by alpha" (1/rad), "C_Z' by alpha" (1/rad), "C_Nalpha_force" (1/rad). The derivative
    by alpha is that at the motion as flown, meridian and rates held; knots stand where they were estimated.
    Empty where the fit was not begun.
    """
    if found.problem is None or found.fit is None:
        return ()
    histories: list[CoefficientHistory] = []
    for segment in range(len(found.problem.records)):
        histories += _of_segment(found, found.problem, segment)
    return tuple(histories)


def _of_segment(found: Identification, problem: Problem, segment: int) -> list[CoefficientHistory]:
    assert found.fit is not None
    record, states = problem.records[segment], found.fit.states[segment]
    theta, flight, time = found.fit.theta, record.context.flight, record.segment.t
    step = 1e-4
    here, low, high = (
        _planes(
            problem, record.segment.u, states * np.array([[1.0], [1.0], [scale], [scale]]), theta, segment
        )
        for scale in (1.0, 1.0 - step, 1.0 + step)
    )
    told = record.context.course_time(time)
    courses = np.array([column.course(told) for column in found.columns])
    planes = here.in_plane * courses
    slopes = (high.in_plane - low.in_plane) * courses / (high.motion.alpha - low.motion.alpha)
    rows = {
        "C_N'": planes.real,
        "C_Z'": planes.imag,
        "C_N' by alpha": slopes.real,
        "C_Z' by alpha": slopes.imag,
    }
    out = [_history(name, flight, time, f, found.values, found.covariance) for name, f in rows.items()]
    index = [found.fit.names.index(name) for name in problem.model.force_names]
    force = np.asarray(legvander(problem.model.scaled(told), len(index) - 1).T, dtype=float)
    values = np.array([theta[name] for name in problem.model.force_names])
    covariance = found.fit.covariance[np.ix_(index, index)]
    return [*out, _history("C_Nalpha_force", flight, time, force, values, covariance)]


def _planes(
    problem: Problem, u: FloatArray, states: FloatArray, theta: Mapping[str, float], segment: int
) -> Shapes:
    """The columns at the nodes, C_N' + i C_Z' per unit, with the states scaled."""
    time = problem.records[segment].segment.t
    interpolator = Interpolator(time)
    delayed = {}
    for name in problem.structure.delays:
        stencil = interpolator.stencil(time - theta[name])
        delayed[name] = Delayed(stencil.apply(states), stencil.apply(u))
    return problem.model.shapes(point(states, u, time), theta, delayed)


def _history(
    name: str, flight: int, time: FloatArray, f: FloatArray, values: FloatArray, covariance: FloatArray
) -> CoefficientHistory:
    variance = np.einsum("jn,jk,kn->n", f, covariance, f)
    return CoefficientHistory(name, flight, time, values @ f, np.sqrt(np.maximum(variance, 0.0)))
