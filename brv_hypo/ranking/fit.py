"""Fits one hypothesis: the best subset of its columns, then delays and knots as continuous parameters."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.design.columns import Column, Theta, candidates, theta_grid
from brv_hypo.design.frame import RateFrame, whiten
from brv_hypo.design.whitening import NoiseModel
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.ranking.refine import Refinement, refine
from brv_hypo.subset import best_subsets


@dataclass(frozen=True)
class Task:
    """What all hypotheses of a comparison share: data, baseline columns, knots, noise and limits."""

    frame: RateFrame
    baseline: tuple[Column, ...]
    knots: FloatArray
    noise: NoiseModel
    efficiency: float
    """Effective over actual number of samples."""
    max_terms: int
    refine: bool

    @property
    def response(self) -> FloatArray:
        """Whitened derolled rates (2 rows,)."""
        return whiten(self.frame.observed[:, None], self.frame.pieces, self.noise)[:, 0]

    @property
    def samples(self) -> int:
        """Real residuals less the constants of integration that were projected out."""
        return 2 * (self.frame.observed.size - len(self.frame.pieces))

    def design(self, frame: RateFrame, columns: Sequence[Column]) -> FloatArray:
        """Whitened columns (2 rows, columns)."""
        return whiten(frame.columns(columns), frame.pieces, self.noise)


@dataclass(frozen=True)
class HypothesisFit:
    """A fitted hypothesis in the whitened frame.

    `columns` are the baseline's and then the selected ones; `values`, `covariance` belong to them. `residual`
    (2 rows,) is whitened; `searched` counts the candidates; `refinement` holds delays and knots with their errors.
    """

    name: str
    mechanisms: tuple[Mechanism, ...]
    frame: RateFrame
    columns: tuple[Column, ...]
    baseline_size: int
    values: FloatArray
    covariance: FloatArray
    residual: FloatArray
    rss: float
    samples: int
    efficiency: float
    searched: int
    refinement: Refinement

    @property
    def selected(self) -> tuple[Column, ...]:
        """The mechanism's columns."""
        return self.columns[self.baseline_size :]

    @property
    def parameters(self) -> int:
        """Linear coefficients and delays that were fitted."""
        return len(self.columns) + self.refinement.delays

    @property
    def effective(self) -> float:
        """Effective number of samples."""
        return self.samples * self.efficiency

    @property
    def information(self) -> float:
        """Extended BIC at the effective sample size (Chen and Chen 2008): what was searched is paid for."""
        return extended_bic(self.rss, self.samples, self.effective, self.parameters, self.searched,
                            len(self.selected))


def extended_bic(rss: float, samples: int, effective: float, parameters: int, searched: int, selected: int) -> float:
    """n_e ln(RSS / n) + k ln n_e + 2 ln C(searched, selected)."""
    choices = math.lgamma(searched + 1) - math.lgamma(selected + 1) - math.lgamma(max(searched - selected, 0) + 1)
    return effective * math.log(max(rss, 1e-300) / samples) + parameters * math.log(effective) + 2.0 * choices


def fit_hypothesis(task: Task, name: str, mechanisms: tuple[Mechanism, ...]) -> HypothesisFit:
    """Search, refine and fit one hypothesis; the empty tuple of mechanisms is the null hypothesis."""
    frame = task.frame.with_mechanisms(mechanisms)
    columns, searched = _search(task, frame, mechanisms)
    fit = _solve(task, frame, name, mechanisms, columns, searched)
    if any(mechanism.parameters() for mechanism in mechanisms):
        frame = frame.with_in_plane_moment(fit.columns, fit.values)
        fit = _solve(task, frame, name, mechanisms, fit.columns, searched)
    if task.refine and fit.selected:
        fit = _refined(task, fit)
    return fit


def refit(task: Task, fit: HypothesisFit) -> HypothesisFit:
    """The same columns fitted under the task's noise model."""
    frame = fit.frame
    if any(mechanism.parameters() for mechanism in fit.mechanisms):
        frame = frame.with_in_plane_moment(fit.columns, fit.values)
    renewed = _solve(task, frame, fit.name, fit.mechanisms, fit.columns, fit.searched)
    return _refined(task, renewed) if task.refine and renewed.selected else renewed


def _search(
    task: Task, frame: RateFrame, mechanisms: Sequence[Mechanism]
) -> tuple[tuple[Column, ...], int]:
    """The subset with the least extended BIC, over every theta of mechanisms that allow one theta at a time."""
    grids: list[list[tuple[Theta, ...]]] = [
        [theta_grid(m)] if m.several_parameters_at_once else [(theta,) for theta in theta_grid(m)] for m in mechanisms
    ]
    searched = sum(len(_columns_of(task, frame, m, theta_grid(m))) for m in mechanisms)
    forced = task.design(frame, task.baseline)
    response = task.response
    best: tuple[float, tuple[Column, ...]] | None = None
    for choice in itertools.product(*grids):
        offered = tuple(
            column for m, thetas in zip(mechanisms, choice, strict=True) for column in _columns_of(task, frame, m, thetas)
        )
        score, chosen = _best_subset(task, frame, forced, response, offered, searched)
        if best is None or score < best[0]:
            best = (score, chosen)
    assert best is not None
    return (*task.baseline, *best[1]), searched


def _columns_of(
    task: Task, frame: RateFrame, mechanism: Mechanism, thetas: Sequence[Theta]
) -> tuple[Column, ...]:
    own = mechanism.knots(frame.motions[0])
    terms = [(t.name, t.units) for t in mechanism.terms(frame.motions[0], dict(thetas[0]))]
    return candidates(mechanism, terms, task.knots if own is None else own, thetas)


def _best_subset(
    task: Task, frame: RateFrame, forced: FloatArray, response: FloatArray, offered: tuple[Column, ...], searched: int
) -> tuple[float, tuple[Column, ...]]:
    effective = task.samples * task.efficiency
    size = forced.shape[1]
    if not offered:
        rss = float(np.sum((response - forced @ np.linalg.lstsq(forced, response, rcond=None)[0]) ** 2))
        return extended_bic(rss, task.samples, effective, size, 0, 0), ()
    design = np.column_stack([forced, task.design(frame, offered)])
    groups: dict[tuple[str, int], list[int]] = {}
    for j, column in enumerate(offered):
        if column.group is not None:
            groups.setdefault((column.mechanism, column.group), []).append(size + j)
    result = best_subsets(
        design, response, max_terms=min(task.max_terms, len(offered)), forced=tuple(range(size)),
        groups=tuple(tuple(members) for members in groups.values()) or None,
    )
    scored = [
        (extended_bic(s.rss, task.samples, effective, size + len(s.columns), searched, len(s.columns)),
         tuple(offered[j - size] for j in s.columns))
        for s in result.subsets
    ]
    return min(scored, key=lambda pair: pair[0])


def _solve(
    task: Task, frame: RateFrame, name: str, mechanisms: tuple[Mechanism, ...], columns: tuple[Column, ...], searched: int
) -> HypothesisFit:
    design, response = task.design(frame, columns), task.response
    values, covariance, residual = least_squares(design, response, task.samples, task.efficiency)
    return HypothesisFit(
        name, mechanisms, frame, columns, len(task.baseline), values, covariance, residual,
        float(residual @ residual), task.samples, task.efficiency, searched, Refinement(),
    )


def least_squares(
    design: FloatArray, response: FloatArray, samples: int, efficiency: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Values (k,), covariance (k, k) at the effective sample size, residual (n,), with columns scaled for accuracy."""
    scale = np.linalg.norm(design, axis=0)
    scale[scale == 0.0] = 1.0
    left, singular, right = np.linalg.svd(design / scale, full_matrices=False)
    keep = singular > singular[0] * 1e-12
    inverse = np.where(keep, 1.0 / np.where(keep, singular, 1.0), 0.0)
    values = (right.T * inverse) @ (left.T @ response)
    residual = response - (design / scale) @ values
    variance = float(residual @ residual) / max(samples - int(keep.sum()), 1) / efficiency
    covariance = variance * (right.T * inverse**2) @ right
    return values / scale, covariance / np.outer(scale, scale), residual


def _refined(task: Task, fit: HypothesisFit) -> HypothesisFit:
    """Delays and knots moved to their best values; the covariance then carries their uncertainty too."""
    refinement = refine(
        fit.columns, fit.baseline_size, {m.name: m for m in fit.mechanisms}, task.knots,
        lambda columns: task.design(fit.frame, columns), task.response, task.samples, task.efficiency,
    )
    if refinement.columns is None:
        return fit
    return replace(
        fit, columns=refinement.columns, values=refinement.values, covariance=refinement.covariance,
        residual=refinement.residual, rss=float(refinement.residual @ refinement.residual), refinement=refinement,
    )
