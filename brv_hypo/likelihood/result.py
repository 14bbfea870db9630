"""What a fit returns, and its report.

`FitResult` is a table by parameter; its `report` writes it as text in the manner of lmfit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.likelihood.derivatives import Method
from brv_hypo.likelihood.noise import whitening
from brv_hypo.likelihood.search import Iteration, Status
from brv_hypo.likelihood.uncertainty import Identifiability, Linearised, Whiteness
from brv_hypo.results import Row, Tabular

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True)
class StartingPoint:
    """One search: where its first noise came from, how it ended, and at which log-likelihood."""

    source: str
    status: Status
    log_likelihood: float


@dataclass(frozen=True)
class FitResult(Tabular):
    """A maximum-likelihood fit; p free parameters in the order of `names`."""

    status: Status
    """How the search ended; equals its text, such as "converged"; `status.remedy` says what to try."""
    message: str
    """Cause and remedy where it did not converge."""
    names: tuple[str, ...]
    """The free parameters."""
    theta: dict[str, float]
    """Estimate by name, those held included."""
    std_error: dict[str, float]
    """Standard error by name, residuals taken as white; nan at a bound or where the data do not determine the
    parameter.
    """
    std_error_coloured: dict[str, float]
    """The same, corrected for coloured residuals (Morelli and Klein 1997): report this one. With process noise, which
    is itself the model of what colours the residuals, equal to std_error.
    """
    covariance: FloatArray
    """(p, p), residuals taken as white."""
    covariance_coloured: FloatArray
    """(p, p), corrected."""
    log_likelihood: float
    """Minus the NLLF of Eq. 3.10 with erratum E8, -1/2 sum(v' B^-1 v + log det B); the constant -1/2 N log(2 pi) is
    left out, as in the report.
    """
    innovation_covariance: FloatArray
    """B of Eq. 3.11, (n_outputs, n_outputs)."""
    noise_covariance: FloatArray
    """Covariance of the measurement noise; B itself in output error."""
    process_noise: FloatArray
    """Standard deviation that drives each state, (n_states,), per root second; zeros in output error."""
    noise_std_error: FloatArray
    """With process noise, standard errors of the outputs' noise standard deviations, the roots of `noise_covariance`'s
    diagonal, (n_outputs,); nan where given, or where one went to 0 (see remarks), and in output error.
    """
    process_noise_std_error: FloatArray
    """The same of `process_noise`, (n_states,)."""
    iterations: int
    """Gauss-Newton steps taken in theta."""
    history: tuple[Iteration, ...]
    """NLLF, violation of the dynamics, step length and fraction after each iteration."""
    identifiability: Identifiability
    """Condition, and near-null directions by name."""
    whiteness: tuple[Whiteness, ...]
    """Test of each output's innovations."""
    states: tuple[FloatArray, ...]
    """By segment, (n_states, n)."""
    innovations: tuple[FloatArray, ...]
    """By segment, measured minus predicted output, (n_outputs, n); nan in gaps."""
    at_bound: tuple[str, ...]
    """Parameters that ended at a bound: their errors, and the meaning of the others', are conditional."""
    derivatives: Method
    """How the functions were differentiated."""
    samples: int
    """Number of measured values, all outputs and segments."""
    linear: Linearised | None
    """The linear model at the estimate, for `change_by`; None with process noise."""
    mesh_shift: float = float("nan")
    """How far the discretisation moves an estimate at most, in standard errors, by an estimate of the dynamics' errors
    between samples; nan where that is not known (delays, records of many thousand samples).
    """
    mesh_steps: int = 1
    """Steps of the dynamics between samples."""
    starting_points: tuple[StartingPoint, ...] = ()
    """The searches that were compared, the first of them first; this is the best of them."""
    remarks: tuple[str, ...] = ()
    """What makes the errors mean something else than they say, though the search converged."""

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

    def change_by(self, measured_more: Sequence[FloatArray]) -> dict[str, float]:
        """Change of the free parameters by name where the outputs were measured so much higher, (n_outputs, n) a
        segment, to first order; what is not finite counts as nothing.

        Raises:
            UsageError: with process noise, or where the states are not determined.
        """
        if self.linear is None:
            raise UsageError(
                f"a fit of status {self.status!r} with process noise {self.process_noise} cannot say what it would be "
                "of other measurements: expected one without process noise, whose states are determined"
            )
        gained = []
        for more in measured_more:
            observed = np.isfinite(more)
            gained.append(
                -np.einsum("nij,jn->ni", whitening(self.noise_covariance, observed), np.where(observed, more, 0.0))
            )
        return dict(zip(self.names, self.linear.change_by(gained).tolist(), strict=True))

    def report(self) -> str:
        """The fit as text: status, noise, parameters with their errors, correlations, warnings."""
        blocks = (
            ["[[Fit]]", *_statistics(self)],
            ["[[Noise]]", *_noise(self)],
            ["[[Parameters]]", *_parameters(self)],
            _correlations(self),
            _warnings(self),
        )
        return "\n".join(line for block in blocks for line in block)

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


# ---- A fit in words and numbers, in the manner of lmfit's report ----


_CORRELATED = 0.5  # least correlation that is listed
_MOST_CORRELATIONS = 10


def correlations(result: FitResult) -> FloatArray:
    """Correlation of the estimates (p, p), from the coloured covariance; nan where there is no error."""
    error = np.sqrt(np.diag(result.covariance_coloured))
    with np.errstate(all="ignore"):
        return np.asarray(result.covariance_coloured / np.outer(error, error))


def _statistics(result: FitResult) -> list[str]:
    p = len(result.names)
    aic = 2.0 * p + 2.0 * result.nllf
    rows = [
        ("status", f"{result.status}: {result.message}"),
        ("iterations", f"{result.iterations}"),
        ("measured values", f"{result.samples}"),
        ("parameters", f"{p}"),
        ("log-likelihood", f"{result.log_likelihood:.6g} (without its constant)"),
        ("Akaike", f"{aic:.6g}"),
        ("steps per sample", f"{result.mesh_steps}, mesh moves estimates by {result.mesh_shift:.2g} sigma at most"),
    ]
    return [f"    {name:<18}= {value}" for name, value in rows]


def _noise(result: FitResult) -> list[str]:
    found = []
    for i, (variance, error, test) in enumerate(
        zip(np.diag(result.noise_covariance), result.noise_std_error, result.whiteness, strict=True)
    ):
        spread = f" +/- {error:.2g}" if np.isfinite(error) else ""
        colour = "white" if test.white else f"not white (p {test.p_value:.1g}, lag {test.largest_lag})"
        found.append(f"    output {i}: {np.sqrt(variance):.4g}{spread}, innovations {colour}")
    for i, (size, error) in enumerate(zip(result.process_noise, result.process_noise_std_error, strict=True)):
        if size > 0.0:
            spread = f" +/- {error:.2g}" if np.isfinite(error) else ""
            found.append(f"    state {i} is driven by {size:.4g}{spread} per root second")
    return found


def _parameters(result: FitResult) -> list[str]:
    width = max(len(name) for name in result.theta)
    found = []
    for name, value in result.theta.items():
        if name not in result.std_error:
            found.append(f"    {name:<{width}}  {value: .6g} (held)")
            continue
        error, white = result.std_error_coloured[name], result.std_error[name]
        note = f" +/- {error:.3g} (white {white:.3g})" if np.isfinite(error) else " (not determined)"
        relative = f" ({abs(error / value):.2%})" if np.isfinite(error) and value != 0.0 else ""
        kind = " (at its bound)" if name in result.at_bound else ""
        found.append(f"    {name:<{width}}  {value: .6g}{note}{relative}{kind}")
    return found


def _correlations(result: FitResult) -> list[str]:
    matrix = correlations(result)
    i, j = np.triu_indices(len(result.names), 1)
    size = np.abs(matrix[i, j])
    order = [k for k in np.argsort(-np.nan_to_num(size), kind="stable") if size[k] >= _CORRELATED]
    if not order:
        return []
    rows = [
        f"    C({result.names[i[k]]}, {result.names[j[k]]}) = {matrix[i[k], j[k]]:+.3f}"
        for k in order[:_MOST_CORRELATIONS]
    ]
    return [f"[[Correlations]] (of {_CORRELATED:g} and more)", *rows]


def _warnings(result: FitResult) -> list[str]:
    found = list(result.remarks)
    if result.identifiability.near_null:
        found.append(str(result.identifiability))
    return ["[[Beware]]", *(f"    {text}" for text in found)] if found else []
