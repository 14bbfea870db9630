"""What is as slow as the motion, kept on as many samples as the motion needs.

What an error of the record does follows the motion. Where samples are many to a cycle, all of it follows from every so
many-th sample by Lagrange's polynomial through the six nearest; with `RESPONSE_PER_CYCLE` a cycle that errs by 2e-6, at
the ends by 1e-5, of what varies with the fastest motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from scipy import sparse

from brv_hypo.arrays import ComplexArray, FloatArray, IntArray
from brv_hypo.constants import RESPONSE_FASTEST
from brv_hypo.motion.lagrange import NEAREST, lagrange

Values = TypeVar("Values", FloatArray, ComplexArray)

# Samples up to which all are kept.
_MOST_KEPT = 20_000
# Samples at the ends of a piece, at most, that are none of those kept: filters and late clocks make of them what they
# like. They follow by extrapolation over an eighth of the spacing at most.
_END = 4
# Samples of many columns that are held at once.
_BLOCK = 20_000


def blocks(samples: int) -> list[slice]:
    """All samples, as many at once as are held of many columns."""
    return [slice(first, min(first + _BLOCK, samples)) for first in range(0, samples, _BLOCK)]


def spacing(meridian_rate: FloatArray, roll_rate: FloatArray, step: float, per_cycle: int) -> int:
    """Samples from one to the next where a cycle of the fastest motion has `per_cycle`; rates (n,) rad/s, step s."""
    fastest = float(np.percentile(np.abs(meridian_rate), RESPONSE_FASTEST)) + float(np.max(np.abs(roll_rate)))
    return max(1, int(2.0 * np.pi / (fastest * step * per_cycle)))


def turning(meridian_rate: FloatArray, roll_rate: FloatArray, step: float) -> float:
    """Frequency of the fastest motion in axes that do not roll, rad a sample; rates (n,) rad/s, step s.

    What is fixed to the body turns as well.
    """
    crossflow = float(np.percentile(np.abs(roll_rate - meridian_rate), RESPONSE_FASTEST))
    return max(crossflow, float(np.max(np.abs(roll_rate)))) * step


@dataclass(frozen=True)
class KeptRows:
    """Which of `count` samples are kept (m,), and what makes all of them of these (n, m); None where all are kept."""

    count: int
    which: IntArray
    spread: sparse.csr_array | None = None

    @property
    def size(self) -> int:
        """How many are kept."""
        return int(self.which.size)

    def of(self, values: Values) -> Values:
        """Those of `values` (n, ...) that are kept."""
        return values if self.spread is None else values[self.which]

    def all_of(self, kept: Values, rows: slice = slice(None)) -> Values:
        """All samples, or these `rows`, of what was kept (m, ...)."""
        if self.spread is None:
            return kept[rows]
        flat = np.asarray(self.spread[rows] @ np.ascontiguousarray(kept).reshape(self.size, -1))
        return flat.reshape(-1, *kept.shape[1:])


def all_rows(count: int) -> KeptRows:
    """All samples kept."""
    return KeptRows(count, np.arange(count))


def kept_rows(pieces: Sequence[tuple[int, int]], stride: int) -> KeptRows:
    """About every `stride`-th sample of each piece [a, b), which follow each other; all of short records."""
    count = pieces[-1][1]
    if count <= _MOST_KEPT or stride < 2:
        return all_rows(count)
    which = [a + _evenly(b - a, stride) for a, b in pieces]
    spreads = [
        lagrange((own - a).astype(float), np.arange(b - a, dtype=float))
        for own, (a, b) in zip(which, pieces, strict=True)
    ]
    return KeptRows(count, np.concatenate(which), sparse.csr_array(sparse.block_diag(spreads, format="csr")))


def _evenly(count: int, stride: int) -> IntArray:
    """About every `stride`-th of so many samples, the ends left out; all of them where they are few."""
    if count < 2 * _END + NEAREST * stride:
        return np.arange(count)
    end = min(_END, stride // 8)
    places = np.linspace(end, count - 1 - end, -(-count // stride))
    return np.asarray(np.round(places), dtype=np.int64)
