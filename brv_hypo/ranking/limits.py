"""How large each mechanism may still be: profile likelihood over its regions, delays and directions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from brv_hypo.arrays import FloatArray
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.model.columns import Column, Theta, theta_grid
from brv_hypo.model.time_variation import TimeFunction
from brv_hypo.ranking.constants import LIMIT_FALL
from brv_hypo.regression.fit import HypothesisFit
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.linear import lengths, solve_scaled
from brv_hypo.regression.problem import Problem

# Edges of the regions that are tried: every region between two of them.
_EDGES = 9
# Share of a column's squared length below which what the baseline leaves of it is rounding.
_SPENT = 1e-8


@dataclass(frozen=True)
class Limit:
    """The largest share of the moment's rms that a mechanism may have, at 95 %."""

    mechanism: str
    share_of_moment: float


@dataclass(frozen=True)
class _Shape:
    """One region and theta: `peak` 2 ln L that it gains, `estimate` (terms,), its information and moments' Gram."""

    peak: float
    estimate: FloatArray
    information: FloatArray
    gram: FloatArray

    def largest(self, allowed: float) -> float:
        """The largest rms moment within a fall of 2 ln L by `allowed` from the estimate."""
        size = math.sqrt(max(float(self.estimate @ self.gram @ self.estimate), 0.0))
        spread = float(np.asarray(eigh(self.gram, self.information, eigvals_only=True))[-1])
        return size + math.sqrt(max(allowed * spread, 0.0))


def limits(
    problem: Problem, mechanisms: Mapping[str, Sequence[Mechanism]], fits: Sequence[HypothesisFit]
) -> tuple[Limit, ...]:
    """A limit for every hypothesis; a joined one has the largest of its mechanisms, and none has none."""
    moment = _moment_rms(problem)
    variance = max(min(fit.rss for fit in fits) / problem.samples, 1.0) / problem.efficiency
    known: dict[str, float] = {}
    for group in mechanisms.values():
        for mechanism in group:
            if mechanism.name not in known:
                known[mechanism.name] = _limit(problem, mechanism, variance) / moment
    found = []
    for fit in fits:
        if fit.mechanisms:
            fitted = _share_of(fit) / moment
            found.append(Limit(fit.name, max(fitted, *(known[m.name] for m in fit.mechanisms))))
    return tuple(found)


def _share_of(fit: HypothesisFit) -> float:
    """Rms moment of what was fitted, and twice its standard error."""
    count = fit.baseline_size
    moments = fit.frame.moments(fit.selected)
    gram = np.real(np.conj(moments).T @ moments) / moments.shape[0]
    values, covariance = fit.values[count:], fit.covariance[count:, count:]
    size = float(np.sqrt(max(values @ gram @ values, 0.0)))
    gradient = gram @ values / max(size, 1e-300)
    return size + float(np.sqrt(LIMIT_FALL * max(gradient @ covariance @ gradient, 0.0)))


def _moment_rms(problem: Problem) -> float:
    """Rms of the moment coefficients that the baseline's fit flew."""
    frame = problem.frame
    moments = [frame.reconstructions[s.flight].moments for s in frame.segments]
    body = np.concatenate(
        [m.body[s.rows][m.usable[s.rows]] for m, s in zip(moments, frame.segments, strict=True)]
    )
    noise = np.concatenate(
        [m.noise_sigma[s.rows][m.usable[s.rows]] for m, s in zip(moments, frame.segments, strict=True)]
    )
    square = float(np.mean(np.abs(body) ** 2)) - 2.0 * float(np.mean(noise**2))
    return float(np.sqrt(max(square, 1e-4 * float(np.mean(np.abs(body) ** 2)))))


def _limit(problem: Problem, mechanism: Mechanism, variance: float) -> float:
    """The largest rms moment of one mechanism over the record."""
    frame = problem.frame.with_mechanisms([mechanism])
    if mechanism.parameters():
        values = solve_scaled(problem.design(frame, problem.baseline), problem.response)
        frame = frame.with_in_plane_moment(problem.baseline, values)
    base = problem.design(frame, problem.baseline)
    basis = np.linalg.qr(base / lengths(base))[0]
    left = problem.response - basis @ (basis.T @ problem.response)
    shapes = [
        shape
        for theta in theta_grid(mechanism, dense=True)
        for shape in _shapes(problem, frame, mechanism, theta, basis, left, variance)
    ]
    if not shapes:
        return float("inf")
    best = max(shape.peak for shape in shapes)
    allowed = [(shape, LIMIT_FALL - (best - shape.peak)) for shape in shapes]
    return max(shape.largest(room) for shape, room in allowed if room > 0.0)


def _shapes(
    problem: Problem,
    frame: RateFrame,
    mechanism: Mechanism,
    theta: Theta,
    basis: FloatArray,
    left: FloatArray,
    variance: float,
) -> list[_Shape]:
    """Every region between two edges, as differences of columns that start at them."""
    time = frame.time
    edges = np.linspace(time.min(), time.max(), _EDGES)[:-1]
    names = [(term.name, term.units) for term in mechanism.terms(frame.motions[0], dict(theta))]
    columns = [
        Column(mechanism.name, name, theta, TimeFunction("jump", float(edge)), units)
        for edge in edges
        for name, units in names
    ]
    raw, moments = problem.raw_design(frame, columns), frame.moments(columns)
    design = problem.rows.projected(raw)
    design = design - basis @ (basis.T @ design)
    terms = len(names)
    cut = [(design[:, k : k + terms], moments[:, k : k + terms]) for k in range(0, len(columns), terms)]
    cut.append((np.zeros_like(cut[0][0]), np.zeros_like(cut[0][1])))
    whole = [*(raw[:, k : k + terms] for k in range(0, len(columns), terms)), np.zeros_like(cut[0][0])]
    found = []
    for first in range(len(cut) - 1):
        for last in range(first + 1, len(cut)):
            rows = cut[first][0] - cut[last][0]
            body = cut[first][1] - cut[last][1]
            information = rows.T @ rows / variance
            scale = np.diag(information)
            squares = np.sum((whole[first] - whole[last]) ** 2, axis=0)
            if np.any(scale * variance <= _SPENT * squares) or np.linalg.cond(information / scale) > 1e10:
                continue
            estimate = np.asarray(np.linalg.solve(information, rows.T @ left / variance), dtype=float)
            peak = float(estimate @ information @ estimate)
            gram = np.real(np.conj(body).T @ body) / body.shape[0]
            found.append(_Shape(peak, estimate, information, gram))
    return found
