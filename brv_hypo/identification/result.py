"""What an identification returns, and the coefficients over time (Section 3.4, Figures 4.10 to 4.14 of the report).

`coefficient_histories` has moments, slopes and the normal-force slope along each segment: a coefficient is f(x)'
theta and its variance f' M^-1 f, at the estimated motion; the uncertainty of the motion is not in it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legvander

from brv_hypo.arrays import FloatArray
from brv_hypo.identification.equations import Shapes, point
from brv_hypo.identification.parameters import of_flight
from brv_hypo.identification.problem import Problem
from brv_hypo.likelihood import Delayed, FitResult
from brv_hypo.likelihood.segment import Interpolator
from brv_hypo.likelihood.uncertainty import Identifiability, Whiteness
from brv_hypo.model.baseline import StaticBend
from brv_hypo.model.term import Regressor
from brv_hypo.motion.motion import Motion
from brv_hypo.regression.frame import RateFrame

# ---- What an identification returns ----


OUTPUTS = ("q", "r", "ay", "az")


@dataclass(frozen=True)
class Estimate:
    """One parameter, in `units`.

    `std_error` is the one to report: that for white residuals where they are white, else the larger of it and
    `std_error_coloured`, which is corrected for the colour of the residuals.
    """

    name: str
    value: float
    std_error: float
    std_error_white: float
    std_error_coloured: float
    units: str

    @property
    def f_ratio(self) -> float:
        """Square of value over standard error, as in Table 4.3."""
        return (self.value / self.std_error) ** 2 if self.std_error > 0.0 else float("nan")


@dataclass(frozen=True)
class Identification:
    """A regression model refined by maximum likelihood on the original measurements.

    Attributes:
        status: that of the likelihood: "converged", "iteration limit", "stalled", "undetermined" or
            "diverged"; "failed" where it could not be begun. `message` is cause and remedy.
        columns: the regression's columns with delays and knots at their estimates.
        values: coefficients (columns,), in the units of the columns.
        covariance: (columns, columns), all other parameters accounted for; at the reported standard errors.
        terms: the coefficients. nonlinear: delays and knots. forces: normal-force slope (1/rad) and its
            drift.
        instruments: what is known to a tolerance only, errors of the record and moments, each with its
            prior in the estimate. environment: gravity (m/s^2) in de-rolled axes of the first sample.
        prior_misfit: sum over all parameters with a Gaussian prior of the square of estimate less mean over sigma.
        log_likelihood: minus the NLLF of Eq. 3.10 with erratum E8, of the innovations at every sample.
        iterations: of all searches together. cost_history: NLLF at the nodes after each iteration of the last
            search.
        identifiability: near-null directions by name.
        innovations: by segment, (4, samples): measured minus predicted q, r (rad/s), ay, az (m/s^2), at
            `times` (s).
        whiteness: test of each output's innovations, in the order of OUTPUTS.
        block: samples to a node. seconds: wall clock.
        frame: the regression's frame, C_mw of Eq. 5.1 brought up to date.
        problem, fit: what was solved, and the likelihood's own result; None where it could not be begun.
    """

    status: str
    message: str
    columns: tuple[Regressor, ...]
    values: FloatArray
    covariance: FloatArray
    terms: tuple[Estimate, ...]
    nonlinear: tuple[Estimate, ...]
    forces: tuple[Estimate, ...]
    instruments: tuple[Estimate, ...]
    environment: tuple[Estimate, ...]
    log_likelihood: float
    iterations: int
    cost_history: tuple[float, ...]
    identifiability: Identifiability | None
    innovations: tuple[FloatArray, ...]
    times: tuple[FloatArray, ...]
    whiteness: tuple[Whiteness, ...]
    prior_misfit: float
    block: int
    seconds: float
    frame: RateFrame
    problem: Problem | None
    fit: FitResult | None

    @property
    def converged(self) -> bool:
        """Whether the estimates may be used."""
        return self.status == "converged"


# ---- Coefficients over time with their uncertainty: Section 3.4, Figures 4.10 to 4.14 of the report ----


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
    common_time = record.context.coefficient_time(time)
    bases = np.array([column.time_basis(common_time) for column in found.columns])
    names, sizes = _bends(problem, flight)
    planes = np.vstack([here.in_plane * bases, *_bent(problem, here.motion)])
    risen = np.vstack([(high.in_plane - low.in_plane) * bases, *_bent(problem, high.motion, low.motion)])
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
    force = np.asarray(legvander(problem.model.scaled(common_time), len(index) - 1).T, dtype=float)
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
