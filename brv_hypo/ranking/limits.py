"""How large each mechanism may still be: profile likelihood over its regions, delays and directions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.constants import LIMIT_EDGES, LIMIT_FALL
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.model.term import Regressor, Theta, TimeBasis, theta_grid
from brv_hypo.regression.fit import HypothesisFit, likeliest
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.reduced import Reduced

# Share of a column's squared length below which what the baseline leaves of it is rounding.
_SPENT = 1e-8
# Condition number of a region's scaled information above which its terms cannot be told apart.
_WORST_CONDITION = 1e10


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
    """A limit for every hypothesis; a joined one has the largest of its mechanisms, and none has none.

    The moment of which it is a share is the leader's: what was measured holds errors of instruments and axes.
    """
    leader = likeliest(fits)
    columns, values, _ = leader.moment
    moment = _rms(leader.frame.moments(columns) @ values)
    variance = max(min(fit.rss for fit in fits) / problem.samples, 1.0) / problem.efficiency
    known: dict[str, float] = {}
    for group in mechanisms.values():
        for mechanism in group:
            if mechanism.name not in known:
                known[mechanism.name] = _limit(problem, mechanism, variance) / moment
    found = []
    for fit in fits:
        if fit.mechanisms:
            size, margin = _fitted(fit)
            # What is not seen the regions tell, and more than the whole moment could only cancel against the baseline.
            seen = (fit is leader or size > margin) and size <= moment
            fitted = min((size + margin) / moment, 1.0) if seen else 0.0
            found.append(Limit(fit.name, max(fitted, *(known[m.name] for m in fit.mechanisms))))
    return tuple(found)


def _fitted(fit: HypothesisFit) -> tuple[float, float]:
    """The rms moment of what was fitted, and by how much more it may be at 95 %.

    Coefficients, delays and knots err together: where they make up for one another, as fraction and delay of a short
    lag do, the moment is known better than they are.
    """
    count = fit.baseline_size
    values = fit.values[count:]
    moments = fit.frame.moments(fit.selected)
    size = _rms(moments @ values)
    gradient = np.concatenate(
        [np.real(np.conj(moments).T @ (moments @ values)) / (moments.shape[0] * max(size, 1e-300)), _slopes(fit)]
    )
    variance = float(gradient @ fit.joint_covariance[count:, count:] @ gradient)
    return size, math.sqrt(LIMIT_FALL * max(variance, 0.0))


def _slopes(fit: HypothesisFit) -> FloatArray:
    """Derivatives of the rms moment by each delay and knot (nonlinear,), across one standard error of it."""
    out = []
    for parameter, error in zip(fit.nonlinear, fit.nonlinear_errors, strict=True):
        low, high = np.clip([parameter.value - error, parameter.value + error], *parameter.bounds)
        ends = [
            _rms(fit.frame.moments(moved[fit.baseline_size :]) @ fit.values[fit.baseline_size :])
            for moved in (parameter.moved(fit.columns, float(low)), parameter.moved(fit.columns, float(high)))
        ]
        out.append((ends[1] - ends[0]) / (high - low) if high > low else 0.0)
    return np.array(out)


def _rms(moments: ComplexArray) -> float:
    return float(np.sqrt(np.mean(np.abs(moments) ** 2)))


def _limit(problem: Problem, mechanism: Mechanism, variance: float) -> float:
    """The largest rms moment of one mechanism over the record."""
    reduced = Reduced(problem, problem.frame.with_mechanisms([mechanism]))
    if mechanism.parameters():
        frame = reduced.frame.with_in_plane_moment(problem.baseline, reduced.baseline_values)
        reduced = Reduced(problem, frame)
    shapes = [
        shape for theta in theta_grid(mechanism, dense=True) for shape in _shapes(reduced, mechanism, theta, variance)
    ]
    if not shapes:
        return float("inf")
    best = max(shape.peak for shape in shapes)
    allowed = [(shape, LIMIT_FALL - (best - shape.peak)) for shape in shapes]
    return max(shape.largest(room) for shape, room in allowed if room > 0.0)


def _shapes(reduced: Reduced, mechanism: Mechanism, theta: Theta, variance: float) -> list[_Shape]:
    """Every region between two edges, made of the parts between neighbouring ones."""
    frame = reduced.frame
    edges = np.linspace(frame.coefficient_time.min(), frame.coefficient_time.max(), LIMIT_EDGES)
    names = [(term.name, term.units) for term in mechanism.terms(frame.motions[0], dict(theta))]
    parts = [
        Regressor(mechanism.name, name, theta, TimeBasis("jump", float(start), float(stop)), units)
        for start, stop in zip(edges[:-1], [*edges[1:-1], np.inf], strict=True)
        for name, units in names
    ]
    batch, moments = reduced.batch(parts), frame.moments(parts)
    count, terms = edges.size - 1, len(names)
    held = np.array(
        [(np.arange(count) >= a) & (np.arange(count) < b) for a in range(count) for b in range(a + 1, count + 1)],
        dtype=float,
    )

    def over_regions(products: FloatArray) -> FloatArray:
        """Scalar products of the parts as those of the terms over each region (regions, terms, terms)."""
        first = (held @ products.reshape(count, -1)).reshape(-1, terms, count, terms)
        return np.asarray(np.sum(first * held[:, np.newaxis, :, np.newaxis], axis=2), dtype=float)

    information = over_regions(batch.products(batch)) / variance
    before = np.diagonal(over_regions(batch.rows.T @ batch.rows), axis1=1, axis2=2)
    gram = over_regions(np.real(np.conj(moments).T @ moments) / moments.shape[0])
    right = held @ reduced.right(batch).reshape(count, terms) / variance
    scale = np.diagonal(information, axis1=1, axis2=2)
    seen = np.flatnonzero(np.all(scale * variance > _SPENT * before, axis=1))
    seen = seen[np.linalg.cond(information[seen] / scale[seen, np.newaxis]) <= _WORST_CONDITION]
    estimate = np.linalg.solve(information[seen], right[seen][..., np.newaxis])[..., 0]
    peak = np.einsum("ra,rab,rb->r", estimate, information[seen], estimate)
    return [_Shape(float(peak[k]), estimate[k], information[region], gram[region]) for k, region in enumerate(seen)]
