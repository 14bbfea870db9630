"""Prediction error on blocks of time that took no part in the fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from brv_hypo.arrays import ComplexArray, FloatArray, IntArray
from brv_hypo.inference.evidence import Evidence
from brv_hypo.inference.fit import HypothesisFit
from brv_hypo.inference.problem import Problem
from brv_hypo.inference.rows import Rows, block_of_row, block_of_whitened_row, rates_of_processes
from brv_hypo.linearisation.frame import residual_moments
from brv_hypo.linearisation.linear import lengths
from brv_hypo.mechanisms.registry import moment_processes

_RIDGE = 1e-12  # of the columns' unit length, beyond rounding: keeps the normal equations of fewer rows regular


def jackknife_error(left_out: FloatArray) -> float:
    """Standard error from estimates without each block (blocks,): Efron and Stein, Ann. Statist. 9, 1981."""
    return float(np.sqrt((left_out.size - 1) * np.var(left_out)))


def held_out(fits: Sequence[HypothesisFit], evidences: Sequence[Evidence], count: int) -> list[float]:
    """Mean square error of the moment coefficients on each of `count` blocks a flight, predicted by the fit without it,
    terms and processes with the priors that they have at the amplitudes of its evidence. A flight has two blocks more,
    its first and last: beyond those nothing holds its motion and processes, and their errors would count for all. The
    rows of a block are taken out of the normal equations; the walk of the attitude is independent of the rates' noise
    here, as rows may be left out only then. What is of other flights alone is eliminated once.
    """
    count += 2
    rows = evidences[0].rows
    problem = rows.problem.untied()
    flights = [_Flight.of(problem, rows, number, count) for number in range(len(problem.rows.of_flights))]
    return [_error(problem, flights, *each, count) for each in zip(fits, evidences, strict=True)]


@dataclass(frozen=True)
class _Flight:
    """A flight's own unknowns at unit length (rows, unknowns), splines of moment processes the last, and its rows of
    each block with their products. `process` of each unknown is -1 for none, `bounded` the precision that its row gives
    it. `rates` (rows of the flight, splines) are what the splines make.
    """

    unit: FloatArray
    scale: FloatArray
    blocks: dict[int, tuple[IntArray, FloatArray]]
    process: IntArray
    bounded: FloatArray
    rates: ComplexArray

    @classmethod
    def of(cls, problem: Problem, rows: Rows, number: int, count: int) -> _Flight:
        """That of one flight of a problem."""
        unknowns, items, groups = problem.rows.unknowns, problem.rows.nuisances.items, rows.groups
        own, ranges, of_row = unknowns.own[number], unknowns.ranges[number], block_of_whitened_row(problem, count)
        rates = rates_of_processes(rows.frame, moment_processes(), number, rows.moment)
        made = np.concatenate([np.zeros((np.sum(rows.frame.flight_of_row == number), 0)), *rates], axis=1)
        white = problem.rows.of_flights[number].white_moments(made)
        whole = np.concatenate([own, np.zeros((own.shape[0], made.shape[1]))], axis=1)
        whole[: white.shape[0], own.shape[1] :] = white
        place_of = {each.name: k for k, each in enumerate(groups)}
        places = (problem.rows.order[unknowns.places[number]] - 2 * len(problem.rows.part.levels)).tolist()
        process = [place_of.get(items[k].name, -1) if k >= 0 else -1 for k in places]  # those of the record
        bounded = np.append(np.array(process) >= 0, np.zeros(made.shape[1])).astype(float)
        for place, each in enumerate(rates, start=len(groups) - len(rates)):
            process += [place] * each.shape[1]
        scale = lengths(whole)
        unit, block = whole / scale, np.concatenate([of_row[each] for each in (*ranges, slice(0, 0))])
        chosen = {int(k): np.flatnonzero(block == k) for k in np.unique(block)}
        blocks = {k: (those, unit[those].T @ unit[those]) for k, those in chosen.items()}
        return cls(unit, scale, blocks, np.array(process), bounded, made)

    def products(self, own: Evidence) -> FloatArray:
        """Those of its unknowns (unknowns, unknowns) with the priors of processes at the amplitudes of an evidence."""
        sizes = np.exp(own.at[1:])[self.process]
        precision = np.where(self.process >= 0, (sizes**-2.0 - self.bounded) / self.scale**2, 0.0)
        return np.asarray(sum(each for _, each in self.blocks.values()) + np.diag(_RIDGE + precision))


def _error(problem: Problem, flights: Sequence[_Flight], fit: HypothesisFit, evidence: Evidence, count: int) -> float:
    unknowns, histories, frame = problem.rows.unknowns, problem.rows.nuisances.flights, fit.frame
    makes, precision = _of_terms(fit, evidence)
    shared = np.column_stack([problem.raw_design(frame, fit.columns) @ makes, unknowns.shared, problem.raw_response])
    scale = lengths(shared)
    shared = shared / scale
    corner = shared.T @ shared + _RIDGE * np.eye(scale.size)
    corner[np.diag_indices(precision.size)] += precision / scale[: precision.size] ** 2
    parts = zip(flights, unknowns.by_flight(shared), strict=True)
    whole = [(each, part, each.products(evidence)) for each, part in parts]
    eliminated = [_eliminated(products, each.unit.T @ part)[0] for each, part, products in whole]
    corner = corner - sum(eliminated)
    constants, moments = 2 * len(problem.rows.part.levels), frame.columns(fit.columns)
    rest = np.zeros((frame.observed.size, count), dtype=complex)
    between = {block for own in flights for block in own.blocks if 0 < block % count < count - 1 and block >= 0}
    for number, (own, part, products) in enumerate(whole):
        values, others = np.zeros((precision.size, count)), np.zeros((unknowns.size, count))
        border, first = own.unit.T @ part, own.scale.size - own.rates.shape[1]
        processes = np.zeros((own.rates.shape[1], count))
        for block, (rows, inside) in own.blocks.items():
            if block not in between:
                continue
            beside = part[rows]
            square, solved = _eliminated(products - inside, border - own.unit[rows].T @ beside)
            inner = corner + eliminated[number] - beside.T @ beside - square
            common = np.linalg.solve(inner[:-1, :-1], inner[:-1, -1])
            place, shares = block % count, common / scale[:-1] * scale[-1]
            mine = solved @ np.append(-common, 1.0) / own.scale * scale[-1]
            values[:, place] = makes @ shares[: precision.size]
            others[problem.rows.order[unknowns.places[number]], place], processes[:, place] = np.split(mine, [first])
            others[problem.rows.order[unknowns.places[-1]], place] = shares[precision.size :]
        drawn, span = histories[number], histories[number].span
        made = drawn.grid.all_of(drawn.kept.rates @ others[constants:][drawn.places]) + own.rates @ processes
        rest[span] = frame.observed[span, np.newaxis] - moments[span] @ values - made
    found, block_of = residual_moments(frame, problem.records, rest), block_of_row(problem.frame, count)
    use = found.usable & np.isin(block_of, [*between])
    errors = found.body[np.arange(rest.shape[0]), block_of % count][use]
    return float(np.sum(np.abs(errors) ** 2) / 2.0 / max(errors.size, 1))


def _of_terms(fit: HypothesisFit, own: Evidence) -> tuple[FloatArray, FloatArray]:
    """What makes the coefficients of a fit (columns, columns) of those that its prior is of, and these' precisions."""
    makes, precision, first = np.eye(len(fit.columns)), np.zeros(len(fit.columns)), fit.baseline_size
    precision[first:] = (np.exp(own.at[-1]) * own.terms.spread[: len(fit.selected)]) ** -2.0
    if own.terms.coefficients is not None:
        makes[first:, first:] = own.terms.coefficients
    return makes, precision


def _eliminated(products: FloatArray, border: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What eliminating a flight's unknowns takes of the products of what is shared, and what they follow it by."""
    solved = np.asarray(cho_solve(cho_factor(products, check_finite=False), border, check_finite=False))
    return border.T @ solved, solved
