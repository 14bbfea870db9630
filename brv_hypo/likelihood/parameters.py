"""Names, start values, bounds and priors of the unknown parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError


@dataclass(frozen=True)
class Parameters:
    """The free parameters as one vector, (p,), in the order of `names`."""

    names: tuple[str, ...]
    """Names of the free parameters."""
    start: FloatArray
    """Start values, (p,)."""
    lower: FloatArray
    """Lower bounds, (p,), -infinity where there is none."""
    upper: FloatArray
    """Upper bounds, (p,)."""
    prior_mean: FloatArray
    """Means of the priors, (p,)."""
    prior_std: FloatArray
    """Standard deviations of the priors, (p,), infinity where there is none."""
    held: Mapping[str, float]
    """Values of the parameters that are held, by name."""

    def as_mapping(self, vector: FloatArray) -> dict[str, float]:
        """Name to value, held ones last, as the user's functions see them."""
        return dict(zip(self.names, vector.tolist(), strict=True)) | dict(self.held)

    def spread(self, values: Mapping[str, float], rest: float) -> FloatArray:
        """One number a parameter, (p,), `rest` for those that are not named.

        Raises:
            UsageError: a name that theta0 does not have.
        """
        unknown = sorted(set(values) - {*self.names, *self.held})
        if unknown:
            raise UsageError(f"reach names {unknown}, which theta0 does not have; it has {sorted(self.names)}")
        return np.array([values.get(name, rest) for name in self.names], dtype=float)


def build_parameters(
    theta0: Mapping[str, float], bounds: Mapping[str, tuple[float, float]], priors: Mapping[str, tuple[float, float]]
) -> Parameters:
    """Lay the parameters out in one vector; those of equal bounds are held.

    Raises:
        UsageError: an unknown name, a bound or prior that makes no sense, a start outside its bounds, nothing
            free.
    """
    for what, given in (("bounds", bounds), ("priors", priors)):
        unknown = sorted(set(given) - set(theta0))
        if unknown:
            raise UsageError(f"{what} names {unknown}, which theta0 does not have; it has {sorted(theta0)}")
    if not theta0:
        raise UsageError("theta0 is empty: there is nothing to estimate; expected start values by name")
    limits = {name: bounds.get(name, (-np.inf, np.inf)) for name in theta0}
    for name, (lower, upper) in limits.items():
        mean, std = priors.get(name, (0.0, np.inf))
        value = float(theta0[name])
        if not np.isfinite(value):
            raise UsageError(f"theta0[{name!r}] is {value}; expected a finite start value")
        if not lower <= upper:
            raise UsageError(f"bounds of {name!r} are ({lower}, {upper}); expected lower <= upper, equal to hold it")
        if not lower <= value <= upper:
            raise UsageError(f"theta0[{name!r}] = {value} lies outside its bounds ({lower}, {upper}); move one of them")
        if not std > 0:
            raise UsageError(
                f"the prior of {name!r} has mean {mean} and standard deviation {std}; expected a positive one"
            )
    names = tuple(name for name, (lower, upper) in limits.items() if lower < upper)
    if not names:
        raise UsageError("every parameter of theta0 is held by its bounds: there is nothing to estimate; free one")
    lower, upper = np.array([limits[name] for name in names], dtype=float).T
    prior = np.array([priors.get(name, (0.0, np.inf)) for name in names], dtype=float)
    return Parameters(
        names=names,
        start=np.array([float(theta0[name]) for name in names]),
        lower=lower,
        upper=upper,
        prior_mean=prior[:, 0],
        prior_std=prior[:, 1],
        held={name: float(theta0[name]) for name in theta0 if name not in names},
    )
