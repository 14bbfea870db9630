"""What a fit returns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.likelihood.derivatives import Method
from brv_hypo.likelihood.fit_report import fit_report
from brv_hypo.likelihood.leave_out import Linearised
from brv_hypo.likelihood.noise import whitening
from brv_hypo.likelihood.search import Progress
from brv_hypo.likelihood.status import Status
from brv_hypo.likelihood.uncertainty import Identifiability, Whiteness
from brv_hypo.tabular import Row, Tabular

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True)
class Beginning:
    """One search: where its first noise came from, how it ended, and at which log-likelihood."""

    source: str
    status: Status
    log_likelihood: float


@dataclass(frozen=True)
class FitResult(Tabular):
    """A maximum-likelihood fit; p free parameters in the order of `names`.

    Attributes:
        status: a `Status`, which equals its text: "converged", "coarse mesh", "iteration limit", "stalled",
            "undetermined" (a state that no output sees) or "diverged"; `status.remedy` says what to try.
        message: cause and remedy where it did not converge.
        names: the free parameters; a per-segment parameter b is b[0], b[1], ...
        theta: estimate by name, those held fixed included.
        std_error: standard error by name, residuals taken as white; nan at a bound or where the data do not
            determine the parameter.
        std_error_coloured: the same, corrected for coloured residuals (Morelli and Klein 1997): report this
            one. With process noise, which is itself the model of what colours the residuals, equal to
            std_error.
        covariance: (p, p), residuals taken as white.
        covariance_coloured: (p, p), corrected.
        log_likelihood: minus the NLLF of Eq. 3.10 with erratum E8, -1/2 sum(v' B^-1 v + log det B); the
            constant -1/2 N log(2 pi) is left out, as in the report.
        innovation_covariance: B of Eq. 3.11, (n_outputs, n_outputs).
        noise_covariance: covariance of the measurement noise; B itself in output error.
        process_noise: standard deviation that drives each state, (n_states,), per root second; zeros in
            output error.
        noise_std_error: with process noise, standard errors of the outputs' noise standard deviations, the roots of
            `noise_covariance`'s diagonal, (n_outputs,); nan where given, or where one went to 0 (see remarks),
            and in output error.
        process_noise_std_error: the same of `process_noise`, (n_states,).
        iterations: Gauss-Newton steps taken in theta.
        history: NLLF, violation of the dynamics, step length and fraction after each iteration.
        identifiability: condition, and near-null directions by name.
        whiteness: test of each output's innovations.
        states: by segment, (n_states, n).
        initial_state_std_error: by segment, (n_states,), state units: standard errors of `states[:, 0]`, those of
            theta accounted for, residuals taken as white; 0 where it was held, nan where it is not determined.
        innovations: by segment, measured minus predicted output, (n_outputs, n); nan in gaps.
        at_bound: parameters that ended at a bound: their errors, and the meaning of the others', are
            conditional.
        derivatives: how the functions were differentiated.
        samples: number of measured values, all outputs and segments.
        linear: the linear model at the estimate, from which `theta_without` has the estimate without some of
            the samples; None with process noise, and noise "student".
        mesh_shift: how far the discretisation moves an estimate at most, in standard errors, by an estimate of the
            dynamics' errors between samples; nan where that is not known (delays, records of many thousand samples).
        mesh_steps: steps of the dynamics between samples.
        beginnings: the searches that were compared, the first of them first; this is the best of them.
        noise_freedom: with noise "student", degrees of freedom of each output's, (n_outputs,): 200, at most, is next to
            Gaussian. `noise_covariance` then has the squares of the scales, and standard errors are those of an
            M-estimator, which outliers do not falsify.
        weights: with noise "student", what each sample counts, by segment, (n_outputs, n): about 1, next to 0 for
            outliers; 1 in gaps.
        remarks: what makes the errors mean something else than they say, though the search converged.
    """

    status: Status
    message: str
    names: tuple[str, ...]
    theta: dict[str, float]
    std_error: dict[str, float]
    std_error_coloured: dict[str, float]
    covariance: FloatArray
    covariance_coloured: FloatArray
    log_likelihood: float
    innovation_covariance: FloatArray
    noise_covariance: FloatArray
    process_noise: FloatArray
    noise_std_error: FloatArray
    process_noise_std_error: FloatArray
    iterations: int
    history: tuple[Progress, ...]
    identifiability: Identifiability
    whiteness: tuple[Whiteness, ...]
    states: tuple[FloatArray, ...]
    initial_state_std_error: tuple[FloatArray, ...]
    innovations: tuple[FloatArray, ...]
    at_bound: tuple[str, ...]
    derivatives: Method
    samples: int
    linear: Linearised | None
    mesh_shift: float = float("nan")
    mesh_steps: int = 1
    beginnings: tuple[Beginning, ...] = ()
    remarks: tuple[str, ...] = ()
    noise_freedom: FloatArray | None = None
    weights: tuple[FloatArray, ...] = ()

    __repr__ = Tabular.__repr__
    __eq__ = Tabular.__eq__

    def headline(self) -> str:
        """Status, likelihood and size."""
        return (
            f"{self.status} after {self.iterations} iterations, log-likelihood {self.log_likelihood:.6g}, "
            f"{len(self.names)} parameters, {self.samples} values"
        )

    def rows(self) -> Sequence[Row]:
        """One row for each parameter; the standard error is the one for coloured residuals."""
        return [
            {
                "parameter": name,
                "value": value,
                "std_error": self.std_error_coloured.get(name, float("nan")),
                "std_error_white": self.std_error.get(name, float("nan")),
                "free": name in self.names,
                "at_bound": name in self.at_bound,
            }
            for name, value in self.theta.items()
        ]

    def theta_without(self, left_out: Sequence[BoolArray]) -> dict[str, float]:
        """Estimate by name where the marked samples, (n,) a segment, take no part, to first order.

        Raises:
            UsageError: with process noise or noise "student", or masks that do not fit.
        """
        change = dict(zip(self.names, self._linear().change_without(left_out).tolist(), strict=True))
        return {name: value + change.get(name, 0.0) for name, value in self.theta.items()}

    def change_by(self, measured_more: Sequence[FloatArray]) -> dict[str, float]:
        """Change of the free parameters by name where the outputs were measured so much higher, (n_outputs, n) a
        segment, to first order; what is not finite counts as nothing.

        Raises:
            UsageError: as `theta_without`.
        """
        gained = []
        for more in measured_more:
            seen = np.isfinite(more)
            gained.append(-np.einsum("nij,jn->ni", whitening(self.noise_covariance, seen), np.where(seen, more, 0.0)))
        return dict(zip(self.names, self._linear().change_by(gained).tolist(), strict=True))

    def _linear(self) -> Linearised:
        """The linear model, where there is one."""
        if self.linear is None:
            raise UsageError(
                f"a fit of status {self.status!r} with process noise {self.process_noise} and noise of "
                f"{self.noise_freedom} degrees of freedom cannot say what it would be without some samples, or of "
                "others: expected one without process noise, of Gaussian noise, whose states are determined. "
                "Fit again, such samples as nan in y"
            )
        return self.linear

    def report(self) -> str:
        """The fit as text: status, noise, parameters with their errors, correlations, warnings."""
        return fit_report(self)

    def to_dataframe(self) -> DataFrame:
        """A table by parameter: value, std_error (the one to report), std_error_white, free, at_bound.

        Needs pandas (extra "tables").
        """
        return super().to_dataframe().set_index("parameter")

    @property
    def converged(self) -> bool:
        """Whether the estimate may be used."""
        return self.status == "converged"

    @property
    def nllf(self) -> float:
        """The negative log-likelihood of Eq. 3.10 with erratum E8."""
        return -self.log_likelihood
