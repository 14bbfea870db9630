"""Judgement on the held-out part: it took no part in the fit, nor in the choice of the effect."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.regression.channels import Noise, Part, Rows
from brv_hypo.regression.frame import Piece, RateFrame
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.residual_moments import ResidualMoments

# Rows that are summed before their squares are, so that short correlations count.
_CLUSTER = 8


@dataclass(frozen=True)
class Prediction:
    """Squared moment errors on a part of the record: sum and number of samples of each of its stretches."""

    squares: FloatArray
    sizes: FloatArray

    @property
    def mean_square(self) -> float:
        """Mean square of the moment coefficients, pitch and yaw together."""
        return float(self.squares.sum() / max(self.sizes.sum(), 1.0))


@dataclass(frozen=True)
class Residuals:
    """What a fit to the fitted part leaves, there and on the held-out part (samples,): rates rad/s, force m/s^2."""

    fitted: Rows
    held_out: Rows


def residuals_of(problem: Problem, held_out: Part, left: Rows) -> Residuals:
    """The residuals of a fit that leaves `left` (frame rows,); the rates but for a constant a segment of the record."""
    return Residuals(left.at(problem.rows.part.rows), left.at(held_out.rows))


def score(problem: Problem, held_out: Part, before: Residuals, after: Residuals) -> float:
    """Fall of the held-out squared error in both channels, in standard errors: the larger of two measures.

    Rates from the constant of integration that the fitted part has show what changes slowly; where the record itself
    drifts, that drowns the rest, and rates from a constant of each stretch's own show what changes within it.
    """
    return max(
        _fall(*(whitened(problem, held_out, left) for left in (before, after)))
        for whitened in (_from_fitted_constants, _from_own_constants)
    )


def _fall(first: FloatArray, second: FloatArray) -> float:
    """Fall of the sum of squares from one residual to the later one, in standard errors.

    The difference of two predictions d and the later residual e give it: sum of d^2 + 2 e d, whose noise is
    that of the second part alone; it is summed over clusters of neighbours (White, Econometrica 48:817,
    1980).
    """
    gain = first**2 - second**2
    noise = 2.0 * second * (first - second)
    starts = np.arange(0, noise.size, _CLUSTER)
    clusters = np.add.reduceat(noise, starts)
    return float(gain.sum() / max(np.sqrt(np.sum(clusters**2)), 1e-300))


def _from_fitted_constants(problem: Problem, held_out: Part, left: Residuals) -> FloatArray:
    """The held-out residuals at unit noise (rows,), the rates from the constant that the fitted part has."""
    constants = _constants(problem.rows.part, left.fitted.rates, problem.rows.noise)
    level_of = dict(zip(_segments(problem, problem.rows.part.levels, problem.rows.part), constants, strict=True))
    rates = left.held_out.rates.copy()
    for (a, b), segment in zip(held_out.pieces, _segments(problem, held_out.pieces, held_out), strict=True):
        rates[a:b] -= level_of.get(segment, rates[a:b].mean())
    return held_out.whitened(Rows(rates, left.held_out.force), problem.rows.noise)[:, 0]


def _from_own_constants(problem: Problem, held_out: Part, left: Residuals) -> FloatArray:
    """The same with the constant of each held-out stretch taken out."""
    rates = left.held_out.rates.copy()
    constants = _constants(held_out, rates, problem.rows.noise)
    for (a, b), constant in zip(held_out.levels, constants, strict=True):
        rates[a:b] -= constant
    return held_out.whitened(Rows(rates, left.held_out.force), problem.rows.noise)[:, 0]


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
    fitted, other = (float(np.mean(np.abs(rows.force[part.seen]) ** 2) / 2.0) for part, rows in parts)
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
            (after.squares[k].sum() / after.sizes[k].sum())
            / (before.squares[k].sum() / before.sizes[k].sum())
            for k in keep
        ]
    )
    n = parts.size
    return whole, float(np.sqrt((n - 1) / n * np.sum((parts - parts.mean()) ** 2)))


def noise_floor(part: Part, frame: RateFrame) -> float:
    """Mean square of the moment coefficients' noise on a part."""
    flights, squares = frame.flight_of_row[part.rows], []
    for number, reconstruction in enumerate(frame.reconstructions):
        samples = part.samples[flights == number]
        usable = reconstruction.moments.usable[samples]
        squares.append(reconstruction.moments.noise_sigma[samples][usable] ** 2)
    return float(np.mean(np.concatenate(squares)))
