"""Histories of unknowns on the rows of a frame, of which those are kept that the motion needs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from brv_hypo.arrays import FloatArray
from brv_hypo.motion.interpolation import DecimatedGrid
from brv_hypo.regression.channels import Rows

# Values of histories that are made at once: 16 bytes each, several times over.
AT_ONCE = 2_000_000


@dataclass(frozen=True)
class Histories:
    """Histories in both channels, `kept` (m, unknowns) of them, on the `rows` that are kept."""

    rows: DecimatedGrid
    kept: Rows

    def of(self, values: FloatArray) -> Rows:
        """Their sum (frame rows, ...) with the unknowns at `values` (unknowns, ...)."""
        return Rows(self.rows.all_of(self.kept.rates @ values), self.rows.all_of(self.kept.force @ values))

    def batches(self) -> Iterator[tuple[slice, Rows]]:
        """So many unknowns at once that their histories (frame rows, some) stay small."""
        count = self.kept.rates.shape[1]
        width = count if self.rows.spread is None else max(1, AT_ONCE // self.rows.count)
        for first in range(0, count, width):
            some = slice(first, min(first + width, count))
            yield some, Rows(self.rows.all_of(self.kept.rates[:, some]), self.rows.all_of(self.kept.force[:, some]))
