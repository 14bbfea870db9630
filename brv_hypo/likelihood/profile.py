"""Intervals by profile likelihood: right where the likelihood is not a parabola, as standard errors assume.

The parameter is held at a value, everything else fitted again, noise included; an end of the interval is where the
log-likelihood has dropped by half the chi-square quantile of one degree of freedom. The signed root of the drop is
nearly linear in the parameter, so that a few fits find the end.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from brv_hypo.errors import UsageError
from brv_hypo.likelihood.result import FitResult

_CLOSE = 0.01
"""Distance of the root of the drop from its target, in standard errors, at which an end is found."""
_FITS = 12
"""Fits that the search for one end may take."""
_FARTHEST = 30.0
"""Standard errors at which an end that was not found is called infinite."""


class Refit(Protocol):
    """Fits again from start values, with some parameters held: a call of `fit` with all else as it was."""

    def __call__(self, theta0: Mapping[str, float], fixed: Collection[str]) -> FitResult:
        """The fit."""
        ...


@dataclass(frozen=True)
class ProfileInterval:
    """An interval of one parameter; `points` are (value, drop of the log-likelihood) of every fit, by value.

    An end is infinite where the likelihood does not drop enough however far the parameter goes, nan where the fits
    there did not converge.
    """

    name: str
    level: float
    lower: float
    upper: float
    points: tuple[tuple[float, float], ...]


def profile_interval(refit: Refit, result: FitResult, name: str, level: float = 0.95) -> ProfileInterval:
    """The interval of a free parameter at which `refit` loses too much likelihood against `result`.

    Raises:
        UsageError: a parameter that is not free or has no standard error, a level outside (0, 1).
    """
    if name not in result.names or not np.isfinite(result.std_error[name]):
        known = [each for each in result.names if np.isfinite(result.std_error[each])]
        raise UsageError(
            f"{name!r} has no standard error to start a profile from; expected one of {known}. A per-segment parameter "
            "cannot be held in one segment alone"
        )
    if not 0.0 < level < 1.0:
        raise UsageError(f"level is {level}; expected a number between 0 and 1, such as 0.95")
    from scipy.special import ndtri

    root = float(ndtri(0.5 + level / 2.0))
    points = {result.theta[name]: 0.0}
    lower, upper = (_end(refit, result, name, side, root, points) for side in (-1.0, 1.0))
    return ProfileInterval(name, level, lower, upper, tuple(sorted(points.items())))


def _end(
    refit: Refit, result: FitResult, name: str, side: float, root: float, points: dict[float, float]
) -> float:
    """Where the root of twice the drop reaches `root`: secant steps, kept between a point inside and one outside."""
    sigma = result.std_error[name]
    start = dict(result.theta)
    inside, outside = (0.0, 0.0), (np.inf, np.inf)
    away = root
    for _ in range(_FITS):
        value = result.theta[name] + side * away * sigma
        held = refit({key: start[key] for key in result.theta} | {name: value}, (name,))
        if not held.converged:
            return float("nan")
        drop = max(result.log_likelihood - held.log_likelihood, 0.0)
        points[value] = drop
        start = dict(held.theta)
        reached = float(np.sqrt(2.0 * drop))
        if abs(reached - root) < _CLOSE:
            return value
        if reached < root:
            inside = (away, reached)
        else:
            outside = (away, reached)
        if not np.isfinite(outside[0]):
            if away >= _FARTHEST:
                return side * np.inf
            away = min(max(1.5 * away, away * min(root / max(reached, 1e-3), 4.0)), _FARTHEST)
        else:
            share = (root - inside[1]) / (outside[1] - inside[1])
            away = inside[0] + float(np.clip(share, 0.1, 0.9)) * (outside[0] - inside[0])
    return float("nan")
