"""Columns of several flights: those of one flight are zero on the rows of the others, a few belong to all flights.

    M = [ M_1              S_1 ]
        [      ...         ... ]
        [           M_f    S_f ]

Their normal equations are bordered block diagonal: each flight's columns are eliminated by themselves, then what all
flights share, so that time and memory grow as the number of flights (Golub and Van Loan 2013, section 4.5).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.linearisation.linear import lengths, orthonormal

_BLOCK = 20_000  # rows that are made at once
_SPENT = 1e-10  # length of a unit column below which what the flights' own columns leave of it is rounding


class Stretch(NamedTuple):
    """Rows next to each other, the flight that they belong to (None: to all), and which of its rows they are."""

    rows: slice
    flight: int | None
    own: slice


@dataclass(frozen=True)
class Bordered:
    """Columns in the order of their flights, the shared ones last, on `count` rows. `ranges` are those of each flight,
    in order; `own` (its rows, its columns); `shared` (count, columns).
    """

    count: int
    ranges: tuple[tuple[slice, ...], ...]
    own: tuple[FloatArray, ...]
    shared: FloatArray

    @cached_property
    def places(self) -> tuple[slice, ...]:
        """Which columns are those of each flight, and then which are shared."""
        sizes = [part.shape[1] for part in (*self.own, self.shared)]
        ends = np.cumsum(sizes).tolist()
        return tuple(slice(end - size, end) for end, size in zip(ends, sizes, strict=True))

    @property
    def size(self) -> int:
        """Number of columns."""
        return int(self.places[-1].stop)

    @cached_property
    def stretches(self) -> tuple[Stretch, ...]:
        """All rows in pieces that are not large, each of one flight or of none."""
        found = []
        for flight, ranges in enumerate(self.ranges):
            first = 0
            for rows in ranges:
                for start in range(rows.start, rows.stop, _BLOCK):
                    stop = min(start + _BLOCK, rows.stop)
                    found.append(Stretch(slice(start, stop), flight, slice(first, first + stop - start)))
                    first += stop - start
        last = max((rows.stop for ranges in self.ranges for rows in ranges), default=0)
        found += [Stretch(slice(last, self.count), None, slice(0, 0))] if last < self.count else []
        return tuple(found)

    def coordinates(self, rows: FloatArray) -> FloatArray:
        """Scalar products (columns, k) with rows (n, k), the first of all; the others are zero there."""
        out = np.zeros((self.size, rows.shape[1]))
        for at, flight, own in self.stretches:
            if flight is not None and at.start < rows.shape[0]:
                part = rows[at]
                out[self.places[flight]] += self.own[flight][own][: part.shape[0]].T @ part
        if self.shared.shape[1]:
            out[self.places[-1]] = self.shared[: rows.shape[0]].T @ rows
        return out

    def at(self, stretch: Stretch, values: FloatArray) -> FloatArray:
        """Rows of a stretch (m, k) that columns with `values` (columns, k) make."""
        out = np.zeros((stretch.rows.stop - stretch.rows.start, values.shape[1]))
        if stretch.flight is not None:
            out = self.own[stretch.flight][stretch.own] @ values[self.places[stretch.flight]]
        if self.shared.shape[1]:
            out = out + self.shared[stretch.rows] @ values[self.places[-1]]
        return out

    def times(self, values: FloatArray) -> FloatArray:
        """Rows (count, k) that columns with `values` (columns, k) make."""
        out = np.empty((self.count, values.shape[1]))
        for stretch in self.stretches:
            out[stretch.rows] = self.at(stretch, values)
        return out

    def less(self, rows: FloatArray) -> FloatArray:
        """Rows (count, k) with what orthonormal columns make of them projected out."""
        return rows - self.times(self.coordinates(rows))

    def by_flight(self, rows: FloatArray) -> list[FloatArray]:
        """Each flight's part (its rows, ...) of rows (count, ...)."""
        return [np.concatenate([rows[each] for each in (*ranges, slice(0, 0))]) for ranges in self.ranges]

    def beside(self, more: FloatArray) -> Bordered:
        """With further shared columns (count, k) before those that it has."""
        return Bordered(self.count, self.ranges, self.own, np.concatenate([more, self.shared], axis=1))

    @cached_property
    def factors(self) -> Factors:
        """Orthonormal columns of the same span, and what makes these columns' coefficients of theirs."""
        bases, makes = zip(*map(orthonormal, self.own), strict=True)
        known = Bordered(self.count, self.ranges, bases, np.zeros((self.count, 0)))
        if not self.shared.shape[1]:
            return Factors(known, makes, (), np.zeros((0, 0)))
        scale = lengths(self.shared)
        unit = self.shared / scale
        inside = known.coordinates(unit)
        rest = unit - known.times(inside)
        rest[:, np.linalg.norm(rest, axis=0) <= _SPENT] = 0.0
        basis, made = orthonormal(rest)
        across = tuple(inside[place] @ made for place in known.places[:-1])
        return Factors(Bordered(self.count, self.ranges, bases, basis), makes, across, made / scale[:, np.newaxis])


@dataclass(frozen=True)
class Factors:
    """`basis` orthonormal; of each flight what makes its columns' coefficients of coordinates in the basis, and what of
    those the shared directions take (`across`); `corner` makes the shared columns' coefficients.
    """

    basis: Bordered
    makes: tuple[FloatArray, ...]
    across: tuple[FloatArray, ...]
    corner: FloatArray

    def coefficients(self, coordinates: FloatArray) -> FloatArray:
        """Those of the columns (columns, k) of what has these coordinates in the basis."""
        *own, shared = (coordinates[place] for place in self.basis.places)
        alone = [c - a @ shared for c, a in zip(own, self.across, strict=True)] if self.across else own
        return np.concatenate([*(m @ c for m, c in zip(self.makes, alone, strict=True)), self.corner @ shared])


def joined(ranges: Sequence[slice]) -> tuple[slice, ...]:
    """Ranges, those that follow each other as one."""
    found: list[slice] = []
    for each in ranges:
        if found and found[-1].stop == each.start:
            found[-1] = slice(found[-1].start, each.stop)
        else:
            found.append(each)
    return tuple(found)
