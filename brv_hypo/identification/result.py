"""What an identification returns, and the coefficients over time (Section 3.4, Figures 4.10 to 4.14 of the report).

`coefficient_histories` has moments, slopes and the normal-force slope along each segment: a coefficient is f(x)'
theta and its variance f' M^-1 f, at the estimated motion; the uncertainty of the motion is not in it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legvander

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.identification.equations import Shapes, point
from brv_hypo.identification.nodes import NodeRecord
from brv_hypo.identification.parameters import of_flight
from brv_hypo.identification.problem import Problem
from brv_hypo.likelihood import Delayed, FitResult
from brv_hypo.likelihood.segment import Interpolator
from brv_hypo.likelihood.uncertainty import Whiteness
from brv_hypo.model.baseline import StaticBend
from brv_hypo.model.term import Regressor
from brv_hypo.regression.frame import RateFrame

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
    """In-plane and out-of-plane moment, their derivatives by alpha, and the normal-force slope, of every segment.

    "C_N'", "C_Z'", "C_N' by alpha" (1/rad), "C_Z' by alpha" (1/rad), "C_Nalpha_force" (1/rad). The derivative
    by alpha is that at the motion as flown, meridian and rates held; knots stand where they were estimated.
    Empty where the fit was not begun.
    """
    if found.problem is None or found.fit is None:
        return ()
    segments = range(len(found.problem.records))
    return tuple(each for k in segments for each in _of_segment(found, found.problem, found.fit, k))


def _of_segment(found: Identification, problem: Problem, fit: FitResult, segment: int) -> list[CoefficientHistory]:
    record, theta, step = problem.records[segment], fit.theta, 1e-4
    flight, time = record.context.flight, record.segment.t
    common_time = record.context.coefficient_time(time)
    bend = problem.frame.mechanisms.get(StaticBend.name)
    bends = [v for v, number in problem.tolerated if number == flight and v.name.startswith(StaticBend.name)]
    names = [of_flight(value.name, flight) for value in bends]
    sizes = np.array([value.size for value in bends])

    def at(scale: float) -> tuple[ComplexArray, FloatArray]:
        """C_N' + i C_Z' per unit of each coefficient and of the bend's (rows, n), and alpha, with the states scaled."""
        states = fit.states[segment] * np.array([[1.0], [1.0], [scale], [scale]])
        shapes = _shapes(problem, record, states, theta)
        bent = [] if bend is None else [term.in_plane for term in bend.terms(shapes.motion, {})]
        return np.vstack([shapes.in_plane, *bent]), shapes.motion.alpha

    (here, _), (low, less), (high, more) = (at(scale) for scale in (1.0, 1.0 - step, 1.0 + step))
    bases = np.array([*(c.time_basis(common_time) for c in found.columns), *np.ones((len(bends), time.size))])
    moments, slopes = here * bases, (high - low) * bases / (more - less)
    values = np.append(found.values, sizes * [theta[name] for name in names])
    # The bend's covariance beside that of the coefficients, which is at the reported standard errors.
    count = found.values.size
    index = [fit.names.index(name) for name in (*(term.name for term in found.terms), *names)]
    scale = np.append(np.ones(count), sizes)
    covariance = fit.covariance[np.ix_(index, index)] * np.outer(scale, scale)
    covariance[:count, :count] = found.covariance
    forces = list(problem.model.force_names)
    index = [fit.names.index(name) for name in forces]
    drift = np.asarray(legvander(problem.model.scaled(common_time), len(index) - 1).T, dtype=float)
    own = np.array([theta[name] for name in forces]), fit.covariance[np.ix_(index, index)]
    rows = {
        "C_N'": (moments.real, values, covariance),
        "C_Z'": (moments.imag, values, covariance),
        "C_N' by alpha": (slopes.real, values, covariance),
        "C_Z' by alpha": (slopes.imag, values, covariance),
        "C_Nalpha_force": (drift, *own),
    }
    histories = []
    for name, (f, estimates, errors) in rows.items():
        sigma = np.sqrt(np.maximum(np.einsum("jn,jk,kn->n", f, errors, f), 0.0))
        histories.append(CoefficientHistory(name=name, flight=flight, time=time, value=estimates @ f, std_error=sigma))
    return histories


def _shapes(problem: Problem, record: NodeRecord, states: FloatArray, theta: Mapping[str, float]) -> Shapes:
    """The columns at the nodes with these states."""
    time, u = record.segment.t, record.segment.u
    interpolator = Interpolator(time)
    delayed = {}
    for name in problem.structure.delays:
        stencil = interpolator.stencil(time - theta[name])
        delayed[name] = Delayed(stencil.apply(states), stencil.apply(u))
    return problem.model.shapes(point(states, u, time), theta, delayed)
