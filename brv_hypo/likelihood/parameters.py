"""Names, start values, bounds and priors of the unknown parameters, and which segment each belongs to."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.errors import UsageError


@dataclass(frozen=True)
class Parameters:
    """The free parameters as one vector, in the order of `names`.

    A per-segment parameter `b` of two segments stands as `b[0]` and `b[1]`; the user's functions see `b`.
    """

    names: tuple[str, ...]
    start: FloatArray
    lower: FloatArray
    upper: FloatArray
    prior_mean: FloatArray
    prior_std: FloatArray
    base: tuple[str, ...]
    held: Mapping[str, float]
    segment_index: tuple[IntArray, ...]

    def of_segment(self, number: int, vector: FloatArray) -> dict[str, float]:
        """Name to value, held ones included, as the user's functions of one segment see them."""
        values = dict(self.held)
        values.update(zip(self.base, vector[self.segment_index[number]].tolist(), strict=True))
        return values

    @property
    def priors(self) -> dict[str, float]:
        """Standard deviation of the prior of those that have one, by the name that the user's functions see."""
        stds = self.prior_std[self.segment_index[0]].tolist()
        return {name: std for name, std in zip(self.base, stds, strict=True) if np.isfinite(std)}

    def spread(self, values: Mapping[str, float], rest: float) -> FloatArray:
        """One number a parameter, (p,), by the name that the user's functions see; `rest` for the others.

        Raises:
            UsageError: a name that theta0 does not have.
        """
        unknown = sorted(set(values) - {*self.base, *self.held})
        if unknown:
            raise UsageError(f"reach names {unknown}, which theta0 does not have; it has {sorted(self.base)}")
        out = np.full(len(self.names), rest)
        for index in self.segment_index:
            out[index] = [values.get(name, rest) for name in self.base]
        return out

    def as_mapping(self, vector: FloatArray) -> dict[str, float]:
        """Name to value, per-segment names expanded, held ones last."""
        return dict(zip(self.names, vector.tolist(), strict=True)) | dict(self.held)


def build_parameters(
    theta0: Mapping[str, float],
    n_segments: int,
    bounds: Mapping[str, tuple[float, float]],
    priors: Mapping[str, tuple[float, float]],
    fixed: Collection[str],
    per_segment: Collection[str],
) -> Parameters:
    """Lay the parameters out in one vector.

    Raises:
        UsageError: an unknown name, a bound or prior that makes no sense, a start outside its bounds, nothing
            free.
    """
    for what, given in (
        ("bounds", bounds),
        ("priors", priors),
        ("fixed", fixed),
        ("per_segment", per_segment),
    ):
        unknown = sorted(set(given) - set(theta0))
        if unknown:
            raise UsageError(f"{what} names {unknown}, which theta0 does not have; it has {sorted(theta0)}")
    if not theta0:
        raise UsageError("theta0 is empty: there is nothing to estimate; expected start values by name")
    base = tuple(name for name in theta0 if name not in fixed)
    if not base:
        raise UsageError(
            "every parameter of theta0 is held fixed: there is nothing to estimate; free at least one"
        )
    names: list[str] = []
    owner: list[str] = []
    index = np.zeros((n_segments, len(base)), dtype=np.int64)
    for column, name in enumerate(base):
        copies = n_segments if name in per_segment else 1
        index[:, column] = len(names) + (np.arange(n_segments) if copies > 1 else 0)
        names.extend(f"{name}[{s}]" for s in range(copies)) if name in per_segment else names.append(name)
        owner.extend([name] * copies)
    start = np.array([float(theta0[name]) for name in owner])
    lower, upper = (
        np.array([bounds.get(name, (-np.inf, np.inf))[side] for name in owner], float) for side in (0, 1)
    )
    prior = np.array([priors.get(name, (0.0, np.inf)) for name in owner], dtype=float)
    _check_values(names, start, lower, upper, prior)
    held = {name: float(theta0[name]) for name in theta0 if name in fixed}
    return Parameters(tuple(names), start, lower, upper, prior[:, 0], prior[:, 1], base, held, tuple(index))


def _check_values(
    names: list[str], start: FloatArray, lower: FloatArray, upper: FloatArray, prior: FloatArray
) -> None:
    for i, name in enumerate(names):
        if not np.isfinite(start[i]):
            raise UsageError(f"theta0[{name!r}] is {start[i]}; expected a finite start value")
        if not lower[i] < upper[i]:
            raise UsageError(
                f"bounds of {name!r} are ({lower[i]}, {upper[i]}); expected lower < upper. "
                "To hold it, use fixed"
            )
        if not lower[i] <= start[i] <= upper[i]:
            raise UsageError(
                f"theta0[{name!r}] = {start[i]} lies outside its bounds ({lower[i]}, {upper[i]}); "
                "move one of them"
            )
        if not prior[i, 1] > 0:
            raise UsageError(
                f"the prior of {name!r} has standard deviation {prior[i, 1]}; expected a positive one"
            )
