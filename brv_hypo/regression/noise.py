"""The noise model that all hypotheses are judged by, and the degree of the baseline's drift."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.model.baseline import PitchDamping, StaticMoment
from brv_hypo.model.columns import Column, candidates, theta_grid
from brv_hypo.model.time_variation import TimeFunction
from brv_hypo.regression.frame import RateFrame, remove_levels, whiten
from brv_hypo.regression.linear import lengths, solve_scaled
from brv_hypo.regression.whitening import NoiseModel, difference, effective_samples, fit_noise


def baseline_columns(frame: RateFrame) -> tuple[Column, ...]:
    """The columns of the static moment and of pitch damping that the frame knows."""
    always = TimeFunction("constant")
    return tuple(
        Column(name, term.name, (), always, term.units)
        for name in (StaticMoment.name, PitchDamping.name)
        for term in frame.mechanisms[name].terms(frame.motions[0], {})
    )


def maximal_noise(
    frame: RateFrame, baseline: Sequence[Column], mechanisms: Sequence[Mechanism]
) -> NoiseModel:
    """Noise of what a deliberately rich model leaves: the baseline and all mechanisms, coarse knots."""
    frame = frame.with_mechanisms(mechanisms)
    time = frame.time
    coarse = np.linspace(time.min(), time.max(), 7)[1:-1]
    rich = list(baseline)
    for mechanism in mechanisms:
        middle = theta_grid(mechanism)[len(theta_grid(mechanism)) // 2]
        rich.extend(candidates(mechanism, frame.motions[0], coarse, (middle,)))
    rows = frame.columns(rich)
    noise = difference()
    for _ in range(3):
        noise = fit_noise(residual_rates(frame, rows, noise))
    return noise


def residual_rates(frame: RateFrame, rows: ComplexArray, noise: NoiseModel) -> list[ComplexArray]:
    """Derolled rates that the columns do not explain, one (m,) array a piece, rad/s."""
    design = whiten(rows, frame.pieces, noise)
    response = whiten(frame.observed[:, None], frame.pieces, noise)[:, 0]
    values = solve_scaled(design, response, 1e-10)
    return remove_levels(frame.observed - rows @ values, frame.pieces, noise)


def efficiency_of(residual: FloatArray, frame: RateFrame) -> float:
    """Effective over actual number of samples of a whitened residual (rows,), rows of priors left out."""
    half = frame.observed.size
    parts = [
        channel[a:b] for channel in (residual[:half], residual[half : 2 * half]) for a, b in frame.pieces
    ]
    return effective_samples(parts) / (2 * half)


def drift_degrees(
    frame: RateFrame, noise: NoiseModel, offset: int | None, slope: int | None, top: int = 4
) -> tuple[int, int]:
    """Legendre degrees of the drift of C_N0 and C_Nalpha with the least BIC, where they are not given."""
    static = frame.mechanisms[StaticMoment.name]
    assert isinstance(static, StaticMoment)
    response = whiten(frame.observed[:, None], frame.pieces, noise)[:, 0]
    rich = static.model_copy(
        update={"offset_degree": max(2, offset or 0), "slope_degree": max(top, slope or 0)}
    )
    wide = frame.with_mechanisms([rich])
    columns = baseline_columns(wide)
    design = whiten(wide.columns(columns), wide.pieces, noise)
    design /= lengths(design)
    scores = {}
    for i in range(3) if offset is None else (offset,):
        for j in range(top + 1) if slope is None else (slope,):
            wanted = {
                t.name
                for t in static.model_copy(update={"offset_degree": i, "slope_degree": j}).terms(
                    frame.motions[0], {}
                )
            }
            kept = [n for n, c in enumerate(columns) if c.mechanism != StaticMoment.name or c.term in wanted]
            values = np.linalg.lstsq(design[:, kept], response, rcond=1e-12)[0]
            rss = float(np.sum((response - design[:, kept] @ values) ** 2))
            scores[i, j] = response.size * np.log(rss) + len(kept) * np.log(response.size)
    return min(scores, key=lambda pair: scores[pair])
