"""Data of a comparison's charts: coefficients over time with uncertainty, in-plane moments by size of model.

Coefficients come from the likelihood where it converged, else from the regression: a coefficient is f(x)' theta, its
variance f' M^-1 f, at the estimated motion. Where the curves of two sizes differ by much, the smaller model cannot be
believed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.identification import Identification, coefficient_histories
from brv_hypo.motion.kinematics import plane_from_body
from brv_hypo.motion.motion import recorded
from brv_hypo.ranking.result import CoefficientSeries, SizedModel, SizeSeries
from brv_hypo.regression.fit import HypothesisFit, likeliest, solved
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.reduced import Reduced
from brv_hypo.regression.search import on_grid
from brv_hypo.subset.criteria import Criteria

# Samples of a stretch of time up to which all are drawn.
MOST_DRAWN = 10_000


def drawn(samples: int) -> slice:
    """Which of so many samples are drawn: all of them, or every so many-th."""
    return slice(None, None, max(1, -(-samples // MOST_DRAWN)))


_STEP = 1e-4
"""Relative central difference of alpha."""


def coefficient_series(
    fits: Sequence[HypothesisFit], identified: Mapping[str, Identification]
) -> tuple[CoefficientSeries, ...]:
    """In-plane and out-of-plane moment and their derivatives by alpha (1/rad), of every segment of every flight.

    The likelihood gives the normal-force slope (1/rad) too. Names are those of `coefficient_histories`.
    """
    found: list[CoefficientSeries] = []
    for fit in fits:
        likelihood = identified.get(fit.name)
        if likelihood is not None and likelihood.converged:
            found += _by_likelihood(fit.name, likelihood)
        else:
            found += _by_regression(fit)
    return tuple(found)


def _by_likelihood(name: str, found: Identification) -> list[CoefficientSeries]:
    return [
        CoefficientSeries(
            mechanism=name,
            method="maximum likelihood",
            flight=history.flight,
            name=history.name,
            time_s=tuple(history.time[drawn(history.time.size)].tolist()),
            value=tuple(history.value[drawn(history.time.size)].tolist()),
            std_error=tuple(history.std_error[drawn(history.time.size)].tolist()),
        )
        for history in coefficient_histories(found)
    ]


def in_plane_parts(fit: HypothesisFit) -> tuple[FloatArray, FloatArray]:
    """C_N' at no angle of attack, as if it were linear in it, and its slope by alpha (1/rad): (rows,) each."""
    low, high = (_scaled(fit, scale) for scale in (1.0 - _STEP, 1.0 + _STEP))
    rise = _alpha(high) - _alpha(low)
    _, values, _ = fit.moment
    slope = (((_planes(fit, high) - _planes(fit, low)) @ values) / rise).real
    whole = (_planes(fit, fit.frame) @ values).real
    return np.asarray(whole - slope * _alpha(fit.frame)), np.asarray(slope)


def _by_regression(fit: HypothesisFit) -> list[CoefficientSeries]:
    planes, (_, values, covariance) = _planes(fit, fit.frame), fit.moment
    low, high = (_scaled(fit, scale) for scale in (1.0 - _STEP, 1.0 + _STEP))
    rise = _alpha(high) - _alpha(low)
    slopes = (_planes(fit, high) - _planes(fit, low)) / rise[:, None]
    rows = {"C_N'": planes.real, "C_Z'": planes.imag, "C_N' by alpha": slopes.real, "C_Z' by alpha": slopes.imag}
    found = []
    for segment, (a, b) in zip(fit.frame.segments, fit.frame.pieces, strict=True):
        shown = drawn(b - a)
        for name, whole in rows.items():
            f = whole[a:b][shown]
            variance = np.einsum("nj,jk,nk->n", f, covariance, f)
            found.append(
                CoefficientSeries(
                    mechanism=fit.name,
                    method="regression",
                    flight=segment.flight,
                    name=name,
                    time_s=tuple(segment.time[shown].tolist()),
                    value=tuple((f @ values).tolist()),
                    std_error=tuple(np.sqrt(np.maximum(variance, 0.0)).tolist()),
                )
            )
    return found


def _scaled(fit: HypothesisFit, scale: float) -> RateFrame:
    """The fit's frame with alpha times `scale`, now and in the past; meridian and rates held."""
    at_samples, at_nodes = (
        tuple(recorded(replace(motion, alpha=scale * motion.alpha, history=None)) for motion in motions)
        for motions in (fit.frame.motions, fit.frame.finer)
    )
    frame = replace(fit.frame, motions=at_samples, finer=at_nodes)
    return frame.with_in_plane_moment(fit.columns, fit.values)


def _planes(fit: HypothesisFit, frame: RateFrame) -> ComplexArray:
    """C_N' + i C_Z' (rows, columns) per unit of each coefficient."""
    meridian = np.concatenate([frame.motions[s.flight].windward_meridian[s.rows] for s in frame.segments])
    return plane_from_body(frame.moments(fit.moment[0]), meridian[:, None])


def _alpha(frame: RateFrame) -> FloatArray:
    return np.concatenate([frame.motions[s.flight].alpha[s.rows] for s in frame.segments])


# ---- The in-plane moment of models of several sizes over time: Figures 5.12 to 5.15 of the report ----


def by_size(problem: Problem, fits: Sequence[HypothesisFit], none: Criteria) -> dict[str, tuple[object, ...]]:
    """Of the likeliest hypothesis that has a mechanism, by its terms: `models_by_size`, and the `sizes` that are drawn.

    These are C_N' at no angle of attack and its slope by the baseline alone, by the best subsets on the grid of knots
    and delays with the fewest and the most terms that are searched exactly, and by the model that was chosen. `none`:
    criteria of the baseline alone, by which C_p has its variance.
    """
    searched = [fit for fit in fits if fit.mechanisms]
    if not searched:
        return {}
    leader = likeliest(searched)
    grid = on_grid(problem, leader.mechanisms, 1)
    reduced = Reduced(problem, grid.frame)
    models = [fit for fit in fits if not fit.mechanisms]
    for size in sorted({min(grid.best, default=0), max(grid.best, default=0)} - {0, len(leader.selected)}):
        columns = (*problem.baseline, *grid.best[size][0][1])
        models.append(solved(reduced, leader.name, leader.mechanisms, columns, leader.searched))
    n = problem.response.size
    forced = round(n * none.expected_variance / none.adjusted_rss)  # the baseline's p, by (b) and (f)
    variance = none.rss / (none.cp + n - 2 * forced)
    subsets = {0: (none.rss, ()), **{size: found[0] for size, found in sorted(grid.best.items())}}
    sized = (
        SizedModel(
            n_terms=size,
            n_coefficients=forced + size,
            rss=rss,
            cp=rss / variance - n + 2 * (forced + size),
            terms=tuple(column.label for column in columns),
        )
        for size, (rss, columns) in subsets.items()
    )
    drawn_sizes = (series for fit in (*models, leader) for series in _of(fit, fit is leader))
    return {"models_by_size": tuple(sized), "sizes": tuple(drawn_sizes)}


def _of(fit: HypothesisFit, chosen: bool) -> list[SizeSeries]:
    """One series for each flight."""
    at_zero, slope = in_plane_parts(fit)
    found = []
    for flight in dict.fromkeys(segment.flight for segment in fit.frame.segments):
        own = [
            (segment.time, slice(a, b))
            for segment, (a, b) in zip(fit.frame.segments, fit.frame.pieces, strict=True)
            if segment.flight == flight
        ]
        time, zero, rise = (
            np.concatenate([part[drawn(part.size)] for part in parts])
            for parts in zip(*((time, at_zero[rows], slope[rows]) for time, rows in own), strict=True)
        )
        found.append(
            SizeSeries(
                mechanism=fit.name,
                n_terms=len(fit.selected),
                chosen=chosen,
                flight=flight,
                time_s=tuple(time.tolist()),
                at_zero=tuple(zero.tolist()),
                slope=tuple(rise.tolist()),
            )
        )
    return found
