"""Held-out errors are those of a fit without the block, all its unknowns in one dense system."""

import numpy as np
import pytest

from brv_hypo.comparison.judgement import Judged
from brv_hypo.inference.evidence import Evidence
from brv_hypo.inference.fit import HypothesisFit
from brv_hypo.inference.held_out import held_out
from brv_hypo.inference.rows import block_of_row, block_of_whitened_row, rates_of_processes
from brv_hypo.linearisation.frame import residual_moments
from brv_hypo.mechanisms.registry import moment_processes
from tests.chains import judged_cone

BLOCKS = 4
RIDGE = 0.03  # of an error, by what keeps the normal equations regular


def dense_error(fit: HypothesisFit, own: Evidence) -> float:
    """The held-out error of a fit on one flight."""
    rows, problem = own.rows, own.rows.problem.untied()
    (histories,), order = problem.rows.nuisances.flights, problem.rows.order
    rates = np.concatenate(rates_of_processes(rows.frame, moment_processes(), 0, rows.moment), axis=1)
    white = problem.rows.of_flights[0].white_moments(rates)
    beside = np.zeros((problem.raw_response.size, rates.shape[1]))
    beside[: white.shape[0]] = white
    design = np.column_stack([problem.rows.nuisance_design, beside, problem.raw_design(fit.frame, fit.columns)])
    unknowns, amplitude = order.size, dict(zip((each.name for each in rows.groups), np.exp(own.at[1:]), strict=False))
    precision = np.zeros(design.shape[1])
    first = 2 * len(problem.rows.part.levels)
    for place, item in enumerate(problem.rows.nuisances.items, start=first):
        if item.name in amplitude:
            precision[place] = amplitude[item.name] ** -2.0 - 1.0  # its row has the one
    columns = zip(rows.groups, rows.blocks[0].columns, strict=True)
    sizes = np.concatenate([np.full(some.stop - some.start, amplitude[each.name]) for each, some in columns])
    precision[unknowns : unknowns + rates.shape[1]] = sizes[-rates.shape[1] :] ** -2.0
    precision[unknowns + rates.shape[1] + fit.baseline_size :] = (
        np.exp(own.at[-1]) * own.terms.spread[: len(fit.selected)]
    ) ** -2.0
    block, of_row = block_of_whitened_row(problem, BLOCKS + 2), block_of_row(problem.frame, BLOCKS + 2)
    errors = []
    for k in range(1, BLOCKS + 1):
        kept, response = design[block != k], problem.raw_response[block != k]
        scale = np.linalg.norm(kept, axis=0)
        unit = kept / scale
        found = np.linalg.solve(unit.T @ unit + np.diag(precision / scale**2), unit.T @ response) / scale
        nuisances, processes, values = np.split(found, [unknowns, unknowns + rates.shape[1]])
        made = histories.grid.all_of(histories.kept.rates @ nuisances[first:][histories.places])
        rest = fit.frame.observed - fit.frame.columns(fit.columns) @ values - made - rates @ processes
        moments = residual_moments(fit.frame, problem.records, rest)
        errors.append(moments.body[moments.usable & (of_row == k)])
    return float(np.mean(np.abs(np.concatenate(errors)) ** 2) / 2.0)


@pytest.mark.thorough
def test_they_are_those_of_a_fit_without_the_block() -> None:
    found: Judged = judged_cone("sticking")
    errors = held_out(found.fits, found.evidences, BLOCKS)
    checked = [k for k, own in enumerate(found.evidences) if own.terms.coefficients is None]
    assert found.null in checked
    for k in checked:
        assert errors[k] == pytest.approx(dense_error(found.fits[k], found.evidences[k]), rel=RIDGE)
    best = min(range(len(errors)), key=errors.__getitem__)
    assert found.fits[best].name == "sticking"
