"""Marginal likelihood of a hypothesis, all that is linear integrated out, beside processes of estimated amplitude.

    y = X c + F f + Z a + e,   a ~ N(m, S^2),   c ~ N(0, t^2),   e ~ N(0, s^2)

y are the whitened rows of rates and force; X the columns that a search found for the hypothesis, with a prior of half
of the moment's rms; F the baseline and what no tolerance bounds (flat); Z the errors of record and vehicle within their
tolerances (S = 1) and the splines of each process (S the process's amplitude). Amplitudes and s are at the mode of

    2 log p = -n log s^2 - y' V^-1 y - log |V| + log prior(S, s),

found by L-BFGS with analytic derivatives; knots and delays pay 3 ln(n) / 2 and a constant (Zhang and Siegmund 2007).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from unittest.mock import patch

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import minimize

from brv_hypo import reconstruct
from brv_hypo.arrays import FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.model.term import Regressor, TimeBasis
from brv_hypo.ranking import CompareConfig, preparation
from brv_hypo.ranking.compare import _hypotheses
from brv_hypo.ranking.fitting import searched
from brv_hypo.regression.build import point_of
from brv_hypo.regression.fit import likeliest
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.own_static_moment import converged
from brv_hypo.regression.problem import Problem
from tests.studies.processes.shapes import COUNTS, EFFECTS, FAMILIES, moment_processes

# Log amplitudes have Gaussian priors: centre and 1-sigma, of processes of the record and of moments. Judgement.
RECORD_PRIOR, MOMENT_PRIOR = (np.log(0.1), 2.0), (np.log(0.01), 1.5)
NOISE_SPREAD = 0.1  # 1-sigma of the log of the noise over the record's
LARGEST, SMALLEST = np.log(3.0), np.log(1e-5)  # amplitudes
PRIOR_SHARE = 0.5  # of the moment's rms: 1-sigma of what one column of a mechanism makes
KNOT_PRICE, DELAY_PRICE = 1.5, 2.0  # nats: times ln n; each
BASELINE_PRIOR = 0.5  # probability of the baseline only; the mechanisms share the rest


@dataclass(frozen=True)
class Group:
    """Columns of Z that share an amplitude; `prior` None where that is one."""

    name: str
    columns: slice
    prior: tuple[float, float] | None


@dataclass(frozen=True)
class Rows:
    """Whitened rows with what is flat projected out."""

    frame: RateFrame
    problem: Problem
    y: FloatArray
    flat: FloatArray
    """Orthonormal columns of F, (n, rank)."""
    z: FloatArray
    groups: tuple[Group, ...]
    moment: float
    """rms of the static moment's coefficient."""

    def of(self, columns: Sequence[Regressor]) -> FloatArray:
        """The columns of moments as rows (n, columns)."""
        raw = self.problem.raw_design(self.frame, columns)[: self.y.size]
        return np.asarray(raw - self.flat @ (self.flat.T @ raw))


@dataclass(frozen=True)
class Answer:
    """Log evidence over that of the baseline only, and its amplitudes by process."""

    log_evidence: float
    amplitudes: Mapping[str, float]

    def by_family(self) -> dict[str, float]:
        """The largest amplitude in each family."""
        found: dict[str, float] = {}
        for name, value in self.amplitudes.items():
            found[FAMILIES[name]] = max(found.get(FAMILIES[name], 0.0), value)
        return found


def answers(flight: Flight, names: Sequence[str]) -> dict[str, Answer]:
    """Every hypothesis with processes beside it, linearised about the leader of today's search."""
    config = CompareConfig(mechanisms=tuple(names), maximum_likelihood="none")
    found = searched([reconstruct(flight)], config, _hypotheses(config), lambda message: None)
    leader = converged(found.problem, likeliest(found.fits))
    point = point_of(found.problem, leader.frame, leader.columns, leader.mechanisms)
    records = preparation.cleaned(found.problem, point, found.settings)
    if records is None:
        raise ValueError("no motion is left without the errors of the leader")
    tolerated = preparation.nuisance_effects
    with patch.object(preparation, "nuisance_effects", lambda: (*tolerated(), *EFFECTS)):
        problem = preparation._problem(
            [each.reconstruction for each in records], found.settings, config, point, [each.motion for each in records]
        )
    rows = rows_of(problem, [m for fit in found.fits for m in fit.mechanisms], (point.columns, point.values))
    nothing, quiet = maximised(rows, None, None)
    answer = {"none": Answer(0.0, _named(rows, quiet))}
    for fit in found.fits:
        columns = [c for c in fit.columns if c not in problem.baseline and c.mechanism == fit.name]
        if columns:
            level, at = maximised(rows, rows.of(columns), spreads(rows, columns))
            answer[fit.name] = Answer(level - nothing - price(rows, columns), _named(rows, at))
    return answer


def probabilities(answer: Mapping[str, Answer]) -> dict[str, float]:
    """Of the hypotheses: half of the prior is the baseline's, the others share the rest."""
    others = max(len(answer) - 1, 1)
    levels = {
        name: each.log_evidence + np.log(BASELINE_PRIOR if name == "none" else (1.0 - BASELINE_PRIOR) / others)
        for name, each in answer.items()
    }
    most = max(levels.values())
    shares = {name: float(np.exp(level - most)) for name, level in levels.items()}
    return {name: share / sum(shares.values()) for name, share in shares.items()}


def rows_of(problem: Problem, mechanisms: Sequence[Mechanism], model: tuple[Sequence[Regressor], FloatArray]) -> Rows:
    """The rows of a problem that holds the processes of the record among its nuisances."""
    known = problem.frame.with_mechanisms(mechanisms)
    moments = np.concatenate([np.ravel(each) for each in known.static_moments(*model)])
    size = float(np.sqrt(np.mean(moments**2)))
    processes = moment_processes(problem.frame.motions[0], size)
    frame = known.with_mechanisms(processes).with_in_plane_moment(*model)
    top, nuisances = 2 * problem.rows.rates, problem.rows.nuisances
    design, items = problem.rows.nuisance_design[:top], nuisances.items
    levels, bounded = design.shape[1] - len(items), set(nuisances.bounded.tolist())
    names = [effect.name for effect in EFFECTS]
    free = [k for k in range(len(items)) if k not in bounded]
    tolerated = [k for k in range(len(items)) if k in bounded and items[k].name not in names]
    parts = [design[:, [levels + k for k in tolerated]]]
    groups, mean = [Group("tolerances", slice(0, len(tolerated)), None)], [items[k].present for k in tolerated]
    for effect in EFFECTS:
        own = [k for k in range(len(items)) if items[k].name == effect.name]
        groups.append(Group(effect.name, slice(len(mean), len(mean) + len(own)), RECORD_PRIOR))
        parts.append(design[:, [levels + k for k in own]])
        mean += [items[k].present for k in own]
    for name, process in zip(COUNTS, processes, strict=True):
        terms = process.terms(frame.motions[0], {})
        columns = [Regressor(process.name, term.name, (), TimeBasis("constant"), "1") for term in terms]
        groups.append(Group(name, slice(len(mean), len(mean) + len(columns)), MOMENT_PRIOR))
        parts.append(problem.raw_design(frame, columns)[:top])
        mean += [0.0] * len(columns)
    z = np.concatenate(parts, axis=1)
    flat = np.concatenate(
        [design[:, :levels], design[:, [levels + k for k in free]], problem.raw_design(frame, problem.baseline)[:top]],
        1,
    )
    directions, sizes, _ = np.linalg.svd(flat / np.linalg.norm(flat, axis=0), full_matrices=False)
    basis = directions[:, sizes > 1e-10 * sizes[0]]
    y = problem.raw_response[:top] - z @ np.array(mean)
    projected = [each - basis @ (basis.T @ each) for each in (y, z)]
    return Rows(frame, problem, projected[0], basis, projected[1], tuple(groups), size)


def maximised(rows: Rows, x: FloatArray | None, spread: FloatArray | None) -> tuple[float, FloatArray]:
    """The largest log evidence from two starts (small amplitudes; their priors'), and where it is."""
    z = rows.z if x is None else np.concatenate([rows.z, x], axis=1)
    gram, right, square = z.T @ z, z.T @ rows.y, float(rows.y @ rows.y)
    groups, count, n = rows.groups[1:], z.shape[1], rows.y.size - rows.flat.shape[1]

    def cost(at: FloatArray) -> tuple[float, FloatArray]:
        scale, noise = np.ones(count), float(np.exp(2.0 * at[0]))
        for group, level in zip(groups, at[1:], strict=True):
            scale[group.columns] = np.exp(level)
        if spread is not None:
            scale[rows.z.shape[1] :] = spread
        inner = scale[:, np.newaxis] * gram * scale / noise
        inner[np.diag_indices(count)] += 1.0
        factor = cholesky(inner, lower=True, check_finite=False)
        forward = solve_triangular(factor, scale * right / noise, lower=True, check_finite=False)
        inverse = solve_triangular(factor, np.eye(count), lower=True, check_finite=False)
        mode, variance = inverse.T @ forward, (inverse**2).sum(axis=0)
        misfit = square / noise - forward @ forward
        value = 0.5 * misfit + n * at[0] + np.log(np.diag(factor)).sum() + 0.5 * (at[0] / NOISE_SPREAD) ** 2
        slope = np.empty_like(at)
        slope[0] = n - (count - variance.sum()) - (misfit - mode @ mode) + at[0] / NOISE_SPREAD**2
        for k, (group, level) in enumerate(zip(groups, at[1:], strict=True), start=1):
            centre, width = group.prior or (0.0, 1.0)
            own = group.columns
            value += 0.5 * ((level - centre) / width) ** 2
            slope[k] = own.stop - own.start - (mode[own] ** 2 + variance[own]).sum() + (level - centre) / width**2
        return float(value), slope

    bounds = [(-0.5, 1.0), *((SMALLEST, LARGEST) for _ in groups)]
    starts = ([np.log(1e-3)] * len(groups), [(group.prior or (0.0, 1.0))[0] for group in groups])
    ends = [
        minimize(cost, np.array([0.0, *start]), jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 60})
        for start in starts
    ]
    best = min(ends, key=lambda end: float(end.fun))
    return -float(best.fun), np.asarray(best.x)


def spreads(rows: Rows, columns: Sequence[Regressor]) -> FloatArray:
    """Prior 1-sigma of coefficients (columns,): each makes so large a share of the moment."""
    motion, found = rows.frame.finer[0], []
    for column in columns:
        terms = rows.frame.mechanisms[column.mechanism].terms(motion, dict(column.theta))
        term, course = next(t for t in terms if t.name == column.term), column.time_basis(motion.time)
        size = np.sqrt(np.mean((term.in_plane * course) ** 2 + (term.out_of_plane * course) ** 2))
        found.append(PRIOR_SHARE * rows.moment / max(float(size), 1e-12))
    return np.array(found)


def price(rows: Rows, columns: Sequence[Regressor]) -> float:
    """What knots and delays cost, nats."""
    edges = {edge for c in columns for edge in (c.time_basis.start, c.time_basis.stop) if np.isfinite(edge)}
    delays = {column.theta for column in columns if column.theta}
    return float(KNOT_PRICE * np.log(rows.y.size / 4.0) * len(edges) + DELAY_PRICE * len(delays))


def _named(rows: Rows, at: FloatArray) -> dict[str, float]:
    return {group.name: float(np.exp(level)) for group, level in zip(rows.groups[1:], at[1:], strict=True)}
