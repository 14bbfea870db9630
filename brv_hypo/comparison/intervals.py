"""What a mechanism comes to in each interval between its knots: net values, in time order."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.comparison.result import NetInterval, TermEstimate
from brv_hypo.inference.derivatives import COLLINEAR
from brv_hypo.inference.fit import HypothesisFit
from brv_hypo.linearisation.frame import RateFrame
from brv_hypo.mechanisms.contract import Derived
from brv_hypo.model.common_time import at
from brv_hypo.model.term import Regressor, Theta, evaluated

SEARCH_SAME_THETA = 0.1  # relative difference up to which two values are one, found twice (refined at two knots)
# Errors of second order in values: of the squares of errors (in tolerances) that the data imply of record and vehicle,
# and of the square of a coefficient, 7 % of itself. Not set by flights: it only keeps names from being refused.
SECOND_ORDER_VALUES = 5e-3
INFLATED = 10.0  # variance inflation: Belsley, Kuh and Welsch, 1980, 3.2; convention


def estimate(name: str, mechanism: str, value: float, sigma: float, units: str, **where: Any) -> TermEstimate:
    """An estimate; `where`: its channel, region and delay."""
    f_ratio = (value / sigma) ** 2 if sigma > 0 else float("nan")
    known = {"name": name, "mechanism": mechanism, "value": value, "std_error": sigma, "units": units}
    return TermEstimate.model_validate({**known, "f_ratio": f_ratio, **where})


def channel_of(column: Regressor, frame: RateFrame) -> str:
    """In which plane the column acts."""
    (term,) = evaluated([column], frame.mechanisms, frame.motions[column.flight or 0])
    inside, outside = bool(np.any(term.in_plane)), bool(np.any(term.out_of_plane))
    return "both" if inside and outside else "out-of-plane" if outside else "in-plane"


def collinear_pairs(covariance: FloatArray) -> dict[frozenset[int], tuple[int, int, str]]:
    """Coefficients with a correlation above `COLLINEAR`, or a variance inflation above `INFLATED`: each with that which
    it is most correlated with, and in words their correlation (variance inflations).
    """
    if not covariance.size:
        return {}
    sigma = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlation = covariance / np.outer(sigma, sigma)
    inflation = np.diag(np.linalg.pinv(correlation, hermitian=True))
    others = correlation - np.diag(np.diag(correlation))
    return {
        frozenset((j, k)): (j, k, f"{others[j, k]:.3f} ({inflation[j]:.3g}, {inflation[k]:.3g})")
        for j, k in enumerate(np.argmax(np.abs(others), axis=1).tolist())
        if inflation[j] > INFLATED or abs(others[j, k]) > COLLINEAR
    }


def collinear_groups(names: Sequence[str], covariance: FloatArray) -> tuple[tuple[str, ...], ...]:
    """Names of coefficients that are nearly collinear with each other, those that pairs link together."""
    groups: list[frozenset[int]] = []
    for pair in collinear_pairs(covariance):
        linked = [group for group in groups if group & pair]
        groups = [*(group for group in groups if group not in linked), pair.union(*linked)]
    return tuple(tuple(names[j] for j in sorted(group)) for group in groups)


def intervals(fit: HypothesisFit) -> tuple[NetInterval, ...]:
    """Net values of a fit's selected columns by interval, and what follows from them; ramps at the middle of theirs."""
    if not fit.selected:
        return ()
    time = fit.frame.coefficient_time
    begin, end = float(time.min()), float(time.max())
    inner = {float(edge) for c in fit.selected for edge in (c.time_basis.start, c.time_basis.stop)}
    edges = [begin, *sorted(edge for edge in inner if begin < edge < end), end]
    return tuple(_interval(fit, first, last) for first, last in itertools.pairwise(edges))


def _interval(fit: HypothesisFit, start: float, stop: float) -> NetInterval:
    middle = np.array([0.5 * (start + stop)])
    weights = np.array([float(column.time_basis(middle)[0]) for column in fit.selected])
    groups: dict[tuple[str, Theta, str], list[int]] = {}
    for j, column in enumerate(fit.selected):
        if weights[j] != 0.0 and fit.acts(j, start):
            groups.setdefault((column.mechanism, _first_like(fit.selected, column), column.term), []).append(j)
    first, count = fit.baseline_size, len(fit.selected)
    rows = np.zeros((len(groups), first + count + len(fit.nonlinear)))
    for i, members in enumerate(groups.values()):
        rows[i, first + np.array(members)] = weights[members]
    values = rows[:, : first + count] @ fit.values
    for k, parameter in enumerate(fit.nonlinear, start=first + count):
        if parameter.kind == "width":  # what came on over it is a rate times it, and known better than either
            mine = first + np.array(parameter.columns)
            rows[:, k] = rows[:, mine] @ fit.values[mine] / parameter.value
    covariance = fit.covariance_of(rows)
    region = (start, stop)
    sigmas = np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist()
    found = []
    for ((mechanism, _, term), members), value, sigma in zip(groups.items(), values.tolist(), sigmas, strict=True):
        column = fit.selected[members[0]]
        where = {"channel": channel_of(column, fit.frame), "region_s": region, "delay_s": column.delay}
        # A ramp's value at an instant has no `per second`.
        units = column.units.removesuffix("/s") if column.time_basis.kind == "ramp" else column.units
        found.append(estimate(term, mechanism, value, sigma, units, **where))
    used = {place for members in groups.values() for place in members}
    delays = [k for k, each in enumerate(fit.nonlinear) if each.kind == "theta" and used & set(each.columns)]
    together = fit.covariance_of(np.concatenate([rows, np.eye(rows.shape[1])[[first + count + k for k in delays]]]))
    names = [*(each.name for each in found), *(fit.nonlinear[k].name for k in delays)]
    collinear = collinear_groups(names, together)
    for name, d in _derived(fit, list(groups), values, covariance):
        found.append(estimate(d.name, name, d.value, d.std_error, d.units, channel="both", region_s=region))
    return NetInterval(start_s=start, stop_s=stop, values=tuple(found), collinear_groups=collinear)


def _first_like(columns: Sequence[Regressor], column: Regressor) -> Theta:
    """The theta of the first of the mechanism's columns that this one's is the same as."""
    return next(
        other.theta
        for other in columns
        if other.mechanism == column.mechanism
        and [name for name, _ in other.theta] == [name for name, _ in column.theta]
        and all(
            abs(a - b) <= SEARCH_SAME_THETA * max(abs(a), abs(b))
            for (_, a), (_, b) in zip(other.theta, column.theta, strict=True)
        )
    )


def _derived(
    fit: HypothesisFit, keys: Sequence[tuple[str, Theta, str]], values: FloatArray, covariance: FloatArray
) -> list[tuple[str, Derived]]:
    """What mechanisms whose terms are one vector derive from its net components."""
    found = []
    for mechanism in fit.mechanisms:
        theta = next((column.theta for column in fit.selected if column.mechanism == mechanism.name), None)
        if theta is None:  # of a joined hypothesis that needs none of its terms
            continue
        names = [term.name for term in mechanism.terms(fit.frame.motions[0], dict(theta))]
        for theta in dict.fromkeys(key[1] for key in keys if key[0] == mechanism.name):
            place = [i for i, key in enumerate(keys) if key[:2] == (mechanism.name, theta)]
            if [keys[i][2] for i in place] != names or not mechanism.terms_enter_together:
                continue
            net = {keys[i][2]: float(values[i]) for i in place}
            found += [(mechanism.name, d) for d in mechanism.derived(net, covariance[np.ix_(place, place)])]
    return found


@dataclass(frozen=True)
class Excess:
    """The net value farthest outside its mechanism's bounds, in words, and by how many standard errors."""

    mechanism: str
    sigmas: float
    words: str


def out_of_bounds(fit: HypothesisFit) -> Excess | None:
    """The net value farthest outside its mechanism's bounds; None where all lie within them. Beyond a bound of 0 the
    error is that with delays where they are: a delay may make up for a size, not for a sign.
    """
    bounds, common = {m.name: m.bounds for m in fit.mechanisms}, fit.frame.common
    if not any(bounds.values()):
        return None
    found: list[Excess] = []
    every, fixed = ([(each, net) for each in intervals(f) for net in each.values] for f in (fit, _delays_fixed(fit)))
    for (interval, net), (_, there) in zip(every, fixed, strict=True):
        low, high = bounds[net.mechanism].get(net.name, (-np.inf, np.inf))
        similar = [o.value for _, o in every if (o.mechanism, o.name) == (net.mechanism, net.name)]
        largest = float(np.max(np.abs(np.clip(similar, low, high))))  # that is possible, for errors of second order
        bound = low if net.value < low else high
        sigma = there.std_error if bound == 0.0 else net.std_error
        error = np.hypot(sigma, np.sqrt(SECOND_ORDER_VALUES) * max(abs(net.value), largest))
        beyond = max(low - net.value, net.value - high, 0.0) / max(error, 1e-300)
        begin = f"{interval.start_s:.2f}" if common is None else at(common, interval.start_s)
        where = f"from {begin} to {at(common, interval.stop_s)}, where {low:g} to {high:g} is possible"
        found.append(Excess(net.mechanism, float(beyond), f"{net.name} = {net.value:.3g} {where}"))
    worst = max(found, key=lambda excess: excess.sigmas, default=None)
    return worst if worst is not None and worst.sigmas > 0.0 else None


def _delays_fixed(fit: HypothesisFit) -> HypothesisFit:
    """The fit with the errors that it has where delays, and what else terms depend on, are known."""
    first, joint = fit.values.size, fit.joint_covariance
    free = [first + k for k, parameter in enumerate(fit.nonlinear) if parameter.kind == "theta"]
    if not free or not joint.size:
        return fit
    known = joint[:, free] @ np.linalg.pinv(joint[np.ix_(free, free)], hermitian=True) @ joint[free]
    return replace(fit, joint_covariance=joint - known)


def within_bounds(fit: HypothesisFit) -> HypothesisFit:
    """The fit with what its likelihood loses where values that no body has are fixed at their bounds. The square of the
    excess in standard errors: the fall of 2 ln L for one linear coefficient.
    """
    excess = out_of_bounds(fit)
    return fit if excess is None else replace(fit, bound_cost=excess.sigmas**2)
