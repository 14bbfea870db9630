"""What was observed and what may explain it, as rows at unit noise.

    y = U b + X c + Z a + e

y   derolled rates and transverse force, whitened
U   what all flights share: the baseline, and moments within the vehicle's tolerances
X   terms of a hypothesis, and what its knots and delays move
Z   of each flight: the splines of every process
e   noise of unit variance

What a flight has without a prior (constants of integration, normal force) is projected out of all of these. Errors of
record and vehicle within their tolerances, T with a prior of 1, are noise here: rows are whitened by (1 + T T')^-1/2.
Rows of different flights have b and c alone in common, so that T and Z are blocks, one a flight.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import helmert

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from brv_hypo.inference.fit import HypothesisFit
from brv_hypo.inference.problem import Problem
from brv_hypo.inference.refinement import prediction_slopes
from brv_hypo.linearisation.frame import RateFrame, residual_moments
from brv_hypo.linearisation.linear import orthonormal
from brv_hypo.mechanisms.contract import Mechanism, MomentProcess, rms_of_shapes, span_of
from brv_hypo.mechanisms.registry import moment_processes, record_processes
from brv_hypo.model.term import Regressor
from brv_hypo.thresholds import ALWAYS, EVENTS_APART, MOMENT_AMPLITUDE, RECORD_AMPLITUDE

SETTLING = 8  # samples
NOTHING = 1e-6  # of what the prior of a coefficient has: less than any noise shows
TIME_BLOCKS = 12  # of a record, each left out in turn
_UNIFORM = 12.0**-0.5  # standard deviation of a uniform distribution, of its width


@dataclass(frozen=True)
class ProcessGroup:
    """Columns of Z that share an amplitude."""

    name: str
    family: str
    units: str  # of the history that the columns make
    of_moment: bool  # else of record or air
    size: float  # one unit of the amplitude, in `units`
    prior: tuple[float, float]  # centre and 1-sigma of the logarithm of the amplitude


@dataclass(frozen=True)
class Block:
    """One flight: its `rows` among all (m,), Z there (m, columns), and the columns of each group. `raw` is Z before
    whitening; `own` (m, rank) are orthonormal columns of what is projected out; `errors` (m, rank) are directions that
    errors within tolerances make, and `shrunk` (rank,) what whitening leaves of each; `estimates` (errors, rank) makes
    those errors, in tolerances, of what a model does not explain along each, and `items` says which nuisances they are.
    """

    rows: IntArray
    z: FloatArray
    columns: tuple[slice, ...]
    raw: FloatArray
    own: FloatArray
    errors: FloatArray
    shrunk: FloatArray
    estimates: FloatArray
    items: tuple[int, ...]

    @classmethod
    def of(cls, rows: IntArray, use: BoolArray, parts: list[FloatArray], free: FloatArray, within: FloatArray) -> Block:
        """Of those rows that count, `use` (m, 1), the columns of each group, and of nuisances that are free and within
        tolerances (m, k); which these are is not known here.
        """
        ends, raw = np.cumsum([part.shape[1] for part in parts]).tolist(), np.concatenate(parts, axis=1)
        columns = tuple(slice(end - part.shape[1], end) for end, part in zip(ends, parts, strict=True))
        own, _ = orthonormal(use * free)
        within = use * within
        directions, sizes, right = np.linalg.svd(within - own @ (own.T @ within), full_matrices=False)
        shrunk = 1.0 / np.sqrt(1.0 + sizes**2)
        block = cls(rows, raw, columns, raw, own, directions, shrunk, right.T * (sizes * shrunk), ())
        return replace(block, z=block.whitened(use * raw))

    @cached_property
    def errors_in_z(self) -> FloatArray:
        """Scalar products of Z with the directions of errors (columns, rank)."""
        return np.asarray(self.z.T @ self.errors)

    @cached_property
    def _directions(self) -> tuple[FloatArray, FloatArray]:
        """Those of both kinds (m, rank), orthonormal, and how much of each whitening takes away (rank, 1)."""
        share = np.concatenate([np.ones(self.own.shape[1]), 1.0 - self.shrunk])
        return np.concatenate([self.own, self.errors], axis=1), share[:, np.newaxis]

    def whitened(self, rows: FloatArray) -> FloatArray:
        """Rows of the flight (m, columns), where errors within tolerances are noise, less what has no prior."""
        directions, share = self._directions
        return np.asarray(rows - directions @ (share * (directions.T @ rows)))


class OfFlight(NamedTuple):
    """Scalar products on some rows of one flight: Z'Z, Z'[U X] and Z'y; `chosen` are the rows."""

    own: FloatArray
    with_border: FloatArray
    with_y: FloatArray
    chosen: IntArray


class Products(NamedTuple):
    """Scalar products of `rows` rows that the likelihood needs: y'y, [U X]'[U X], [U X]'y, and of each flight."""

    rows: int
    square: float
    across: FloatArray
    right: FloatArray
    flights: Mapping[int, OfFlight]

    @classmethod
    def of(cls, rows: Rows, use: BoolArray, count: int) -> Products:
        """Of some rows (n,) without a hypothesis; flights that have none of them are left out."""
        y, shared, flights = rows.y[use], rows.shared[use], {}
        for number, block in enumerate(rows.blocks):
            chosen = np.flatnonzero(use[block.rows])
            if chosen.size:
                z, those = _of(block.z, chosen), block.rows[chosen]
                flights[number] = OfFlight(z.T @ z, z.T @ rows.shared[those], z.T @ rows.y[those], chosen)
        return cls(count, float(y @ y), shared.T @ shared, shared.T @ y, flights)

    def beside(self, rows: Rows, x: FloatArray) -> Products:
        """With columns of a hypothesis (n, k)."""
        across, right, flights = np.zeros((x.shape[1], rows.shared.shape[1])), np.zeros(x.shape[1]), {}
        own = np.zeros((x.shape[1], x.shape[1]))
        for number, known in self.flights.items():
            block = rows.blocks[number]
            those = block.rows[known.chosen]
            columns = _of(x, those)
            across += columns.T @ _of(rows.shared, those)
            right += columns.T @ rows.y[those]
            own += columns.T @ columns
            flights[number] = _of(block.z, known.chosen).T @ columns
        return self._with(across, own, right, flights)

    def beside_moments(self, rows: Rows, x: FloatArray, rates: FloatArray) -> Products:
        """Of all rows and the columns x (n, j) of a hypothesis, with further moments as the rates that they make
        (rate rows, k): Z and what is whitened already take the whitening of those upon themselves.
        """
        white = np.column_stack([rows.shared, x, rows.y])
        across, own, flights = np.zeros((rates.shape[1], white.shape[1])), np.zeros((rates.shape[1],) * 2), {}
        for number, block in enumerate(rows.blocks):
            half, those = block.rows.size // 2, block.rows
            part, beside = _of(rates, those[:half]), _of(white, those)
            free, inside = block.own[:half].T @ part, block.errors[:half].T @ part
            removed = (1.0 - block.shrunk)[:, np.newaxis] * inside
            own += part.T @ part - free.T @ free - (inside + block.shrunk[:, np.newaxis] * inside).T @ removed
            across += part.T @ beside[:half] - removed.T @ (block.errors.T @ beside)
            flights[number] = block.z[:half].T @ part - block.errors_in_z @ removed
        return self._with(across[:, :-1], own, across[:, -1], flights)

    def _with(
        self, across: FloatArray, own: FloatArray, right: FloatArray, of_flights: Mapping[int, FloatArray]
    ) -> Products:
        """With further columns, by their products with those that it has, themselves, y and Z of each flight."""
        flights = {
            number: known._replace(with_border=np.concatenate([known.with_border, of_flights[number]], axis=1))
            for number, known in self.flights.items()
        }
        whole = np.block([[self.across, across.T], [across, own]])
        return Products(self.rows, self.square, whole, np.append(self.right, right), flights)

    def less(self, other: Products) -> Products:
        """Of all rows but those of `other`, and of the flights that it has."""
        flights = {}
        for number, (own, border, y, chosen) in other.flights.items():
            mine = self.flights[number]
            flights[number] = OfFlight(mine.own - own, mine.with_border - border, mine.with_y - y, chosen)
        across, right = self.across - other.across, self.right - other.right
        return Products(self.rows - other.rows, self.square - other.square, across, right, flights)


def _of(rows: FloatArray, chosen: IntArray) -> FloatArray:
    """Those chosen, in their order; no copy where they are all."""
    return rows if chosen.size == rows.shape[0] else rows[chosen]


@dataclass(frozen=True)
class Terms:
    """X of a hypothesis (n, k): selected terms, what knots and delays move, last what each flight's knots do."""

    x: FloatArray
    spread: FloatArray  # prior 1-sigma (k,) of each coefficient, of terms at a mechanism's amplitude of 1
    scaled: BoolArray  # which of them (k,) the mechanism's amplitude multiplies: the terms
    prior: float = 0.0  # log probability of these terms before the data
    apart: int = 0
    """How many columns are contrasts between the flights' own knots, knot by knot: nuisances of the hypothesis."""
    coefficients: FloatArray | None = None
    """What makes the coefficients of the terms of those of X (terms, terms), where X has what remains after a region in
    the place of its last change: nothing, of a mechanism that ends. None where X has the terms themselves.
    """

    @property
    def known(self) -> int:
        """How many columns belong to coefficients, knots and delays that all flights share."""
        return int(self.spread.size) - self.apart

    @property
    def acting(self) -> BoolArray:
        """Which columns (k,) are terms that may be something."""
        if self.coefficients is None:
            return self.scaled
        count = self.coefficients.shape[0]
        alone = np.all(self.coefficients == np.eye(count), axis=1)
        return np.append(alone, np.zeros(self.spread.size - count, dtype=bool))

    def only(self, places: list[int]) -> Terms:
        """Some of the columns that all flights share."""
        x, spread, scaled = self.x[:, places], self.spread[places], self.scaled[places]
        return replace(self, x=x, spread=spread, scaled=scaled, apart=0)

    def beside(self, other: Terms) -> Terms:
        """With further columns."""
        spread, scaled = np.append(self.spread, other.spread), np.append(self.scaled, other.scaled)
        prior = self.prior + other.prior
        return Terms(np.concatenate([self.x, other.x], axis=1), spread, scaled, prior)


@dataclass(frozen=True)
class Rows:
    """The rows that all hypotheses have in common."""

    problem: Problem
    frame: RateFrame
    y: FloatArray  # (n,)
    shared: FloatArray  # U (n, columns): orthonormal columns of the baseline, then what the vehicle's tolerances allow
    spread: FloatArray  # prior 1-sigma of the columns of U: infinite of the baseline
    coefficients: FloatArray  # what makes the baseline's coefficients of those of U (baseline columns, its rank)
    blocks: tuple[Block, ...]
    groups: tuple[ProcessGroup, ...]
    modelled: ComplexArray  # moment coefficients (frame rows,) at the linearisation point
    static: float  # what that moment makes of the rows before whitening, as a length
    counted: BoolArray
    """Which rows (n,) count: not the first of a record, where the filters of instruments have transients."""
    noise_ratio: float = 1.0  # their noise over that measured in the record

    @property
    def size(self) -> int:
        """Rows that count less what was projected out of them."""
        return int(np.sum(self.counted)) - sum(int(block.own.shape[1]) for block in self.blocks)

    def whitened(self, raw: FloatArray) -> FloatArray:
        """Rows (n, columns) at unit noise: what has no prior is projected out, errors within tolerances are noise."""
        out = np.where(self.counted[:, np.newaxis], raw, 0.0)
        for block in self.blocks:
            out[block.rows] = block.whitened(_of(out, block.rows))
        return np.asarray(out)

    def only(self, families: Collection[str]) -> Rows:
        """The same with the processes of some families alone."""
        kept = [k for k, group in enumerate(self.groups) if group.family in families]
        blocks = []
        for block in self.blocks:
            places = [np.arange(block.columns[k].start, block.columns[k].stop) for k in kept]
            ends = np.cumsum([each.size for each in places]).tolist()
            columns = tuple(slice(end - each.size, end) for end, each in zip(ends, places, strict=True))
            chosen = np.concatenate([np.zeros(0, dtype=int), *places])
            blocks.append(replace(block, raw=block.raw[:, chosen], z=block.z[:, chosen], columns=columns))
        return replace(self, blocks=tuple(blocks), groups=tuple(self.groups[k] for k in kept))

    def beside_baseline(self, rows: FloatArray) -> FloatArray:
        """Rows (n, ...) at unit noise less their best fit by the baseline."""
        basis = self.shared[:, np.isinf(self.spread)]
        return np.asarray(rows - basis @ (basis.T @ rows))

    def of_moments(self, frame: RateFrame, columns: Sequence[Regressor]) -> FloatArray:
        """Columns of moments as rows (n, columns)."""
        return self.whitened(self.problem.raw_design(frame, columns)[: self.y.size])

    def of_rates(self, rates: ComplexArray) -> FloatArray:
        """Rates that moments make (frame rows, columns) as rows (n, columns)."""
        raw = np.zeros((self.y.size, rates.shape[1]))
        raw[: self.problem.rows.rates] = self.problem.rows.white_moments(rates)
        return self.whitened(raw)

    def allowing(self, rates: ComplexArray) -> Rows:
        """The same where errors shared by all flights, each of a prior of 1, make these rates (frame rows, errors)."""
        spread = np.append(self.spread, np.ones(rates.shape[1]))
        return replace(self, shared=np.concatenate([self.shared, self.of_rates(rates)], axis=1), spread=spread)

    def rates_of_moments(self, frame: RateFrame, columns: Sequence[Regressor]) -> FloatArray:
        """The rates that moments make (rate rows, columns), before errors within tolerances are noise."""
        return np.where(self.counted[: self.problem.rows.rates, np.newaxis], self.problem.own_rows(frame, columns), 0.0)

    def terms(self, fit: HypothesisFit | None) -> Terms:
        """X of a fitted hypothesis, with the static moment of its own fit; no columns of the baseline only."""
        if fit is None or not fit.selected:
            return Terms(np.zeros((self.y.size, 0)), np.zeros(0), np.zeros(0, dtype=bool))
        frame = self.frame_of(fit)
        x = self.of_moments(frame, fit.selected)
        sizes = np.sqrt(np.mean(np.abs(frame.moments(fit.selected)) ** 2, axis=0))
        spread = self.moment / np.maximum(sizes, 1e-12 * self.moment)
        apart = 0
        if fit.nonlinear:
            rates = prediction_slopes(fit.nonlinear, fit.selected, fit.values[fit.baseline_size :], frame)
            of_flights = self._of_single_flights(fit, rates)
            rates, apart = np.concatenate([rates, of_flights], axis=1), of_flights.shape[1]
            x = np.concatenate([x, self.of_rates(rates)], axis=1)
            length = float(np.ptp(frame.coefficient_time))
            ranges = [length if each.kind == "knot" else each.bounds[1] - each.bounds[0] for each in fit.nonlinear]
            moved = np.full(apart, EVENTS_APART * length)
            spread = np.concatenate([spread, _UNIFORM * np.array(ranges), moved])
        scaled = np.arange(spread.size) < len(fit.selected)
        whole = Terms(x, spread, scaled, prior_of_times(fit.mechanisms, fit.selected), apart)
        return _closed(whole, fit) if fit.ends else whole

    def _of_single_flights(self, fit: HypothesisFit, rates: ComplexArray) -> ComplexArray:
        """Of moves of knots of several flights (frame rows, parameters), contrasts between these flights."""
        knots = [k for k, each in enumerate(fit.nonlinear) if each.kind == "knot"] if len(self.blocks) > 1 else []
        mine = self.frame.flight_of_row[:, np.newaxis] == np.arange(len(self.blocks))
        found = [(mine * rates[:, [k]]) @ helmert(len(self.blocks)).T for k in knots]
        return np.concatenate([rates[:, :0], *found], axis=1)

    def frame_of(self, fit: HypothesisFit) -> RateFrame:
        """The frame in which C_mw is that of a fit."""
        return self.frame.with_mechanisms(fit.mechanisms).with_in_plane_moment(fit.columns, fit.values)

    @cached_property
    def measured_moment(self) -> float:
        """rms moment that derolled rates show beyond their noise; where that is more, as at ends, of the model's."""
        found = residual_moments(self.frame, self.problem.records, self.frame.observed)
        shown, squares = found.usable & (found.noise < self.moment), np.abs(self.modelled) ** 2
        squares[shown] = np.abs(found.body[shown]) ** 2 - 2.0 * found.noise[shown] ** 2
        square = float(np.mean(squares))
        return math.sqrt(square) if square > 0.0 else self.moment

    @cached_property
    def moment(self) -> float:
        """rms of the moment coefficient at the linearisation point."""
        return float(np.sqrt(np.mean(np.abs(self.modelled) ** 2)))

    @cached_property
    def factors(self) -> dict[bytes, Any]:
        """What evidences of these rows at the latest amplitudes have in common."""
        return {}

    @cached_property
    def products(self) -> Products:
        """Those of all rows."""
        return Products.of(self, np.ones(self.y.size, dtype=bool), self.size)

    @cached_property
    def stretch_products(self) -> tuple[Products, ...]:
        """Those of each stretch of time."""
        chosen = [self.time_blocks == k for k in np.unique(self.time_blocks)]
        return tuple(Products.of(self, use, int(np.sum(use & self.counted))) for use in chosen)

    @cached_property
    def time_blocks(self) -> IntArray:
        """Which stretch of time each row belongs to (n,), `TIME_BLOCKS` of a flight."""
        return block_of_whitened_row(self.problem, TIME_BLOCKS)[: self.y.size]


def block_of_row(frame: RateFrame, count: int) -> IntArray:
    """Block of each row of the frame (rows,): `count` of equal length a flight."""
    out = np.zeros(frame.observed.size, dtype=np.int64)
    flights = frame.flight_of_row
    for number, flight in enumerate(np.unique(flights)):
        rows = np.flatnonzero(flights == flight)
        out[rows] = number * count + np.arange(rows.size) * count // rows.size
    return out


def block_of_whitened_row(problem: Problem, count: int) -> IntArray:
    """Block of each whitened row (rows,); the rows of priors belong to no block: -1."""
    blocks = block_of_row(problem.frame, count)[problem.rows.samples]
    return np.append(np.tile(blocks, 4), np.full(problem.rows.nuisances.bounded.size, -1))


def prior_of_times(mechanisms: Sequence[Mechanism], selected: Sequence[Regressor]) -> float:
    """Log probability that mechanisms which may end act throughout, where they do."""
    may_end = any(mechanism.time_variation != ("constant",) for mechanism in mechanisms)
    always = may_end and all(column.time_basis.kind == "constant" for column in selected)
    return float(np.log(ALWAYS)) if always else 0.0


def _closed(terms: Terms, fit: HypothesisFit) -> Terms:
    """Those of a mechanism of which nothing remains after each of its regions."""
    selected, made = fit.selected, np.eye(len(fit.selected))
    for begin, *end in (pair for region in fit.regions for pair in region):
        for k in end:
            made[k, begin] = -selected[begin].time_basis.final / selected[k].time_basis.final
    x, spread, count = terms.x.copy(), terms.spread.copy(), len(selected)
    x[:, :count] = x[:, :count] @ made
    found = replace(terms, x=x, coefficients=made)
    spread[:count][~found.acting[:count]] *= NOTHING
    return replace(found, spread=spread)


def rows_of(problem: Problem, point: HypothesisFit, moments: Sequence[MomentProcess] | None = None) -> Rows:
    """The rows of a problem with record processes, about a fitted hypothesis; `moments`: processes, else installed."""
    known = problem.frame.with_mechanisms(point.mechanisms)
    frame = known.with_in_plane_moment(point.columns, point.values)
    modelled = frame.moments(point.columns) @ point.values
    moment = float(np.sqrt(np.mean(np.abs(modelled) ** 2)))
    nuisances, unknowns = problem.rows.nuisances, problem.rows.unknowns
    top, items, use = 2 * problem.rows.rates, nuisances.items, _counted(problem)
    drifts, moments = record_processes(), moment_processes() if moments is None else moments
    names = {each.name for each in drifts}
    bounded = {k for k in nuisances.bounded.tolist() if items[k].name not in names}
    number = problem.rows.order - 2 * len(problem.rows.part.levels)  # of nuisances; negative of what is integrated
    blocks, y = [], problem.raw_response[:top].copy()
    for flight in range(len(frame.motions)):
        rows, mine = problem.rows.of_flights[flight].places, number[unknowns.places[flight]].tolist()
        design = unknowns.own[flight][: rows.size]
        free = design[:, [j for j, k in enumerate(mine) if k < 0 or not np.isfinite(items[k].present)]]
        some = [k for k in mine if k in bounded]
        within = design[:, [mine.index(k) for k in some]]
        y[rows] -= within @ np.array([items[k].present for k in some])
        parts = [design[:, [k >= 0 and items[k].name == own.name for k in mine]] for own in drifts]
        for rates in rates_of_processes(frame, moments, flight, moment):
            white = problem.rows.of_flights[flight].white_moments(rates)
            parts.append(np.concatenate([white, np.zeros_like(white)]))
        blocks.append(replace(Block.of(rows, use[rows, np.newaxis], parts, free, within), items=tuple(some)))
    groups = (
        *(ProcessGroup(each.name, each.family, each.units, False, each.size, RECORD_AMPLITUDE) for each in drifts),
        *(ProcessGroup(each.name, each.family, "1", True, moment, MOMENT_AMPLITUDE) for each in moments),
    )
    fixed, nothing = problem.raw_design(frame, problem.baseline)[:top], np.zeros((top, 0))
    length = float(np.linalg.norm(fixed @ point.values[: fixed.shape[1]]))
    empty = Rows(problem, frame, nothing, nothing, np.zeros(0), nothing, tuple(blocks), groups, modelled, length, use)
    common = [j for j, k in enumerate(number[unknowns.places[-1]].tolist()) if k in bounded]
    of_all = unknowns.shared[:top, common]
    y -= of_all @ np.array([items[k].present for k in number[unknowns.places[-1]][common]])
    y = empty.whitened(y[:, np.newaxis])[:, 0]
    baseline, coefficients = orthonormal(empty.whitened(fixed))
    allowed = empty.whitened(of_all)
    spread = np.concatenate([np.full(baseline.shape[1], np.inf), np.ones(allowed.shape[1])])
    shared = np.concatenate([baseline, allowed], axis=1)
    return replace(empty, y=y, shared=shared, spread=spread, coefficients=coefficients)


def rates_of_processes(
    frame: RateFrame, moments: Sequence[MomentProcess], flight: int, moment: float
) -> list[ComplexArray]:
    """The splines of each process of one flight as rates (rows of the flight, splines), of a prior of its amplitude."""
    motion, own, found = frame.motions[flight], frame.of_flight(flight), []
    for process in (each.model_copy(update=span_of(motion)) for each in moments):
        columns = [Regressor(process.name, term.name) for term in process.terms(motion, {})]
        size = moment / rms_of_shapes(process, motion)
        found.append(size * own.with_mechanisms([process]).columns(columns))
    return found


def _counted(problem: Problem) -> BoolArray:
    """Rows (n,) from `SETTLING` samples after the first of their flight on."""
    samples = problem.rows.samples
    flights = problem.frame.flight_of_row[samples]
    _, first, number = np.unique(flights, return_index=True, return_inverse=True)
    return np.tile(samples - samples[first][number] >= SETTLING, 4)
