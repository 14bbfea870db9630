"""Errors on the held-out part without an effect and with it: what confirms or contradicts the chosen effect."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.constants import HELD_OUT_CLUSTER
from brv_hypo.regression.channels import Noise, Part, Rows
from brv_hypo.regression.frame import Piece
from brv_hypo.regression.held_out import jackknife_error
from brv_hypo.regression.linear import lengths
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.uncertainty import ResidualMoments

_SPENT = 1e-10  # singular values of unit columns below which a direction is rounding


@dataclass(frozen=True)
class Prediction:
    """Squared moment errors on a part of the record: sum and number of samples of each of its stretches."""

    squares: FloatArray
    sizes: FloatArray

    @property
    def mean_square(self) -> float:
        """Mean square of the moment coefficients, pitch and yaw together."""
        return float(self.squares.sum() / max(self.sizes.sum(), 1.0))

    @property
    def scatter(self) -> float:
        """Relative standard deviation of the mean square of so much white noise, two axes a sample."""
        return float(1.0 / np.sqrt(max(self.sizes.sum(), 1.0)))

    @property
    def std_error(self) -> float:
        """Of the mean square, by the jackknife over stretches."""
        without = (self.squares.sum() - self.squares) / np.maximum(self.sizes.sum() - self.sizes, 1.0)
        return jackknife_error(without)


@dataclass(frozen=True)
class Residuals:
    """What a fit to the fitted part leaves, there and on the held-out part (samples,): rates rad/s, force m/s^2."""

    fitted: Rows
    held_out: Rows


def residuals_of(problem: Problem, held_out: Part, left: Rows) -> Residuals:
    """The residuals of a fit that leaves `left` (frame rows,); the rates but for a constant a segment of the record."""
    return Residuals(left.at(problem.rows.part.rows), left.at(held_out.rows))


@dataclass(frozen=True)
class Agreement:
    """What the held-out part says of an effect, in both channels, in standard errors.

    `fall` of the squared error, by the effect with the coefficients that the fitted part gives; `shown`, how surely
    the effect is there at all, of whatever size: 1.645 has one chance in twenty where it is not.
    """

    fall: float
    shown: float


def agreement(problem: Problem, held_out: Part, before: Residuals, after: Residuals) -> Agreement:
    """Of the residuals without an effect and with it, as a fit of `problem` leaves them.

    The difference of two predictions d and the later residual e give the fall: sum of d^2 + 2 e d, whose noise is
    that of the second part alone; it is summed over clusters of neighbours (White, Econometrica 48:817,
    1980). What the fitted part leaves uncertain of the held-out one, constants of integration among it, weighs the
    rows: it would drown what changes within a stretch.
    """
    directions, share = _uncertain(problem, held_out)
    first, second = (_plain(problem, held_out, left) for left in (before, after))
    first, second = (rows + directions @ (share * (directions.T @ rows)) for rows in (first, second))
    difference = first - second
    products = difference * second
    clusters = np.add.reduceat(products, np.arange(0, products.size, HELD_OUT_CLUSTER))
    noise = max(float(np.sqrt(np.sum(clusters**2))), 1e-300)
    fall = float(first @ first - second @ second) / (2.0 * noise)
    return Agreement(fall, float(difference @ first) / noise)


def _plain(problem: Problem, held_out: Part, left: Residuals) -> FloatArray:
    """The held-out residuals at unit noise (rows,), the rates from the constant that the fitted part has."""
    constants = _constants(problem.rows.part, left.fitted.rates, problem.rows.noise)
    level_of = dict(zip(_segments(problem, problem.rows.part.levels, problem.rows.part), constants, strict=True))
    rates = left.held_out.rates.copy()
    for (a, b), segment in zip(held_out.pieces, _segments(problem, held_out.pieces, held_out), strict=True):
        rates[a:b] -= level_of.get(segment, rates[a:b].mean())
    return held_out.whitened(Rows(rates, left.held_out.force), problem.rows.noise)[:, 0]


def _uncertain(problem: Problem, held_out: Part) -> tuple[FloatArray, FloatArray]:
    """Directions (rows, rank) of the held-out rows in which a prediction from the fitted part errs.

    With them the share (rank,) by which rows change along each where all come to unit variance.
    """
    problem = problem.untied()
    design = problem.whole_design(problem.frame, problem.baseline)
    scale = lengths(design)
    _, sizes, turn = np.linalg.svd(design / scale, full_matrices=False)
    determined = sizes > _SPENT * sizes[0]
    root = (turn[determined].T / sizes[determined]) / scale[:, np.newaxis]
    directions, errors, _ = np.linalg.svd(_unknowns(problem, held_out) @ root, full_matrices=False)
    return directions, 1.0 / np.sqrt(1.0 + errors**2) - 1.0


def _unknowns(problem: Problem, held_out: Part) -> FloatArray:
    """Baseline, constants of the fitted part and nuisances on the held-out rows (rows, unknowns), whitened."""
    noise, part = problem.rows.noise, problem.rows.part
    moments = held_out.white_rates(problem.frame.columns(problem.baseline)[held_out.rows], noise)
    own = _segments(problem, part.levels, part)
    constants = np.zeros((held_out.rows.size, 2 * len(own)), dtype=complex)
    for (a, b), segment in zip(held_out.pieces, _segments(problem, held_out.pieces, held_out), strict=True):
        if segment in own:
            place = 2 * own.index(segment)
            constants[a:b, place], constants[a:b, place + 1] = 1.0, 1.0j
    of_rates = np.column_stack([moments, held_out.white_rates(constants, noise)])
    out = np.zeros((2 * of_rates.shape[0], of_rates.shape[1] + len(problem.rows.nuisances.items)))
    out[: of_rates.shape[0], : of_rates.shape[1]] = of_rates
    others = out[:, of_rates.shape[1] :]
    for some, history in problem.rows.nuisances.histories.batches():
        others[:, some] = held_out.whitened(history.at(held_out.rows), noise)
    return out


def _constants(part: Part, rates: ComplexArray, noise: Noise) -> ComplexArray:
    """Constants of integration (levels,) of residual rates (samples,), as the noise weighs them."""
    design = part.white_rates(part.constants(), noise)
    values = np.linalg.lstsq(design, part.white_rates(rates, noise)[:, 0], rcond=None)[0]
    return np.asarray(values[::2] + 1j * values[1::2], dtype=complex)


def _segments(problem: Problem, ranges: Sequence[Piece], part: Part) -> list[int]:
    """The segment of the record that each range of a part's samples lies in."""
    ends = np.cumsum([b - a for a, b in problem.frame.pieces])
    return [int(np.searchsorted(ends, part.rows[a], side="right")) for a, _ in ranges]


def force_errors(problem: Problem, held_out: Part, left: Residuals) -> tuple[float, float]:
    """Mean squares (m/s^2)^2 of the transverse specific force's errors, fitted and held out, both axes together."""
    parts = ((problem.rows.part, left.fitted), (held_out, left.held_out))
    fitted, other = (float(np.mean(np.abs(rows.force[part.valid]) ** 2) / 2.0) for part, rows in parts)
    return fitted, other


def moment_errors(part: Part, left: ResidualMoments) -> Prediction:
    """Errors of the moment coefficients on a part, by stretch."""
    square = np.where(left.usable, np.abs(left.body) ** 2 / 2.0, 0.0)[part.rows]
    usable = left.usable[part.rows]
    sums = [(float(square[a:b].sum()), float(usable[a:b].sum())) for a, b in part.pieces]
    squares, sizes = np.array(sums).T
    return Prediction(squares, sizes)


def ratio(before: Prediction, after: Prediction) -> tuple[float, float]:
    """Ratio of mean squares, after over before, and its standard error by the jackknife over stretches."""
    whole = after.mean_square / before.mean_square
    keep = ~np.eye(before.squares.size, dtype=bool)
    parts = np.array(
        [
            (after.squares[k].sum() / after.sizes[k].sum()) / (before.squares[k].sum() / before.sizes[k].sum())
            for k in keep
        ]
    )
    return whole, jackknife_error(parts)


def noise_floor(part: Part, moments: ResidualMoments) -> float:
    """Mean square of the moment coefficients' noise on a part."""
    rows = part.rows[moments.usable[part.rows]]
    return float(np.mean(moments.noise[rows] ** 2))
