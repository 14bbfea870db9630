"""What an identification returns."""

from __future__ import annotations

from dataclasses import dataclass

from brv_hypo.arrays import FloatArray
from brv_hypo.identification.problem import Problem
from brv_hypo.likelihood import FitResult
from brv_hypo.likelihood.uncertainty import Identifiability, Whiteness
from brv_hypo.model.columns import Column
from brv_hypo.regression.frame import RateFrame

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
    columns: tuple[Column, ...]
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
