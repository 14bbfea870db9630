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
from brv_hypo.identification.problem import Problem
from brv_hypo.identification.result import Identification
from brv_hypo.identification.shapes import Shapes, point
from brv_hypo.identification.structure import of_flight
from brv_hypo.likelihood import Delayed
from brv_hypo.likelihood.interpolation import Interpolator
from brv_hypo.model.static_bend import StaticBend
from brv_hypo.motion.motion import Motion


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
    names, sizes = _bends(problem, flight)
    planes = np.vstack([here.in_plane * courses, *_bent(problem, here.motion)])
    risen = np.vstack([(high.in_plane - low.in_plane) * courses, *_bent(problem, high.motion, low.motion)])
    slopes = risen / (high.motion.alpha - low.motion.alpha)
    whole = np.append(found.values, [size * theta[name] for name, size in zip(names, sizes, strict=True)])
    both = _with_bends(found, names, sizes)
    rows = {
        "C_N'": planes.real,
        "C_Z'": planes.imag,
        "C_N' by alpha": slopes.real,
        "C_Z' by alpha": slopes.imag,
    }
    out = [_history(name, flight, time, f, whole, both) for name, f in rows.items()]
    index = [found.fit.names.index(name) for name in problem.model.force_names]
    force = np.asarray(legvander(problem.model.scaled(told), len(index) - 1).T, dtype=float)
    values = np.array([theta[name] for name in problem.model.force_names])
    covariance = found.fit.covariance[np.ix_(index, index)]
    return [*out, _history("C_Nalpha_force", flight, time, force, values, covariance)]


def _bends(problem: Problem, flight: int) -> tuple[list[str], list[float]]:
    """Parameters that are the bend of the static moment, in units of their sizes (1/rad^3), and these."""
    own = [value for value, number in problem.tolerated if number == flight and value.name.startswith(StaticBend.name)]
    return [of_flight(value.name, flight) for value in own], [value.size for value in own]


def _bent(problem: Problem, motion: Motion, less: Motion | None = None) -> list[FloatArray]:
    """Moments in plane (n,) of each term of the bend per unit of its coefficient, less those at another motion."""
    bend = problem.frame.mechanisms.get(StaticBend.name)
    if bend is None:
        return []
    here = [term.in_plane for term in bend.terms(motion, {})]
    if less is None:
        return here
    return [one - term.in_plane for one, term in zip(here, bend.terms(less, {}), strict=True)]


def _with_bends(found: Identification, names: list[str], sizes: list[float]) -> FloatArray:
    """Covariance of the coefficients and, after them, of the bend's."""
    assert found.fit is not None
    count = found.values.size
    out = np.zeros((count + len(names), count + len(names)))
    out[:count, :count] = found.covariance
    known = {name: k for k, name in enumerate(found.fit.names)}
    terms = [known.get(estimate.name, -1) for estimate in found.terms]
    for j, (name, size) in enumerate(zip(names, sizes, strict=True)):
        own = found.fit.covariance[known[name]]
        out[count + j, :count] = out[:count, count + j] = [size * own[k] if k >= 0 else 0.0 for k in terms]
        for i, (other, scale) in enumerate(zip(names, sizes, strict=True)):
            out[count + j, count + i] = size * scale * own[known[other]]
    return out


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
