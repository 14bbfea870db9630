"""How well parameters and initial states are known.

White residuals: the inverse of the information, with near-null directions by name. Coloured residuals (Morelli and
Klein, J. Aircraft 34, 1997):

    C = D [sum_i sum_j S_i' B^-1 R(i - j) B^-1 S_j] D

with D the covariance for white residuals, S the outputs' sensitivities, R the residuals' autocorrelation by an
autoregressive model, its order by Akaike's criterion; the double sum is done over frequencies and cannot turn
negative. Initial states: cov a = M^-1 + F (cov theta) F', M their information given theta, F = da / dtheta.

`Linearised` gives the estimate without some samples, or with other measurements, by one Gauss-Newton step: exact for
a linear model. `changing_errors` names standard errors that depend on the estimate itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray, IntArray
from brv_hypo.errors import UsageError
from brv_hypo.likelihood.condensing import eliminate
from brv_hypo.likelihood.gauss_newton import (
    Iterate,
    Problem,
    Sensitivity,
    SingularStatesError,
    information_factor,
    sensitivities,
)

# ---- The estimate without some of the samples, or of others, from the linearisation at the estimate ----


@dataclass(frozen=True)
class LinearRows:
    """One segment at the solution: whitened residual r (n, n_outputs), its derivative A by its own parameters
    (n, n_outputs, p) and G by the free part of its initial state (n, n_outputs, free).

    `index` (p,) are the places of the parameters among the fit's; `known` (free,) the inverse of the prior
    standard deviation of the initial state and `strayed` (free,) how many of them it lies from its mean.
    """

    residual: FloatArray
    by_parameter: FloatArray
    by_start: FloatArray
    index: IntArray
    known: FloatArray
    strayed: FloatArray


@dataclass(frozen=True)
class Linearised:
    """The fit's linear model at its solution, for `theta_without` and `change_by`.

    `precision` (p,) is the inverse variance of the priors, `away` (p,) the estimate less their means,
    `estimated` the parameters that are free and not at a bound.
    """

    rows: tuple[LinearRows, ...]
    precision: FloatArray
    away: FloatArray
    estimated: IntArray

    def change_without(self, left_out: Sequence[BoolArray]) -> FloatArray:
        """Change of the parameters (p,) where the marked samples, (n,) a segment, take no part.

        Raises:
            UsageError: masks that do not fit the segments.
        """
        sizes = [rows.residual.shape[0] for rows in self.rows]
        if [mask.size for mask in left_out] != sizes:
            raise UsageError(
                f"the samples left out are marked by arrays of {[m.size for m in left_out]}; expected {sizes}, "
                "one mark a sample of each segment"
            )
        kept = (
            _projected(rows, ~mask, rows.residual[~mask], rows.strayed)
            for rows, mask in zip(self.rows, left_out, strict=True)
        )
        return self._step(kept, self.precision * self.away)

    def change_by(self, gained: Sequence[FloatArray]) -> FloatArray:
        """Change of the parameters (p,) where the whitened residual gains so much, (n, n_outputs) a segment."""
        every = (
            _projected(rows, np.ones(rows.residual.shape[0], dtype=np.bool_), gain, np.zeros_like(rows.strayed))
            for rows, gain in zip(self.rows, gained, strict=True)
        )
        return self._step(every, np.zeros_like(self.away))

    def _step(self, segments: Iterable[tuple[FloatArray, FloatArray]], pull: FloatArray) -> FloatArray:
        """The Gauss-Newton step (p,) of derivatives (rows, p) and residuals (rows,) of each segment, and of priors."""
        normal = np.diag(self.precision)
        for rows, (own, residual) in zip(self.rows, segments, strict=True):
            normal[np.ix_(rows.index, rows.index)] += own.T @ own
            pull[rows.index] += own.T @ residual
        free = np.ix_(self.estimated, self.estimated)
        size = np.sqrt(np.maximum(np.diag(normal)[self.estimated], 1e-300))
        scaled = np.linalg.pinv(normal[free] / np.outer(size, size), rcond=1e-12, hermitian=True)
        change = np.zeros(self.away.size)
        change[self.estimated] = -(scaled @ (pull[self.estimated] / size)) / size
        return change


def _projected(
    rows: LinearRows, kept: BoolArray, residual: FloatArray, strayed: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Derivatives (rows, p) and `residual` (kept, n_outputs) of the samples kept, the initial state projected out."""
    p, free = rows.by_parameter.shape[2], rows.by_start.shape[2]
    count = int(np.count_nonzero(kept)) * rows.residual.shape[1]
    own = np.concatenate([rows.by_parameter[kept].reshape(count, p), np.zeros((free, p))])
    residual = np.concatenate([residual.reshape(-1), strayed])
    start = np.concatenate([rows.by_start[kept].reshape(count, free), np.diag(rows.known)])
    basis = np.linalg.qr(start)[0]
    return own - basis @ (basis.T @ own), residual - basis @ (basis.T @ residual)


# ---- How well the parameters are known: covariance, near-null directions, whiteness ----


_NEAR_NULL = 1e-3
"""Singular value of column-scaled sensitivities, against the largest, of a near-null direction."""
_NULL = 1e-13
"""The same of a direction that is not seen at all: what is left is rounding."""
_TOUCHED = 1e-8
"""Square of a parameter's weight in such directions from which it is not determined."""
_NAMED = 0.1
"""Least weight with which a parameter is named in a near-null direction."""


@dataclass(frozen=True)
class NearNull:
    """A combination of parameters that the data hardly see.

    `weights` name the parameters, each scaled by its own information; `relative` is the singular value
    against the largest.
    """

    weights: dict[str, float]
    relative: float


@dataclass(frozen=True)
class Identifiability:
    """Condition of the column-scaled sensitivities, and what the data hardly see, worst first."""

    condition: float
    near_null: tuple[NearNull, ...]

    def __str__(self) -> str:
        if not self.near_null:
            return f"all parameters are seen by the data (condition {self.condition:.3g})"
        parts = [" ".join(f"{w:+.2f} {name}" for name, w in d.weights.items()) for d in self.near_null]
        return f"hardly seen by the data (condition {self.condition:.3g}): " + "; ".join(parts)


@dataclass(frozen=True)
class Whiteness:
    """Ljung-Box test of one output's innovations.

    Statistic on `lags` lags and its p-value; largest autocorrelation and its lag.
    """

    statistic: float
    p_value: float
    lags: int
    largest: float
    largest_lag: int

    @property
    def white(self) -> bool:
        """Whether whiteness stands at the 1 % level."""
        return self.p_value >= 0.01


def covariance_from_information(
    triangle: FloatArray, prior_std: FloatArray, estimated: IntArray
) -> FloatArray:
    """Inverse of the information matrix T'T plus priors, (p, p).

    nan for parameters not in `estimated` (at a bound), and for those alone that a direction moves which the
    data do not see.
    """
    p = prior_std.size
    system = np.concatenate([triangle, np.diag(1.0 / prior_std)])[:, estimated]
    covariance = np.full((p, p), np.nan)
    norm = np.linalg.norm(system, axis=0)
    _, singular, rotation = np.linalg.svd(system / np.where(norm > 0, norm, 1.0), full_matrices=False)
    kept = singular > _NULL * singular.max(initial=0.0)
    lost = 1.0 - np.sum(rotation[kept] ** 2, axis=0)
    determined = np.flatnonzero((norm > 0) & (lost < _TOUCHED))
    root = rotation[kept][:, determined].T / singular[kept]
    where = estimated[determined]
    covariance[np.ix_(where, where)] = root @ root.T / np.outer(norm[determined], norm[determined])
    return covariance


def identifiability(triangle: FloatArray, prior_std: FloatArray, names: Sequence[str]) -> Identifiability:
    """Near-null directions of the column-scaled sensitivities, by the names of their parameters."""
    system = np.concatenate([triangle, np.diag(1.0 / prior_std)])
    norm = np.linalg.norm(system, axis=0)
    _, singular, rotation = np.linalg.svd(system / np.where(norm > 0, norm, 1.0))
    relative = singular / singular[0] if singular[0] > 0 else np.zeros_like(singular)
    directions = []
    for value, direction in sorted(zip(relative, rotation, strict=True), key=lambda pair: float(pair[0])):
        if value < _NEAR_NULL:
            order = np.argsort(-np.abs(direction))
            weights = {names[i]: float(direction[i]) for i in order if abs(direction[i]) >= _NAMED}
            directions.append(NearNull(weights, float(value)))
    condition = float(1.0 / relative[-1]) if relative[-1] > 0 else float("inf")
    return Identifiability(condition, tuple(directions))


def whiteness(innovations: Sequence[FloatArray], lags: int) -> tuple[Whiteness, ...]:
    """Ljung-Box test for each output over all segments; `innovations` (n_outputs, n) each, nan in gaps."""
    from scipy.special import gammaincc

    tests = []
    for i in range(innovations[0].shape[0]):
        rows = [v[i] - np.nanmean(v[i]) if np.isfinite(v[i]).any() else np.zeros(0) for v in innovations]
        rows = [np.where(np.isfinite(row), row, 0.0) for row in rows]
        count = sum(int(np.count_nonzero(row)) for row in rows)
        power = sum(float(row @ row) for row in rows)
        products = [
            sum(float(row[: row.size - k] @ row[k:]) for row in rows if row.size > k)
            for k in range(1, lags + 1)
        ]
        r = np.array(products) / power if power > 0 else np.zeros(lags)
        statistic = float(count * (count + 2) * np.sum(r**2 / np.maximum(count - np.arange(1, lags + 1), 1)))
        worst = int(np.argmax(np.abs(r)))
        p_value = float(gammaincc(lags / 2, statistic / 2))
        tests.append(Whiteness(statistic, p_value, lags, float(r[worst]), worst + 1))
    return tuple(tests)


_HIGHEST_ORDER = 20
_LEAST_SAMPLES_PER_ORDER = 10
_LEAST_POLYNOMIAL = 1e-6
_BLOCK = 32768
"""Samples transformed at a time. What is correlated across the edges of blocks this long is left out."""
_LARGEST_REFLECTION = 0.999
"""Keeps an autoregression stable where gaps make its autocorrelations inconsistent."""


def coloured_covariance(
    white: FloatArray,
    prior_information: FloatArray,
    sensitivity: Sequence[FloatArray],
    residual: Sequence[FloatArray],
) -> FloatArray:
    """The corrected covariance, (p, p).

    Args:
        white: D, (p, p), not inflated for degrees of freedom.
        prior_information: inverse variances of the priors, (p,), 0 where there is none.
        sensitivity: by segment, whitened, the states following, (n, n_outputs, p).
        residual: by segment, whitened, zero in gaps, (n, n_outputs).
    """
    correlation = autocorrelation(residual)
    samples = sum(len(v) for v in residual)
    models = [autoregression(correlation[:, a, a], samples) for a in range(correlation.shape[1])]
    middle = np.diag(prior_information)
    for s in sensitivity:
        for first in range(0, len(s), _BLOCK):
            middle = middle + _weighted_products(s[first : first + _BLOCK], models, correlation[0])
    return np.asarray(white @ middle @ white)


def white_covariance(
    white: FloatArray,
    prior_information: FloatArray,
    sensitivity: Sequence[FloatArray],
    residual: Sequence[FloatArray],
) -> FloatArray:
    """The same of residuals that are white, but of another variance than 1, (p, p)."""
    variance = np.diag(autocorrelation(residual)[0])
    middle = np.diag(prior_information)
    for s in sensitivity:
        middle = middle + np.einsum("nap,a,naq->pq", s, variance, s, optimize=True)
    return np.asarray(white @ middle @ white)


def _weighted_products(s: FloatArray, models: Sequence[FloatArray], turn: FloatArray) -> FloatArray:
    """Sum over i and j of S_i' R(i - j) S_j, (p, p), S (n, n_outputs, p)."""
    length = 1 << (2 * len(s) - 1).bit_length()
    gain = np.stack([_gain(model, length) for model in models], axis=1)
    shaped = np.fft.rfft(s, length, axis=0) * gain[:, :, None]
    turned = turn @ shaped
    both_sides = np.full(len(gain), 2.0)
    both_sides[[0, -1]] = 1.0
    product = np.einsum("f,fap,faq->pq", both_sides, shaped.conj(), turned, optimize=True).real
    return np.asarray(product / length)


def inflation(white: FloatArray, corrected: FloatArray, unknowns: int, samples: int) -> float:
    """Factor for what the fit took out of the residuals' variance.

    In white noise that is one sample per unknown, in coloured noise as many more as the variance of the
    unknowns is larger: N / (N - unknowns tr(D^-1 C) / p).
    """
    ratio = float(np.trace(np.linalg.solve(white, corrected))) / len(white)
    return samples / max(samples - unknowns * max(ratio, 1.0), 0.5 * samples)


def autocorrelation(residual: Sequence[FloatArray]) -> FloatArray:
    """R(lag), (orders + 1, n_outputs, n_outputs): mean of v(i) v(i + lag)' over what was measured."""
    n_outputs = residual[0].shape[1]
    longest = min(_HIGHEST_ORDER, sum(len(v) for v in residual) // _LEAST_SAMPLES_PER_ORDER)
    total = np.zeros((longest + 1, n_outputs, n_outputs))
    pairs = np.zeros_like(total)
    for v in residual:
        observed = (v != 0).astype(float)
        for lag in range(min(longest, len(v) - 1) + 1):
            total[lag] += v[: len(v) - lag].T @ v[lag:]
            pairs[lag] += observed[: len(v) - lag].T @ observed[lag:]
    return total / np.maximum(pairs, 1.0)


def autoregression(correlation: FloatArray, samples: int) -> FloatArray:
    """Coefficients of v(i) = sum a_k v(i - k) + white noise, (order,).

    By Levinson's recursion, the order by Akaike's criterion. `correlation` (orders + 1,) is the
    autocorrelation, lag 0 first.
    """
    coefficients = chosen = np.zeros(0)
    variance = float(correlation[0])
    if variance <= 0:
        return chosen
    least = samples * np.log(variance)
    for order in range(1, len(correlation)):
        reflection = (correlation[order] - coefficients @ correlation[order - 1 : 0 : -1]) / variance
        reflection = float(np.clip(reflection, -_LARGEST_REFLECTION, _LARGEST_REFLECTION))
        coefficients = np.append(coefficients - reflection * coefficients[::-1], reflection)
        variance *= 1.0 - reflection**2
        criterion = samples * np.log(variance) + 2 * order
        if criterion < least:
            least, chosen = criterion, coefficients
    return chosen


def _gain(coefficients: FloatArray, length: int) -> FloatArray:
    """Square root of the model's spectrum, of unit variance, at the frequencies of a real transform."""
    polynomial = np.abs(np.fft.rfft(np.concatenate([[1.0], -coefficients]), length))
    response = 1.0 / np.maximum(polynomial, _LEAST_POLYNOMIAL)
    power = np.concatenate([response**2, response[-2:0:-1] ** 2])
    return np.asarray(response / np.sqrt(power.mean()))


MARK = "hold for this estimate alone"
"""Words by which such a remark is known."""
_CHANGE = 0.2
"""Relative change of a standard error with its estimate moved by one that is reported: a scatter of 1.17."""
_LOOSE = 0.05
"""Standard error over estimate below which no more can come of it than the functions' curvature over a twentieth."""


def changing_errors(
    problem: Problem,
    iterate: Iterate,
    segments: Sequence[Sensitivity],
    covariance: FloatArray,
    estimated: IntArray,
) -> tuple[str, ...]:
    """A remark where a standard error changes much within itself: sigma is taken again one sigma to either side.

    The other parameters and the states go along as the fit lets them follow. `covariance` (p, p) is that of theta.
    """
    sigma = np.sqrt(np.diag(covariance))
    changes = {}
    for j in estimated.tolist():
        if not sigma[j] > _LOOSE * abs(iterate.theta[j]):
            continue
        way = np.nan_to_num(covariance[:, j] / sigma[j])
        sides = [_variance(problem, _moved(problem, iterate, segments, s * way), j, estimated) for s in (1.0, -1.0)]
        change = 0.25 * abs(float(np.log(sides[0] / sides[1])))
        if change > _CHANGE:
            changes[problem.parameters.names[j]] = change
    if not changes:
        return ()
    most = float(np.exp(max(changes.values())))
    return (
        f"standard errors of {list(changes)} {MARK}: one sigma away they are {most:.2g} times as large or small, so "
        "that estimates scatter by a fifth more than they say, or worse. Likely cause: motion that is over within few "
        "samples. Take profile_interval instead, sample faster, or measure with less noise",
    )


def _moved(problem: Problem, iterate: Iterate, segments: Sequence[Sensitivity], way: FloatArray) -> Iterate:
    """The iterate with theta changed by `way` (p,) and the states following."""
    x = []
    for states, segment, index in zip(iterate.x, segments, problem.parameters.segment_index, strict=True):
        following = segment.eliminated.states(np.append(0.0, way[index]))
        x.append(states + following.T * problem.size[:, None])
    return replace(iterate, theta=iterate.theta + way, x=tuple(x))


def _variance(problem: Problem, iterate: Iterate, j: int, estimated: IntArray) -> float:
    """Variance of parameter j as it would be stated there; nan where it cannot be had."""
    p = len(problem.parameters.names)
    try:
        with np.errstate(all="ignore"):
            triangle = information_factor(problem, sensitivities(problem, iterate))[:p, :p]
    except SingularStatesError:
        return float("nan")
    if not np.all(np.isfinite(triangle)):
        return float("nan")
    return float(covariance_from_information(triangle, problem.parameters.prior_std, estimated)[j, j])


# ---- How well the initial state of each segment is known, and what the outputs make of it ----


Starts = tuple[tuple[FloatArray, FloatArray] | None, ...]
"""For each segment, derivatives of the whitened outputs (n, n_outputs, n_states) and process noise (n, n_states,
n_states) by the scaled initial state, the other states following; None where they are not determined."""


def by_initial_states(problem: Problem, segments: Sequence[Sensitivity]) -> Starts:
    """What the initial states do, theta held."""
    return tuple(_by_initial_state(problem, segment) for segment in segments)


def initial_state_errors(
    problem: Problem,
    starts: Starts,
    segments: Sequence[Sensitivity],
    covariance: FloatArray,
    variance_factor: float,
) -> tuple[FloatArray, ...]:
    """Standard errors of the initial states, (n_states,) a segment; 0 where one is held, nan where not determined.

    `covariance` (p, p) of theta, nan for parameters that the fit could not move; `variance_factor` multiplies the
    variance given theta; `covariance` contains it.
    """
    if not segments:
        return tuple(np.full(grid.start.shape[0], np.nan) for grid in problem.grids)
    found = []
    for s, index in enumerate(problem.parameters.segment_index):
        given_theta = variance_factor * _variance_given_theta(problem, starts[s], s)
        follow = segments[s].eliminated.at_start()[:, 1:] * problem.size[:, None]
        moved = np.isfinite(np.diag(covariance)[index])
        block = covariance[np.ix_(index[moved], index[moved])]
        by_theta = np.einsum("ip,pq,iq->i", follow[:, moved], block, follow[:, moved])
        variance = given_theta + by_theta
        found.append(np.sqrt(np.where(variance >= 0.0, variance, np.nan)))
    return tuple(found)


def linearised(
    problem: Problem,
    iterate: Iterate,
    starts: Starts,
    residual: Sequence[FloatArray],
    estimated: IntArray,
) -> Linearised | None:
    """The linear model at the solution from each segment's `Sensitivity.residual`, none where the states are not
    determined; None also with process noise, which couples what is left out to the rest.
    """
    if not residual or np.any(problem.process_noise):
        return None
    rows = []
    for s, grid in enumerate(problem.grids):
        by_start = starts[s]
        if by_start is None:
            return None
        free = grid.start_std > 0.0
        rows.append(
            LinearRows(
                residual=residual[s][:, :, 0],
                by_parameter=residual[s][:, :, 1:],
                by_start=by_start[0][:, :, free],
                index=problem.parameters.segment_index[s],
                known=problem.size[free] / grid.start_std[free],
                strayed=(iterate.x[s][free, 0] - grid.first[free]) / grid.start_std[free],
            )
        )
    parameters = problem.parameters
    informed = np.isfinite(parameters.prior_std)
    precision = np.where(informed, 1.0 / parameters.prior_std**2, 0.0)
    away = np.where(informed, iterate.theta - parameters.prior_mean, 0.0)
    return Linearised(tuple(rows), precision, away, estimated)


def _variance_given_theta(
    problem: Problem, found: tuple[FloatArray, FloatArray] | None, number: int
) -> FloatArray:
    """Diagonal of M^-1, (n_states,), with what was known of the initial state before."""
    grid, size = problem.grids[number], problem.size
    if found is None:
        return np.full(size.size, np.nan)
    rows = np.concatenate([part.reshape(-1, size.size) for part in found])
    known = grid.start_std / size
    estimated = np.flatnonzero(known > 0.0)
    before = np.where(known > 0.0, known, np.inf)
    triangle = np.asarray(np.linalg.qr(rows, mode="r"))
    given = covariance_from_information(triangle, before, estimated)
    return np.where(known > 0.0, np.diag(given), 0.0) * size**2


def _by_initial_state(problem: Problem, segment: Sensitivity) -> tuple[FloatArray, FloatArray] | None:
    free = segment.eliminated.problem
    size = problem.size.size
    by_start = np.zeros((*free.defect.shape, size))
    by_start[0] = -np.eye(size)
    variance = free.variance.copy()
    variance[0] = 0.0
    held = replace(
        free,
        by_parameter=np.zeros((*free.residual.shape, size)),
        defect_by_parameter=by_start,
        variance=variance,
    )
    eliminated = eliminate(held)
    if eliminated is None:
        return None
    outputs, noise = eliminated.rows()
    disturbance = np.zeros((*free.defect.shape, size)) if noise is None else noise[:, :, 1:]
    return outputs[:, :, 1:], disturbance
