"""What a fit returns, its report, and intervals by profile likelihood.

`FitResult` is a table by parameter; `report` writes it as text in the manner of lmfit. `profile_interval` holds a
parameter at a value and fits everything else again, noise included: an end of the interval is where the
log-likelihood has dropped by half the chi-square quantile of one degree of freedom. The signed root of the drop is
nearly linear in the parameter, so that a few fits find the end.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.likelihood.derivatives import Method
from brv_hypo.likelihood.noise import whitening
from brv_hypo.likelihood.search import Progress, Status
from brv_hypo.likelihood.uncertainty import Identifiability, Linearised, Whiteness
from brv_hypo.results import Row, Tabular

if TYPE_CHECKING:
    from pandas import DataFrame


# ---- A fit in words and numbers, in the manner of lmfit's report ----


_CORRELATED = 0.5
"""Least correlation that is listed."""
_MOST_CORRELATIONS = 10
_FAR = 0.5
"""Weight below which a sample is counted as far off."""


def fit_report(result: FitResult) -> str:
    """Status, statistics, noise, parameters with both errors, correlations, and what to beware of."""
    blocks = (
        ["[[Fit]]", *_statistics(result)],
        ["[[Noise]]", *_noise(result)],
        ["[[Parameters]]", *_parameters(result)],
        _correlations(result),
        _warnings(result),
    )
    return "\n".join(line for block in blocks for line in block)


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
        (
            "steps per sample",
            f"{result.mesh_steps}, mesh moves estimates by {result.mesh_shift:.2g} sigma at most",
        ),
    ]
    return [f"    {name:<18}= {value}" for name, value in rows]


def _noise(result: FitResult) -> list[str]:
    found = []
    for i, (variance, error, test) in enumerate(
        zip(np.diag(result.noise_covariance), result.noise_std_error, result.whiteness, strict=True)
    ):
        spread = f" +/- {error:.2g}" if np.isfinite(error) else ""
        colour = "white" if test.white else f"not white (p {test.p_value:.1g}, lag {test.largest_lag})"
        found.append(f"    output {i}: {np.sqrt(variance):.4g}{spread}{_tails(result, i)}, innovations {colour}")
    for i, (size, error) in enumerate(zip(result.process_noise, result.process_noise_std_error, strict=True)):
        if size > 0.0:
            spread = f" +/- {error:.2g}" if np.isfinite(error) else ""
            found.append(f"    state {i} is driven by {size:.4g}{spread} per root second")
    return found


def _tails(result: FitResult, output: int) -> str:
    """Degrees of freedom of an output's noise, and how many samples hardly count."""
    if result.noise_freedom is None:
        return ""
    weights = np.concatenate([each[output] for each in result.weights])
    freedom, far = result.noise_freedom[output], int(np.sum(weights < _FAR))
    return f" (scale of Student's t, {freedom:.3g} degrees of freedom; {far} samples weigh less than {_FAR:g})"


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
        kind = " (at its bound)" if name in result.at_bound else "" if name in result.names else " (constrained)"
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


# ---- What a fit returns ----


@dataclass(frozen=True)
class StartingPoint:
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
        starting_points: the searches that were compared, the first of them first; this is the best of them.
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
    starting_points: tuple[StartingPoint, ...] = ()
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
            observed = np.isfinite(more)
            gained.append(
                -np.einsum(
                    "nij,jn->ni", whitening(self.noise_covariance, observed), np.where(observed, more, 0.0)
                )
            )
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


_CLOSE = 0.01
"""Distance of the root of the drop from its target, in standard errors, at which an end is found."""
_FITS = 12
"""Fits that the search for one end may take."""
_FARTHEST = 30.0
"""Standard errors at which an end that was not found is called infinite."""


class Refit(Protocol):
    """Fits again from start values, with some parameters held: a call of `fit` with all else as it was."""

    def __call__(self, theta0: Mapping[str, float], fixed: Collection[str]) -> FitResult:
        """The fit."""
        ...


@dataclass(frozen=True)
class ProfileInterval:
    """An interval of one parameter; `points` are (value, drop of the log-likelihood) of every fit, by value.

    An end is infinite where the likelihood does not drop enough however far the parameter goes, nan where the fits
    there did not converge.
    """

    name: str
    level: float
    lower: float
    upper: float
    points: tuple[tuple[float, float], ...]


def profile_interval(refit: Refit, result: FitResult, name: str, level: float = 0.95) -> ProfileInterval:
    """The interval of a free parameter at which `refit` loses too much likelihood against `result`.

    Raises:
        UsageError: a parameter that is not free or has no standard error, a level outside (0, 1).
    """
    if name not in result.names or not np.isfinite(result.std_error[name]):
        known = [each for each in result.names if np.isfinite(result.std_error[each])]
        raise UsageError(
            f"{name!r} has no standard error to start a profile from; expected one of {known}. A per-segment parameter "
            "cannot be held in one segment alone"
        )
    if not 0.0 < level < 1.0:
        raise UsageError(f"level is {level}; expected a number between 0 and 1, such as 0.95")
    from scipy.special import ndtri

    root = float(ndtri(0.5 + level / 2.0))
    points = {result.theta[name]: 0.0}
    lower, upper = (_end(refit, result, name, side, root, points) for side in (-1.0, 1.0))
    return ProfileInterval(name, level, lower, upper, tuple(sorted(points.items())))


def _end(
    refit: Refit, result: FitResult, name: str, side: float, root: float, points: dict[float, float]
) -> float:
    """Where the root of twice the drop reaches `root`: secant steps, kept between a point inside and one outside."""
    sigma = result.std_error[name]
    start = dict(result.theta)
    inside, outside = (0.0, 0.0), (np.inf, np.inf)
    away = root
    for _ in range(_FITS):
        value = result.theta[name] + side * away * sigma
        held = refit({key: start[key] for key in result.theta} | {name: value}, (name,))
        if not held.converged:
            return float("nan")
        drop = max(result.log_likelihood - held.log_likelihood, 0.0)
        points[value] = drop
        start = dict(held.theta)
        reached = float(np.sqrt(2.0 * drop))
        if abs(reached - root) < _CLOSE:
            return value
        if reached < root:
            inside = (away, reached)
        else:
            outside = (away, reached)
        if not np.isfinite(outside[0]):
            if away >= _FARTHEST:
                return side * np.inf
            away = min(max(1.5 * away, away * min(root / max(reached, 1e-3), 4.0)), _FARTHEST)
        else:
            share = (root - inside[1]) / (outside[1] - inside[1])
            away = inside[0] + float(np.clip(share, 0.1, 0.9)) * (outside[0] - inside[0])
    return float("nan")
