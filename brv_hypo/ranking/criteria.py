"""The seven criteria of Section 3.3.2 of the report, for every hypothesis on the same rows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import qr

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.regression.fit import HypothesisFit
from brv_hypo.regression.held_out import blocks
from brv_hypo.regression.linear import lengths
from brv_hypo.regression.problem import Task
from brv_hypo.subset.criteria import Criteria, Reference, evaluate
from brv_hypo.subset.fit import least_squares


def criteria_of(task: Task, fits: Sequence[HypothesisFit], block_count: int) -> tuple[Criteria, ...]:
    """Criteria of each fit; the complete model of C_p holds the terms of all hypotheses together."""
    designs = [task.design(fit.frame, fit.columns) for fit in fits]
    size = len(task.baseline)
    complete = _independent(
        np.column_stack([designs[0][:, :size], *(design[:, size:] for design in designs)])
    )
    null = least_squares(_independent(designs[0][:, :size]), task.response)
    reference = Reference(
        rss_forced=null.rss,
        n_forced=size,
        complete=least_squares(complete, task.response),
        complete_rank=complete.shape[1],
        blocks=_block_of_row(task, block_count),
    )
    return tuple(evaluate(least_squares(_independent(d), task.response), reference) for d in designs)


def _independent(design: FloatArray) -> FloatArray:
    """The columns without those that depend on the ones before, by pivoted QR."""
    triangle, order = qr(design / lengths(design), mode="r", pivoting=True)
    diagonal = np.abs(np.diag(triangle))
    kept = np.sort(order[: diagonal.size][diagonal > 1e-9 * diagonal[0]])
    return np.asarray(design[:, kept], dtype=float)


def _block_of_row(task: Task, count: int) -> IntArray:
    """Block of each whitened row (rows,); rows of the prior belong to the last one."""
    samples = task.frame.observed.size
    block = np.zeros(samples, dtype=np.int64)
    for index, pieces in enumerate(blocks(task.frame, count)):
        for a, b in pieces:
            block[a:b] = index
    prior = np.full(task.response.size - 2 * samples, block.max(), dtype=np.int64)
    return np.concatenate([block, block, prior])
