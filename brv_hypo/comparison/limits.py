"""How large each mechanism may still be beside leader and processes, over its regions, delays and directions."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh
from scipy.stats import chi2

from brv_hypo.arrays import BoolArray, FloatArray, IntArray
from brv_hypo.comparison.result import MechanismLimit
from brv_hypo.inference.evidence import Evidence
from brv_hypo.inference.fit import HypothesisFit
from brv_hypo.linearisation.frame import RateFrame
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.model.term import Regressor, Theta, TimeBasis, theta_grid

# Worked out on the seeds of `tests.studies.independent.study` that validation.md lists, and held by its fresh ones.
LIMIT_FALL = 3.84  # of 2 ln L: the upper end of a 95 % interval (chi-squared of one degree), and its quantile
LIMIT_QUANTILE = 0.975
LIMIT_LARGEST = 10.0  # rms moments above which nothing is known of a mechanism's size
LIMIT_PART = 0.25  # of the record, for which a mechanism acts whose coefficients are limited too
LIMIT_EDGES = 9  # of regions that are tried: every region between two of them
SECOND_EDGES = 21  # the same of a mechanism that may act beside the leader
SPENT = 1e-8  # of a column's squared length: below it what processes and the leader do not explain of it is rounding
_AT_ONCE = 200  # parts of regions that are made together; of more the pairs between thetas cost more than they save
_DRAWS, _SEED = 400, 20261127  # of coefficients, for what the leader's mechanism may be
_WORST_CONDITION = 1e10  # of a region's information, of unit columns, above which its terms cannot be distinguished
_SURELY = 3.0  # standard errors beyond a bound of 0, from which a region's sign is not possible


@dataclass(frozen=True)
class Shape:
    """One region and theta: `peak` 2 ln L that it gains, `estimate` (terms,), information, moments' Gram or None."""

    peak: float
    estimate: FloatArray
    information: FloatArray
    gram: FloatArray | None
    theta: Theta
    region: tuple[float, float]  # from where to where it acts, s
    width: float = 0.0  # s over which it comes on, about the first of these

    def largest(self, allowed: float) -> float:
        """The largest rms moment within a fall of 2 ln L by `allowed` from the estimate; none where that is nothing."""
        assert self.gram is not None
        if allowed <= 0.0:
            return 0.0
        size = math.sqrt(max(float(self.estimate @ self.gram @ self.estimate), 0.0))
        spread = float(np.asarray(eigh(self.gram, self.information, eigvals_only=True))[-1])
        return size + math.sqrt(max(allowed * spread, 0.0))


def limits(
    leader: HypothesisFit, evidence: Evidence, hypotheses: Mapping[str, Sequence[Mechanism]], weight: float
) -> tuple[MechanismLimit, ...]:
    """The share of the rms of the measured moment that each hypothesis may have at 95 %; a joined one that does not
    lead has that of its largest. The leader, and each of its mechanisms: as fitted, with its margin; another: beside
    the leader. A nat counts as `weight`. One far larger than the moment is withheld (NaN).
    """
    frame, moment = evidence.rows.frame_of(leader), evidence.rows.measured_moment
    own, whole_record = {mechanism.name for mechanism in leader.mechanisms}, np.ptp(frame.coefficient_time)
    of_leader = fitted_size(leader, evidence, weight, own) if own else (0.0, 0.0, 0.0)
    fitted = {"share_of_moment": of_leader[0] / moment, "share_std_error": of_leader[1] / moment}
    known, in_part, sizes = dict[str, float](), dict[str, float](), dict[str, dict[str, float]]()
    for mechanism in {each.name: each for group in hypotheses.values() for each in group}.values():
        if mechanism.name in own:
            one = {mechanism.name}
            of_it = of_leader if own == one else fitted_size(leader, evidence, weight, one)
            known[mechanism.name] = of_it[2] / moment
        else:
            (shapes,) = regions([evidence], frame, mechanism, even_edges(frame, LIMIT_EDGES))
            rooms = _rooms(shapes, weight)
            largest = list(map(Shape.largest, shapes, rooms))
            known[mechanism.name] = max(largest, default=float("inf")) / moment
            parts = [size for size, each in zip(largest, shapes, strict=True) if np.ptp(each.region) < whole_record]
            in_part[mechanism.name] = max(parts, default=float("inf")) / moment
            sizes[mechanism.name] = _coefficients(shapes, rooms, frame, mechanism)
    shares = {name: max(known[each.name] for each in group) for name, group in hypotheses.items() if group}
    shares |= {leader.name: of_leader[2] / moment} if leader.name in shares else {}
    return tuple(
        MechanismLimit(
            mechanism=name,
            share_of_moment_95=share,
            share_in_part_95=max((in_part[e.name] for e in hypotheses[name] if e.name in in_part), default=math.nan),
            coefficient_95=share * moment,
            **(fitted if name == leader.name else {}),
            coefficients_95={k: v for each in hypotheses[name] for k, v in sizes.get(each.name, {}).items()},
        )
        if share <= LIMIT_LARGEST
        else MechanismLimit(mechanism=name)
        for name, share in shares.items()
    )


class Second(NamedTuple):
    """A mechanism that may act beside the leader, where, and its gain beside small processes, nats as they count."""

    mechanism: Mechanism
    shape: Shape
    gain: float


def acting_beside(
    leader: HypothesisFit, evidence: Evidence, hypotheses: Mapping[str, Sequence[Mechanism]], weight: float
) -> Second | None:
    """The mechanism on the list that would gain most beside the leader were no process of the moment above its ordinary
    size: such processes may replace it. None where none is, and of a leader that is a sum, or the baseline only.
    """
    own, listed = {each.name for each in leader.mechanisms}, [{m.name for m in group} for group in hypotheses.values()]
    if len(own) != 1 or not evidence.has_processes_above(1.0):
        return None
    frame, small = evidence.rows.frame_of(leader), evidence.beside_small
    others = {m.name: m for group in hypotheses.values() for m in group if own | {m.name} not in listed}
    found = [
        Second(mechanism, shape, 0.5 * weight * shape.peak)
        for mechanism in others.values()
        for shape in regions([small], frame, mechanism, even_edges(frame, SECOND_EDGES), most=1)[0]
    ]
    return max(found, key=lambda each: each.gain, default=None)


def fitted_size(
    fit: HypothesisFit, evidence: Evidence, weight: float, mechanisms: Collection[str]
) -> tuple[float, float, float]:
    """The rms moment that what was fitted of some mechanisms has, its standard error, and what it has at most.
    Coefficients, delays and knots err together: where they make up for one another, as fraction and delay of a short
    lag do, the moment is known better than they are, so that their linear covariance counts, at least as the moment
    scatters over stretches of time; of a knot as far as its interval reaches. `weight`: of a nat.
    """
    frame, covariance = evidence.rows.frame_of(fit), evidence.covariance / weight
    first, values = fit.baseline_size, fit.values[fit.baseline_size :]
    columns = [frame.moments(fit.selected)]
    for parameter, error in zip(fit.nonlinear, fit.nonlinear_errors, strict=True):
        low, high = np.clip([parameter.value - error, parameter.value + error], *parameter.bounds).tolist()
        ends = [frame.moments(parameter.moved(fit.selected, end)) @ values for end in (low, high)]
        columns.append(((ends[1] - ends[0]) / max(high - low, 1e-300))[:, np.newaxis])
    at_mode, made = np.append(values, np.zeros(len(fit.nonlinear))), np.concatenate(columns, axis=1)
    owners = [*(column.mechanism for column in fit.selected), *(each.mechanism for each in fit.nonlinear)]
    made[:, [k for k, owner in enumerate(owners) if owner not in mechanisms]] = 0.0
    if fit.left_out is not None:
        slopes = (made.conj().T @ (made @ at_mode)).real  # of half the squares
        covariance = covariance * fit.left_out.scatter(np.append(np.zeros(first), slopes)[np.newaxis]) ** 2
    within, count = np.ones(covariance.shape[0]), covariance.shape[0] - len(fit.nonlinear)
    for k, (parameter, error) in enumerate(zip(fit.nonlinear, fit.nonlinear_errors, strict=True), start=count):
        if parameter.kind == "knot":
            within[k] = min(1.0, error / max(math.sqrt(covariance[k, k]), 1e-300))
    covariance = covariance * np.outer(within, within)
    rng = np.random.default_rng(_SEED)
    drawn = rng.multivariate_normal(at_mode, covariance[first:, first:], _DRAWS, method="svd")
    sizes = np.sqrt(np.mean(np.abs(made @ drawn.T) ** 2, axis=0))
    # An error of the pressure cancels, in N m and over the record's moment.
    inertia = max(max(record.flight.instruments.inertia) for record in evidence.rows.problem.records)
    sizes *= 1.0 + inertia * rng.standard_normal(_DRAWS)
    own = float(np.sqrt(np.mean(np.abs(made @ at_mode) ** 2)))
    return own, float(np.std(sizes)), float(np.quantile(sizes, LIMIT_QUANTILE))


def _rooms(shapes: Sequence[Shape], weight: float) -> list[float]:
    """By how much 2 ln L may fall from the estimate of each shape (shapes,): `LIMIT_FALL`, less by how much the best
    fits better than it, but for what the best of so many gains by chance (at 95 %); not below 0. `weight`: of a nat.
    The best region in noise alone fits better than others (Davies, Biometrika 74, 1987), so that a body-fixed moment
    that acts always, which trim takes up, seemed to be excluded.
    """
    best = max((shape.peak for shape in shapes), default=0.0)
    chance = float(chi2.isf(0.05 / len(shapes), shapes[0].estimate.size)) / weight if shapes else 0.0
    return [max(LIMIT_FALL / weight - max(best - each.peak - chance, 0.0), 0.0) for each in shapes]


def _coefficients(
    shapes: Sequence[Shape], rooms: Sequence[float], frame: RateFrame, mechanism: Mechanism
) -> dict[str, float]:
    """By term the largest size of its coefficient within the `rooms` of the shapes. Over those that last `LIMIT_PART`
    of the record at least, and not all of it, as baseline and trim do; empty of one with a delay.
    """
    whole = np.ptp(frame.coefficient_time)
    sizes = [
        np.abs(each.estimate) + np.sqrt(room * np.diag(np.linalg.inv(each.information)))
        for each, room in zip(shapes, rooms, strict=True)
        if room > 0.0 and LIMIT_PART * whole <= np.ptp(each.region) < whole
    ]
    if mechanism.parameters() or not sizes:
        return {}
    names = [term.name for term in mechanism.terms(frame.motions[0], {})]
    return dict(zip(names, np.max(sizes, axis=0).tolist(), strict=True))


def even_edges(frame: RateFrame, count: int) -> FloatArray:
    """So many times over the record (count,), s."""
    return np.linspace(frame.coefficient_time.min(), frame.coefficient_time.max(), count)


def regions(
    evidences: Sequence[Evidence],
    frame: RateFrame,
    mechanism: Mechanism,
    edges: FloatArray,
    widths: Sequence[int] = (0,),
    thetas: Sequence[Theta] = (),
    most: int | None = None,
) -> list[list[Shape]]:
    """Of each of some evidences of the same rows and terms every region between two edges, at every theta of a dense
    grid, or of those given; `most` of those at each that begin at once, and of those that come on over a time, which
    gain most, the best first; beside no other terms, without those of a sign that the mechanism cannot have. `widths`:
    over how many parts between neighbouring edges a region comes on; with more than 0 the edges are even.
    """
    acting, grid = frame.with_mechanisms([mechanism]), thetas or theta_grid(mechanism, dense=True)
    together = max(1, _AT_ONCE // (edges.size - 1))
    batches = [grid[first : first + together] for first in range(0, len(grid), together)]
    found = [_shapes(evidences, acting, mechanism, some, edges, tuple(widths), most) for some in batches]
    return [[shape for each in found for shape in each[k]] for k in range(len(evidences))]


@lru_cache(maxsize=8)
def _every_region(count: int, widths: tuple[int, ...]) -> tuple[IntArray, FloatArray]:
    """First and last edge and width (regions, 3) of regions, and how much of each part they hold (regions, count)."""
    ends = np.array(
        [
            (first, last, width)
            for width in widths
            for first in range(width // 2, count)
            for last in range(first + max(width // 2, 1), count + 1)
        ]
    )
    first, last, width = ends.T[:, :, np.newaxis]
    place = np.arange(count) + 0.5
    rise = np.where(width > 0, np.clip((place - first) / np.maximum(width, 1) + 0.5, 0.0, 1.0), place > first)
    return ends, rise * (place < last)


def _possible(mechanism: Mechanism, names: Sequence[str], estimate: FloatArray, information: FloatArray) -> BoolArray:
    """Which estimates (regions, terms) are not surely beyond a bound of 0, which no delay makes up for."""
    found = np.ones(len(estimate), dtype=bool)
    if mechanism.bounds and len(estimate):
        sigmas = np.sqrt(np.diagonal(np.linalg.inv(information), axis1=1, axis2=2))
        for k, name in enumerate(names):
            low, high = mechanism.bounds.get(name, (-np.inf, np.inf))
            sign = (low == 0.0) - (high == 0.0)
            found &= sign * estimate[:, k] > -_SURELY * sigmas[:, k]
    return found


def _shapes(
    evidences: Sequence[Evidence],
    frame: RateFrame,
    mechanism: Mechanism,
    thetas: Sequence[Theta],
    edges: FloatArray,
    widths: tuple[int, ...],
    most: int | None,
) -> list[list[Shape]]:
    """Of each evidence, all of the same terms, every region between two edges, made of the parts between neighbours."""
    names = [(term.name, term.units) for term in mechanism.terms(frame.motions[0], dict(thetas[0]))]
    stops = np.where(edges[1:] < frame.coefficient_time.max(), edges[1:], np.inf)
    bases = [TimeBasis("jump", *between) for between in zip(edges[:-1].tolist(), stops.tolist(), strict=True)]
    parts = [Regressor(mechanism.name, name, t, basis, unit) for t in thetas for basis in bases for name, unit in names]
    count, terms = len(bases), len(names)
    products = evidences[0].with_moments(evidences[0].rows.rates_of_moments(frame, parts))
    ends, every = _every_region(count, widths)
    part = float(np.min(np.diff(edges)))
    # Squares of the parts: of rounding the size is enough.
    squares = np.diag(products.across)[-len(parts) :].reshape(len(thetas), count, terms)
    moments = frame.moments(parts) if most is None else None

    def over_regions(of_parts: FloatArray, chosen: IntArray) -> FloatArray:
        """Scalar products of the parts as those of the terms over each of some regions (regions, terms, terms)."""
        pairs = of_parts.reshape(count, terms, count, terms).transpose(0, 2, 1, 3)
        summed = np.zeros((count + 1, count + 1, terms, terms))
        np.cumsum(np.cumsum(pairs, axis=0), axis=1, out=summed[1:, 1:])
        first, last, width = ends[chosen].T.astype(int)
        found: FloatArray = summed[last, last] - summed[first, last] - summed[last, first] + summed[first, first]
        if np.any(wide := width > 0):
            inside = every[chosen[wide]]
            shares = (inside @ pairs.reshape(count, -1)).reshape(-1, count, terms, terms)
            found[wide] = np.einsum("rp,rpab->rab", inside, shares)
        return found

    def of(number: int, of_parts: FloatArray, against_y: FloatArray) -> list[Shape]:
        """Of the theta with this number."""
        mine = slice(number * count * terms, (number + 1) * count * terms)
        information = over_regions(of_parts[mine, mine], np.arange(len(every)))
        right = every @ against_y[mine].reshape(count, terms)
        scale = np.diagonal(information, axis1=1, axis2=2)
        kept = np.flatnonzero(np.all(scale > SPENT * (every**2 @ squares[number]), axis=1))
        unit = information[kept] / np.sqrt(scale[kept, np.newaxis] * scale[kept, :, np.newaxis])
        sizes = np.linalg.eigvalsh(unit)
        kept = kept[sizes[:, 0] * _WORST_CONDITION >= sizes[:, -1]]
        estimate = np.asarray(np.linalg.solve(information[kept], right[kept][..., np.newaxis])[..., 0], dtype=float)
        peak = np.einsum("ra,rab,rb->r", estimate, information[kept], estimate)
        if most is not None and not evidences[0].terms.x.shape[1]:
            possible = _possible(mechanism, [name for name, _ in names], estimate, information[kept])
            kept, estimate, peak = kept[possible], estimate[possible], peak[possible]
        if most is not None:
            order = np.argsort(-peak, kind="stable")
            gradual = ends[kept[order], 2] > 0
            first = order[np.sort(np.concatenate([np.flatnonzero(gradual == kind)[:most] for kind in (False, True)]))]
            kept, estimate, peak = kept[first], estimate[first], peak[first]
        gram: Sequence[FloatArray | None] = [None] * kept.size
        if moments is not None:
            made = moments[:, mine]
            gram = list(over_regions(np.real(np.conj(made).T @ made) / made.shape[0], kept))
        regions, onsets = edges[ends[kept, :2].astype(int)].tolist(), (part * ends[kept, 2]).tolist()
        columns = zip(peak, estimate, kept, gram, regions, onsets, strict=True)
        return [
            Shape(float(gain), own, information[j], squared, thetas[number], (start, stop), onset)
            for gain, own, j, squared, (start, stop), onset in columns
        ]

    found = [evidence.projected(products) for evidence in evidences]
    return [[shape for number in range(len(thetas)) for shape in of(number, *each)] for each in found]
