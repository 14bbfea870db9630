"""Sparse rows of blocks, as the linearised dynamics and outputs have them: neighbours in time, and delayed states.

A delay acts through interpolation between a few samples far back. It is kept as it comes about, one block and a
few weights a row, so that memory does not grow with the distance.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True)
class Coupling:
    """What one delay adds: row k acts by `blocks[k]` on the sum over j of weight[k, j] x[index[k, j]].

    `index` and `weight` are (n_rows, points), `blocks` (n_rows, m, n_states).
    """

    index: IntArray
    weight: FloatArray
    blocks: FloatArray

    def part(self, where: slice) -> Coupling:
        """Some of the rows."""
        return Coupling(self.index[where], self.weight[where], self.blocks[where])


@dataclass(frozen=True)
class BlockRows:
    """A sparse matrix of block rows: row k acts on the states of samples k + offset, k + offset + 1, ...

    `blocks` is (n_rows, width, m, n_states); blocks that would stand outside the samples are zero. `couplings` act
    on samples further away.
    """

    offset: int
    blocks: FloatArray
    couplings: tuple[Coupling, ...] = ()

    @staticmethod
    def joined(parts: Sequence[BlockRows]) -> BlockRows:
        """Rows of several parts, one after the other; couplings that act on nothing are dropped."""
        if len(parts) == 1 and all(np.any(c.blocks) for c in parts[0].couplings):
            return parts[0]
        couplings = [
            Coupling(
                *(np.concatenate([getattr(c, name) for c in each]) for name in ("index", "weight", "blocks"))
            )
            for each in zip(*(part.couplings for part in parts), strict=True)
        ]
        return BlockRows(
            parts[0].offset,
            np.concatenate([part.blocks for part in parts]),
            tuple(c for c in couplings if np.any(c.blocks)),
        )

    @cached_property
    def filled(self) -> tuple[int, ...]:
        """Where along the width any block is not zero."""
        return tuple(np.flatnonzero(self._nonzero.any(axis=0)).tolist())

    @cached_property
    def _nonzero(self) -> BoolArray:
        """Which blocks are not zero, (n_rows, width)."""
        return np.asarray(self.blocks.reshape(*self.blocks.shape[:2], -1).any(axis=2))

    def turned(self, left: FloatArray, right: FloatArray) -> BlockRows:
        """Every block B as left B diag(right); left (m,) is a diagonal, (n_rows, m', m) one matrix a row."""

        def turn(blocks: FloatArray, one_a_row: FloatArray) -> FloatArray:
            turned = one_a_row @ blocks if left.ndim == 3 else left[:, None] * blocks
            return np.asarray(turned * right)

        return replace(
            self,
            blocks=turn(self.blocks, left[:, None]),
            couplings=tuple(replace(c, blocks=turn(c.blocks, left)) for c in self.couplings),
        )

    def without_couplings(self) -> BlockRows:
        """The neighbours in time alone."""
        return replace(self, couplings=())

    def dot(self, x: FloatArray) -> FloatArray:
        """The product with states x, (n, n_states) or (n, n_states, p), as (n_rows, m) or (n_rows, m, p)."""
        n = x.shape[0]
        columns = x.reshape(n, x.shape[1], -1)
        product = np.zeros((*self.blocks.shape[::2], columns.shape[2]))
        for w in self.filled:
            column = np.clip(np.arange(self.blocks.shape[0]) + self.offset + w, 0, n - 1)
            product += self.blocks[:, w] @ columns[column]
        for coupling in self.couplings:
            delayed = np.zeros((coupling.index.shape[0], *columns.shape[1:]))
            for index, weight in zip(coupling.index.T, coupling.weight.T, strict=True):
                delayed += weight[:, None, None] * columns[index]
            product += coupling.blocks @ delayed
        return product.reshape(*self.blocks.shape[::2], *x.shape[2:])

    def extent(self, n: int) -> tuple[IntArray, IntArray]:
        """First and last sample that each row acts on, (n_rows,) each, of n samples."""
        rows = np.arange(self.blocks.shape[0])
        lowest, highest = np.full(rows.size, n), np.full(rows.size, -1)
        for w in self.filled:
            acts = self._nonzero[:, w]
            at = rows[acts] + self.offset + w
            lowest[acts], highest[acts] = np.minimum(lowest[acts], at), np.maximum(highest[acts], at)
        for coupling in self.couplings:
            for index, weight in zip(coupling.index.T, coupling.weight.T, strict=True):
                acts = weight != 0.0
                lowest[acts] = np.minimum(lowest[acts], index[acts])
                highest[acts] = np.maximum(highest[acts], index[acts])
        return lowest, highest

    def span(self, n: int) -> tuple[int, int]:
        """Distance from a row's own number to the first and to the last of n samples that any row acts on."""
        if not self.couplings:
            return self.offset, self.offset + self.blocks.shape[1] - 1
        rows = np.arange(self.blocks.shape[0])
        lowest, highest = self.extent(n)
        acts = highest >= 0
        return int(np.min((lowest - rows)[acts], initial=0)), int(np.max((highest - rows)[acts], initial=0))

    def matrix(self, n: int, part: slice = slice(None)) -> csr_array[np.float64]:
        """Some of the rows, (n_rows m, n n_states), without the zeros."""
        from scipy.sparse import coo_array  # here, for a cheap import of the package

        rows = np.arange(self.blocks.shape[0])[part]
        m, n_states = self.blocks.shape[2:]
        values, down, along = [np.zeros(0)], [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
        for row, sample, blocks in self._entries(part):
            at = (row * m)[:, None, None] + np.arange(m)[:, None]
            column = (sample * n_states)[:, None, None] + np.arange(n_states)
            at, column = np.broadcast_arrays(at, column)
            values.append(blocks.ravel())
            down.append(at.ravel())
            along.append(column.ravel())
        entries = (np.concatenate(values), (np.concatenate(down), np.concatenate(along)))
        return coo_array(entries, shape=(rows.size * m, n * n_states)).tocsr()

    def _entries(self, part: slice) -> Iterator[tuple[IntArray, IntArray, FloatArray]]:
        """Rows counted from the first of the part, samples, and the blocks that stand there."""
        start = part.indices(self.blocks.shape[0])[0]
        own, nonzero = self.blocks[part], self._nonzero[part]
        for w in self.filled:
            row = np.flatnonzero(nonzero[:, w])
            yield row, row + start + self.offset + w, own[row, w]
        for coupling in self.couplings:
            here = coupling.part(part)
            for index, weight in zip(here.index.T, here.weight.T, strict=True):
                row = np.flatnonzero(weight)
                yield row, index[row], weight[row, None, None] * here.blocks[row]

    def own(self, first: int = 0) -> FloatArray:
        """How each row acts on the sample of its own number, (n_rows, m, n_states); `first` is that of row 0."""
        found = np.zeros((self.blocks.shape[0], *self.blocks.shape[2:]))
        if 0 <= -self.offset < self.blocks.shape[1]:
            found += self.blocks[:, -self.offset]
        rows = np.arange(first, first + self.blocks.shape[0])
        for coupling in self.couplings:
            for index, weight in zip(coupling.index.T, coupling.weight.T, strict=True):
                found += np.where(index == rows, weight, 0.0)[:, None, None] * coupling.blocks
        return found

    def widened(self, n: int) -> BlockRows:
        """The same matrix with couplings spread over the width: for those that reach a few samples only."""
        if not self.couplings:
            return self
        first, last = self.span(n)
        first, last = min(first, self.offset), max(last, self.offset + self.blocks.shape[1] - 1)
        blocks = np.zeros((self.blocks.shape[0], last - first + 1, *self.blocks.shape[2:]))
        for row, sample, block in self._entries(slice(None)):
            blocks[row, sample - row - first] += block
        return BlockRows(first, blocks)
