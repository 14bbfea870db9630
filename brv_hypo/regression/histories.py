"""Histories of unknowns on the rows of a frame; of records that are much finer than the motion only some rows are kept.

What an error of the record does is as slow as the motion. Where samples are many to a cycle, all rows follow from every
so many-th by Lagrange's polynomial through the six nearest; with `PER_CYCLE` a cycle that errs by 2e-6 of the fastest.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from brv_hypo.arrays import ComplexArray, FloatArray, IntArray
from brv_hypo.regression.channels import Rows
from brv_hypo.regression.frame import Piece

# Rows that a cycle of the fastest motion keeps.
PER_CYCLE = 24
# Rows of a frame up to which all are kept.
_MOST_KEPT = 20_000
# Values of histories that are made at once: 16 bytes each, several times over.
AT_ONCE = 2_000_000
_NEAREST = 6  # kept rows that a row lies between: degree 5, whose error at 24 rows a cycle is 2e-6 of a sine


@dataclass(frozen=True)
class KeptRows:
    """Which rows of a frame are kept (m,), and what makes all of them of these (rows, m); None where all are kept."""

    which: IntArray
    spread: sparse.csr_array | None

    def of(self, history: Rows) -> Rows:
        """Those of a history (frame rows,) that are kept."""
        return history if self.spread is None else history.at(self.which)

    def all_of(self, kept: ComplexArray) -> ComplexArray:
        """All rows of histories (m, ...) on those that are kept."""
        return kept if self.spread is None else np.asarray(self.spread @ kept)


def kept_rows(pieces: Sequence[Piece], stride: int) -> KeptRows:
    """Every `stride`-th row of each piece, and its last; all of them of frames that are short."""
    total = pieces[-1][1]
    if total <= _MOST_KEPT or stride < 2:
        return KeptRows(np.arange(total), None)
    which = [np.unique(np.append(np.arange(a, b, stride), b - 1)) for a, b in pieces]
    spreads = [_spread(b - a, own - a) for own, (a, b) in zip(which, pieces, strict=True)]
    return KeptRows(np.concatenate(which), sparse.csr_array(sparse.block_diag(spreads, format="csr")))


def _spread(rows: int, kept: IntArray) -> sparse.csr_array:
    """Lagrange's weights (rows, kept) of the kept rows nearest to each row."""
    count = min(_NEAREST, kept.size)
    place = np.arange(rows)
    first = np.clip(np.searchsorted(kept, place, side="right") - count // 2, 0, kept.size - count)
    nearest = first[:, np.newaxis] + np.arange(count)
    nodes = kept[nearest].astype(float)
    weights = np.ones((rows, count))
    for own in range(count):
        for other in range(count):
            if other != own:
                weights[:, own] *= (place - nodes[:, other]) / (nodes[:, own] - nodes[:, other])
    starts = np.arange(rows + 1) * count
    return sparse.csr_array((weights.ravel(), nearest.ravel(), starts), shape=(rows, kept.size))


@dataclass(frozen=True)
class Histories:
    """Histories in both channels, `kept` (m, unknowns) of them, on the `rows` that are kept."""

    rows: KeptRows
    kept: Rows

    def of(self, values: FloatArray) -> Rows:
        """Their sum (frame rows, ...) with the unknowns at `values` (unknowns, ...)."""
        both = (self.rows.all_of(each @ values) for each in (self.kept.rates, self.kept.force))
        return Rows(*both)

    def batches(self) -> Iterator[tuple[slice, Rows]]:
        """So many unknowns at once that their histories (frame rows, some) stay small."""
        total = self.rows.which.size if self.rows.spread is None else self.rows.spread.shape[0]
        count = self.kept.rates.shape[1]
        width = count if self.rows.spread is None else max(1, AT_ONCE // total)
        for first in range(0, count, width):
            some = slice(first, min(first + width, count))
            yield some, Rows(self.rows.all_of(self.kept.rates[:, some]), self.rows.all_of(self.kept.force[:, some]))
