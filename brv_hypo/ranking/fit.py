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
from brv_hypo.design.timebasis import TimeFunction
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
    """Search, refine and fit one hypothesis; the empty tuple of mechanisms is the null hypothesis.

    The best subset of each size on the grid of knots and delays is refined, and so is the best model so far
    with the best further term; the least extended BIC after refinement decides. A hypothesis keeps at least one term.
    """
    frame = task.frame.with_mechanisms(mechanisms)
    if not mechanisms:
        return _solve(task, frame, name, (), task.baseline, 0)
    offered = _offers(task, frame, mechanisms)
    searched = len({column for choice in offered for column in choice})
    best: HypothesisFit | None = None
    worse = 0
    for chosen in _best_by_size(task, frame, offered):
        starts = [chosen] if best is None else [chosen, _extended(task, best, offered)]
        tried = [_settled(task, frame, name, mechanisms, (*task.baseline, *start), searched) for start in starts if start]
        challenger = min(tried, key=lambda fit: fit.information)
        if best is None or challenger.information < best.information:
            best, worse = challenger, 0
        else:
            worse += 1
        if worse == 2:
            break
    assert best is not None
    return best


def _settled(
    task: Task, frame: RateFrame, name: str, mechanisms: tuple[Mechanism, ...], columns: tuple[Column, ...], searched: int
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


def _offers(task: Task, frame: RateFrame, mechanisms: Sequence[Mechanism]) -> list[tuple[Column, ...]]:
    """The columns on offer; one set for each theta of mechanisms that allow one theta at a time."""
    grids: list[list[tuple[Theta, ...]]] = [
        [theta_grid(m)] if m.several_parameters_at_once else [(theta,) for theta in theta_grid(m)] for m in mechanisms
    ]
    return [
        tuple(c for m, thetas in zip(mechanisms, choice, strict=True) for c in _columns_of(task, frame, m, thetas))
        for choice in itertools.product(*grids)
    ]


def _columns_of(
    task: Task, frame: RateFrame, mechanism: Mechanism, thetas: Sequence[Theta]
) -> tuple[Column, ...]:
    own = mechanism.knots(frame.motions[0])
    terms = [(t.name, t.units) for t in mechanism.terms(frame.motions[0], dict(thetas[0]))]
    return candidates(mechanism, terms, task.knots if own is None else own, thetas)


def _best_by_size(
    task: Task, frame: RateFrame, offered: Sequence[tuple[Column, ...]]
) -> list[tuple[Column, ...]]:
    """The subset of least RSS for each number of columns, over all offers; without the empty one."""
    best: dict[int, tuple[float, tuple[Column, ...]]] = {}
    forced = task.design(frame, task.baseline)
    for columns in offered:
        for rss, chosen in _subsets(task, frame, forced, columns, task.max_terms):
            if chosen and (len(chosen) not in best or rss < best[len(chosen)][0]):
                best[len(chosen)] = (rss, chosen)
    return [best[size][1] for size in sorted(best)]


def _extended(task: Task, fit: HypothesisFit, offered: Sequence[tuple[Column, ...]]) -> tuple[Column, ...] | None:
    """The fitted model's columns with the best further term of its own offer; None where it is full."""
    size = max((2 if c.tied else 1) for c in fit.selected)
    if len(fit.selected) + size > task.max_terms:
        return None
    forced = task.design(fit.frame, fit.columns)
    found = [
        (rss, chosen) for columns in _compatible(fit, offered)
        for rss, chosen in _subsets(task, fit.frame, forced, columns, size) if chosen
    ]
    if not found:
        return None
    return (*fit.selected, *min(found, key=lambda pair: pair[0])[1])


def _compatible(fit: HypothesisFit, offered: Sequence[tuple[Column, ...]]) -> list[tuple[Column, ...]]:
    """The offer with the theta that the fit uses, where its mechanism allows one theta at a time."""
    single = {m.name for m in fit.mechanisms if m.parameters() and not m.several_parameters_at_once}
    theta = {c.mechanism: c.theta for c in fit.selected if c.mechanism in single}
    renamed = [tuple(replace(c, theta=theta.get(c.mechanism, c.theta)) for c in columns) for columns in offered]
    return list(dict.fromkeys(renamed))


def _subsets(
    task: Task, frame: RateFrame, forced: FloatArray, offered: tuple[Column, ...], max_terms: int
) -> list[tuple[float, tuple[Column, ...]]]:
    """(RSS, columns) of the best subset of each size beside the forced columns."""
    size = forced.shape[1]
    vectors: dict[tuple[str, Theta, TimeFunction], list[int]] = {}
    for j, column in enumerate(offered):
        if column.tied:
            vectors.setdefault(column.vector, []).append(size + j)
    result = best_subsets(
        np.column_stack([forced, task.design(frame, offered)]), task.response,
        max_terms=min(max_terms, len(offered)), forced=tuple(range(size)),
        groups=tuple(tuple(members) for members in vectors.values()) or None,
    )
    return [(s.rss, tuple(offered[j - size] for j in s.columns)) for s in result.subsets]


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
