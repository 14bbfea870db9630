"""How well the parameters are known: covariance, near-null directions, whiteness."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import FloatArray, IntArray

_NEAR_NULL = 1e-3
"""Singular value of column-scaled sensitivities, against the largest, of a near-null direction."""
_NULL = 1e-13
"""The same of a direction that is not seen at all: what is left is rounding."""
_TOUCHED = 1e-8
"""Square of a parameter's weight in such directions from which it is not determined."""
_NAMED = 0.1
"""Least weight with which a parameter is named in a near-null direction."""


@dataclass(frozen=True)
class NearNull:
    """A combination of parameters that the data hardly see.

    `weights` name the parameters, each scaled by its own information; `relative` is the singular value
    against the largest.
    """

    weights: dict[str, float]
    relative: float


@dataclass(frozen=True)
class Identifiability:
    """Condition of the column-scaled sensitivities, and what the data hardly see, worst first."""

    condition: float
    near_null: tuple[NearNull, ...]

    def __str__(self) -> str:
        if not self.near_null:
            return f"all parameters are seen by the data (condition {self.condition:.3g})"
        parts = [" ".join(f"{w:+.2f} {name}" for name, w in d.weights.items()) for d in self.near_null]
        return f"hardly seen by the data (condition {self.condition:.3g}): " + "; ".join(parts)


@dataclass(frozen=True)
class Whiteness:
    """Ljung-Box test of one output's innovations.

    Statistic on `lags` lags and its p-value; largest autocorrelation and its lag.
    """

    statistic: float
    p_value: float
    lags: int
    largest: float
    largest_lag: int

    @property
    def white(self) -> bool:
        """Whether whiteness stands at the 1 % level."""
        return self.p_value >= 0.01


def covariance_from_information(
    triangle: FloatArray, prior_std: FloatArray, estimated: IntArray
) -> FloatArray:
    """Inverse of the information matrix T'T plus priors, (p, p).

    nan for parameters not in `estimated` (at a bound), and for those alone that a direction moves which the
    data do not see.
    """
    p = prior_std.size
    system = np.concatenate([triangle, np.diag(1.0 / prior_std)])[:, estimated]
    covariance = np.full((p, p), np.nan)
    norm = np.linalg.norm(system, axis=0)
    _, singular, rotation = np.linalg.svd(system / np.where(norm > 0, norm, 1.0), full_matrices=False)
    kept = singular > _NULL * singular.max(initial=0.0)
    lost = 1.0 - np.sum(rotation[kept] ** 2, axis=0)
    seen = np.flatnonzero((norm > 0) & (lost < _TOUCHED))
    root = rotation[kept][:, seen].T / singular[kept]
    where = estimated[seen]
    covariance[np.ix_(where, where)] = root @ root.T / np.outer(norm[seen], norm[seen])
    return covariance


def identifiability(triangle: FloatArray, prior_std: FloatArray, names: Sequence[str]) -> Identifiability:
    """Near-null directions of the column-scaled sensitivities, by the names of their parameters."""
    system = np.concatenate([triangle, np.diag(1.0 / prior_std)])
    norm = np.linalg.norm(system, axis=0)
    _, singular, rotation = np.linalg.svd(system / np.where(norm > 0, norm, 1.0))
    relative = singular / singular[0] if singular[0] > 0 else np.zeros_like(singular)
    directions = []
    for value, direction in sorted(zip(relative, rotation, strict=True), key=lambda pair: float(pair[0])):
        if value < _NEAR_NULL:
            order = np.argsort(-np.abs(direction))
            weights = {names[i]: float(direction[i]) for i in order if abs(direction[i]) >= _NAMED}
            directions.append(NearNull(weights, float(value)))
    condition = float(1.0 / relative[-1]) if relative[-1] > 0 else float("inf")
    return Identifiability(condition, tuple(directions))


def whiteness(innovations: Sequence[FloatArray], lags: int) -> tuple[Whiteness, ...]:
    """Ljung-Box test for each output over all segments; `innovations` (n_outputs, n) each, nan in gaps."""
    from scipy.special import gammaincc

    tests = []
    for i in range(innovations[0].shape[0]):
        rows = [v[i] - np.nanmean(v[i]) if np.isfinite(v[i]).any() else np.zeros(0) for v in innovations]
        rows = [np.where(np.isfinite(row), row, 0.0) for row in rows]
        count = sum(int(np.count_nonzero(row)) for row in rows)
        power = sum(float(row @ row) for row in rows)
        products = [
            sum(float(row[: row.size - k] @ row[k:]) for row in rows if row.size > k)
            for k in range(1, lags + 1)
        ]
        r = np.array(products) / power if power > 0 else np.zeros(lags)
        statistic = float(count * (count + 2) * np.sum(r**2 / np.maximum(count - np.arange(1, lags + 1), 1)))
        worst = int(np.argmax(np.abs(r)))
        p_value = float(gammaincc(lags / 2, statistic / 2))
        tests.append(Whiteness(statistic, p_value, lags, float(r[worst]), worst + 1))
    return tuple(tests)
