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
from brv_hypo.likelihood.uncertainty import Whiteness
from brv_hypo.model.baseline import StaticBend
from brv_hypo.model.term import Regressor
from brv_hypo.motion.motion import Motion
from brv_hypo.regression.frame import RateFrame

# ---- What an identification returns ----


OUTPUTS = ("q", "r", "ay", "az")


@dataclass(frozen=True)
class Estimate:
    """One parameter."""

    name: str
    value: float
    """In `units`."""
    std_error: float
    """The one to report: that for white residuals where they are white, else the larger of the two below."""
    std_error_white: float
    std_error_coloured: float
    """Corrected for the colour of the residuals."""
    units: str

    @property
    def f_ratio(self) -> float:
        """Square of value over standard error, as in Table 4.3."""
        return (self.value / self.std_error) ** 2 if self.std_error > 0.0 else float("nan")


@dataclass(frozen=True)
class Identification:
    """A regression model refined by maximum likelihood on the original measurements."""

    status: str
    """That of the likelihood: "converged", "iteration limit", "stalled", "undetermined" or "diverged"; "failed" where
    it could not be begun."""
    message: str
    """Cause and remedy."""
    columns: tuple[Regressor, ...]
    """The regression's columns with delays and knots at their estimates."""
    values: FloatArray
    """Coefficients (columns,), in the units of the columns."""
    covariance: FloatArray
    """(columns, columns), all other parameters accounted for; at the reported standard errors."""
    frame: RateFrame
    """The regression's frame, C_mw of Eq. 5.1 brought up to date."""
    terms: tuple[Estimate, ...] = ()
    """The coefficients."""
    nonlinear: tuple[Estimate, ...] = ()
    """Delays and knots."""
    forces: tuple[Estimate, ...] = ()
    """Normal-force slope (1/rad) and its drift."""
    instruments: tuple[Estimate, ...] = ()
    """What is known to a tolerance only, errors of the record and moments, each with its prior in the estimate."""
    environment: tuple[Estimate, ...] = ()
    """Gravity (m/s^2) in de-rolled axes of the first sample."""
    log_likelihood: float = float("nan")
    """Minus the NLLF of Eq. 3.10 with erratum E8, of the innovations at every sample."""
    iterations: int = 0
    """Of all searches together."""
    innovations: tuple[FloatArray, ...] = ()
    """By segment, (4, samples): measured minus predicted q, r (rad/s), ay, az (m/s^2), at `times`."""
    times: tuple[FloatArray, ...] = ()
    """By segment, s."""
    whiteness: tuple[Whiteness, ...] = ()
    """Test of each output's innovations, in the order of OUTPUTS."""
    seconds: float = 0.0
    """Wall clock."""
    problem: Problem | None = None
    """What was solved; None where it could not be begun."""
    fit: FitResult | None = None
    """The likelihood's own result."""

    @property
    def converged(self) -> bool:
        """Whether the estimates may be used."""
        return self.status == "converged"


# ---- Coefficients over time with their uncertainty: Section 3.4, Figures 4.10 to 4.14 of the report ----


@dataclass(frozen=True)
class CoefficientHistory:
    """A coefficient over time, of one segment of one flight."""

    name: str
    flight: int
    time: FloatArray
    """(n,), s."""
    value: FloatArray
    """(n,)."""
    std_error: FloatArray
    """(n,); the band is 2 sigma."""

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
    index = [found.fit.names.index(name) for name in (*(term.name for term in found.terms), *names)]
    scale = np.array([*np.ones(count), *sizes])
    out = found.fit.covariance[np.ix_(index, index)] * np.outer(scale, scale)
    out[:count, :count] = found.covariance
    return np.asarray(out)


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
