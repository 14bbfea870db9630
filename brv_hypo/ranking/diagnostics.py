"""What the leader says beside its coefficients: errors, collinearity, residual, the moment as functions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.inference.derivatives import along_flights, damping, slope, value
from brv_hypo.inference.evidence import Evidence
from brv_hypo.model.term import Regressor
from brv_hypo.ranking.judgement import Judged
from brv_hypo.ranking.result import Comparison, RecordError, SizedModel
from brv_hypo.ranking.summary import drawn
from brv_hypo.regression.fit import HypothesisFit, likeliest
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.search import on_grid
from brv_hypo.subset.criteria import Criteria

_CHANNELS = ("q", "r", "ay", "az")  # in the order of the rows of a residual
INFLATED, COLLINEAR = 10.0, 0.9  # convention: Belsley, Kuh and Welsch, Regression Diagnostics, 1980, 3.2


def diagnostics(judged: Judged, found: Comparison) -> dict[str, Any]:
    """Fields of a comparison: what is known of its leader, and how each hypothesis predicts what was held out."""
    own, fit = judged.evidences[judged.leader], judged.fits[judged.leader]
    gains = {each.name: _held_out(judged, k) for k, each in enumerate(judged.fits)}
    functions, frame = {"C_m0": value, "C_malpha": slope, "C_mq": damping}, own.rows.frame_of(fit)
    return {
        "ranking": tuple(row.model_copy(update=gains[row.mechanism]) for row in found.ranking),
        "record_errors": record_errors(own, judged.weight),
        "collinear": collinear(fit.columns, fit.covariance),
        "functions": {
            name: along_flights(own, fit.columns, frame, by, judged.weight) for name, by in functions.items()
        },
        "series": tuple(each.model_copy(update=_channels(judged, k)) for k, each in enumerate(found.series)),
    }


def _held_out(judged: Judged, place: int) -> dict[str, float]:
    """The gain over the baseline only on stretches of time given the others, and its standard error over these."""
    gains = judged.weight * (judged.evidences[place].held_out - judged.evidences[judged.null].held_out)
    error = float(np.sqrt(gains.size * np.var(gains, ddof=1))) if gains.size > 1 else float("nan")
    return {"held_out_gain": float(np.sum(gains)), "held_out_gain_std_error": error}


def record_errors(own: Evidence, weight: float = 1.0) -> tuple[RecordError, ...]:
    """Errors within stated tolerances, the largest in tolerances first; `weight`: what a nat counts."""
    items, values = own.rows.problem.rows.nuisances.items, own.errors.tolist()
    sigmas = np.minimum(own.error_sigmas / np.sqrt(weight), 1.0).tolist()
    several = len(own.rows.blocks) > 1
    found = [
        RecordError(
            name=items[k].plain_label + (f", flight {flight + 1}" if several else ""),
            value=items[k].whole(values[k]),
            std_error=items[k].size * sigmas[k],
            units=items[k].units,
            tolerance=items[k].size,
        )
        for flight, block in enumerate(own.rows.blocks)
        for k in block.items
        if items[k].stated
    ]
    return tuple(sorted(found, key=lambda each: -abs(each.tolerances)))


def collinear(columns: Sequence[Regressor], covariance: FloatArray) -> tuple[str, ...]:
    """Pairs of coefficients with a correlation above `COLLINEAR`, or one with a variance inflation above `INFLATED`."""
    sigma = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlation = covariance / np.outer(sigma, sigma)
    inflation = np.diag(np.linalg.pinv(correlation, hermitian=True))
    others = correlation - np.diag(np.diag(correlation))
    starts = [each.time_basis.start for each in columns]
    labels = [
        each.label + (f" at {at:.2f} s" if np.isfinite(at) else "") for each, at in zip(columns, starts, strict=True)
    ]
    pairs = {
        frozenset((j, k)): f"{labels[j]}, {labels[k]}: {others[j, k]:.3f} ({inflation[j]:.3g}, {inflation[k]:.3g})"
        for j, k in enumerate(np.argmax(np.abs(others), axis=1).tolist())
        if inflation[j] > INFLATED or abs(others[j, k]) > COLLINEAR
    }
    return tuple(pairs.values())


def best_by_size(problem: Problem, fits: Sequence[HypothesisFit], none: Criteria) -> tuple[SizedModel, ...]:
    """The best subsets, on the grid of knots and delays, of the likeliest hypothesis that has a mechanism.

    `none`: criteria of the baseline alone, by which C_p has its variance.
    """
    searched = [fit for fit in fits if fit.mechanisms]
    if not searched:
        return ()
    best, n = on_grid(problem, likeliest(searched).mechanisms, 1).best, problem.response.size
    forced = round(n * none.expected_variance / none.adjusted_rss)  # the baseline's p, by (b) and (f)
    variance = none.rss / (none.cp + n - 2 * forced)
    sized = [(0, none.rss, ()), *((size, *found[0]) for size, found in sorted(best.items()))]
    return tuple(
        SizedModel(n_terms=size, n_coefficients=p, cp=rss / variance - n + 2 * p, terms=tuple(c.label for c in columns))
        for size, rss, columns in sized
        for p in (forced + size,)
    )


def _channels(judged: Judged, flight: int) -> dict[str, Any]:
    """Histories of one flight for `Series`: measured and modelled rates and forces, and the residual at unit noise."""
    own, fit, problem = judged.evidences[judged.leader], judged.fits[judged.leader], judged.problem
    frame, rest = problem.frame, problem.left(fit.frame, fit.columns, *problem.solution(fit.frame, fit.columns))
    found: list[FloatArray] = []  # a segment each: dynamic pressure, then every channel as measured and as modelled
    for segment, (a, b) in zip(frame.segments, frame.pieces, strict=True):
        if segment.flight == flight:
            turn = np.exp(-1j * problem.records[flight].spin_angle[segment.rows])
            rates, force = frame.observed[a:b] * turn, problem.force[a:b]
            modelled = (rates - (rest.rates[a:b] - np.mean(rest.rates[a:b])) * turn, force - rest.force[a:b])
            pairs = zip((rates, force), modelled, strict=True)
            parts = [part(each) for pair in pairs for part in (np.real, np.imag) for each in pair]
            pressure = frame.motions[flight].dynamic_pressure[segment.rows]
            found.append(np.stack([pressure, *parts])[:, drawn(b - a)])
    air, *histories = (tuple(each) for each in np.concatenate(found, axis=1).tolist())
    return {
        "dynamic_pressure_pa": air,
        "channels": dict(zip(_CHANNELS, zip(histories[::2], histories[1::2], strict=True), strict=True)),
        "whitened": whitened(own, flight),
    }


def whitened(own: Evidence, flight: int) -> dict[str, tuple[float, ...]]:
    """The residual beside all processes at unit noise, by channel, in axes that do not roll."""
    rows = own.rows.blocks[flight].rows
    residual, counted = (each[rows].reshape(len(_CHANNELS), -1) for each in (own.residual, own.rows.counted))
    parts = (residual[:, counted[0]] / own.noise).tolist()
    return {name: tuple(part) for name, part in zip(_CHANNELS, parts, strict=True)}
