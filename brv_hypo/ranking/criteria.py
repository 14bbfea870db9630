"""The seven criteria of Section 3.3.2 of the report, for every hypothesis on the same rows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import qr

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.regression.fit import HypothesisFit
from brv_hypo.regression.held_out import block_of_whitened_row
from brv_hypo.regression.linear import lengths
from brv_hypo.regression.problem import Problem
from brv_hypo.subset.criteria import Criteria, Reference, evaluate, least_squares


def criteria_of(problem: Problem, fits: Sequence[HypothesisFit], block_count: int) -> tuple[Criteria, ...]:
    """Criteria of each fit; the complete model of C_p holds the terms of all hypotheses together."""
    designs = [problem.design(fit.frame, fit.columns) for fit in fits]
    size = len(problem.baseline)
    complete = _independent(
        np.column_stack([designs[0][:, :size], *(design[:, size:] for design in designs)])
    )
    null = least_squares(_independent(designs[0][:, :size]), problem.response)
    reference = Reference(
        rss_forced=null.rss,
        n_forced=size,
        complete=least_squares(complete, problem.response),
        blocks=_blocks(problem, block_count),
    )
    return tuple(evaluate(least_squares(_independent(d), problem.response), reference) for d in designs)


def _independent(design: FloatArray) -> FloatArray:
    """The columns without those that depend on the ones before, by pivoted QR."""
    triangle, order = qr(design / lengths(design), mode="r", pivoting=True)
    diagonal = np.abs(np.diag(triangle))
    kept = np.sort(order[: diagonal.size][diagonal > 1e-9 * diagonal[0]])
    return np.asarray(design[:, kept], dtype=float)


def _blocks(problem: Problem, count: int) -> IntArray:
    """Block of each whitened row (rows,); rows of the priors belong to the last one."""
    block = block_of_whitened_row(problem, count)
    return np.where(block < 0, block.max(), block)
