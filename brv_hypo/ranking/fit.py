"""Fits one hypothesis: the best subset of its columns, then delays and knots as continuous parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.design.columns import Column
from brv_hypo.design.frame import RateFrame
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.ranking.refine import Refinement, refine
from brv_hypo.ranking.search import best_by_size, extended, narrowed, offers
from brv_hypo.ranking.task import Task

# Sizes that may go by without a gain before the search over sizes ends.
PATIENCE = 2


@dataclass(frozen=True)
class HypothesisFit:
    """A fitted hypothesis in the whitened frame.

    `columns` are the baseline's and then the selected ones; `values`, `covariance` belong to them.
    `residual` (2 rows,) is whitened; `searched` counts the candidates; `refinement` holds delays and knots
    with their errors.
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
        return extended_bic(
            self.rss, self.samples, self.effective, self.parameters, self.searched, len(self.selected)
        )


def extended_bic(
    rss: float, samples: int, effective: float, parameters: int, searched: int, selected: int
) -> float:
    """n_e ln(RSS / n) + k ln n_e + 2 ln C(searched, selected)."""
    choices = (
        math.lgamma(searched + 1) - math.lgamma(selected + 1) - math.lgamma(max(searched - selected, 0) + 1)
    )
    return effective * math.log(max(rss, 1e-300) / samples) + parameters * math.log(effective) + 2.0 * choices


def fit_hypothesis(task: Task, name: str, mechanisms: tuple[Mechanism, ...]) -> HypothesisFit:
    """Search, refine and fit one hypothesis; the empty tuple of mechanisms is the null hypothesis.

    The best subset of each size on the grid of knots and delays is refined, and so is the best model so far
    with the best further term; the least extended BIC after refinement decides. A last search runs on the
    refined knots and delays alone. A hypothesis keeps at least one term.
    """
    frame = task.frame.with_mechanisms(mechanisms)
    if not mechanisms:
        return _solve(task, frame, name, (), task.baseline, 0)
    offered = offers(task, frame, mechanisms)
    searched = len({column for choice in offered for column in choice})

    def settle(chosen: tuple[Column, ...]) -> HypothesisFit:
        return _settled(task, frame, name, mechanisms, (*task.baseline, *chosen), searched)

    best: HypothesisFit | None = None
    worse = 0
    for chosen in best_by_size(task, frame, offered):
        further = None if best is None else extended(task, best.frame, best.columns, mechanisms, offered)
        challenger = _least([settle(start) for start in (chosen, further) if start])
        worse = 0 if best is None or challenger.information < best.information else worse + 1
        best = challenger if best is None else _least([best, challenger])
        if worse == PATIENCE:
            break
    assert best is not None
    return _least([best, *(settle(start) for start in narrowed(task, best.frame, best.columns))])


def _least(fits: list[HypothesisFit]) -> HypothesisFit:
    return min(fits, key=lambda fit: fit.information)


def _settled(
    task: Task,
    frame: RateFrame,
    name: str,
    mechanisms: tuple[Mechanism, ...],
    columns: tuple[Column, ...],
    searched: int,
) -> HypothesisFit:
    """Fitted, with C_mw brought up to date where the mechanism uses it, and refined."""
    fit = _solve(task, frame, name, mechanisms, columns, searched)
    if any(mechanism.parameters() for mechanism in mechanisms):
        frame = frame.with_in_plane_moment(fit.columns, fit.values)
        fit = _solve(task, frame, name, mechanisms, fit.columns, searched)
    return _refined(task, fit) if task.refine else fit


def refit(task: Task, fit: HypothesisFit) -> HypothesisFit:
    """The same columns fitted under the task's noise model."""
    return _settled(task, fit.frame, fit.name, fit.mechanisms, fit.columns, fit.searched)


def _solve(
    task: Task,
    frame: RateFrame,
    name: str,
    mechanisms: tuple[Mechanism, ...],
    columns: tuple[Column, ...],
    searched: int,
) -> HypothesisFit:
    design, response = task.design(frame, columns), task.response
    values, covariance, residual = least_squares(design, response, task.samples, task.efficiency)
    return HypothesisFit(
        name,
        mechanisms,
        frame,
        columns,
        len(task.baseline),
        values,
        covariance,
        residual,
        float(residual @ residual),
        task.samples,
        task.efficiency,
        searched,
        Refinement(),
    )


def least_squares(
    design: FloatArray, response: FloatArray, samples: int, efficiency: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Values (k,), covariance (k, k) at the effective sample size, residual (n,); scaled for accuracy."""
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
        fit.columns,
        fit.baseline_size,
        {m.name: m for m in fit.mechanisms},
        task.knots,
        lambda columns: task.design(fit.frame, columns),
        task.response,
        task.samples,
        task.efficiency,
    )
    if refinement.columns is None:
        return fit
    return replace(
        fit,
        columns=refinement.columns,
        values=refinement.values,
        covariance=refinement.covariance,
        residual=refinement.residual,
        rss=float(refinement.residual @ refinement.residual),
        refinement=refinement,
    )
