"""What all hypotheses of a comparison share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from brv_hypo.arrays import FloatArray
from brv_hypo.design.columns import Column
from brv_hypo.design.frame import RateFrame, whiten
from brv_hypo.design.whitening import NoiseModel


@dataclass(frozen=True)
class Task:
    """Data, baseline columns, knots (s), noise and limits; `efficiency` is effective over actual samples."""

    frame: RateFrame
    baseline: tuple[Column, ...]
    knots: FloatArray
    noise: NoiseModel
    efficiency: float
    max_terms: int
    refine: bool

    @property
    def response(self) -> FloatArray:
        """Whitened derolled rates (2 rows,)."""
        return whiten(self.frame.observed[:, None], self.frame.pieces, self.noise)[:, 0]

    @property
    def samples(self) -> int:
        """Real residuals less the constants of integration that were projected out."""
        return 2 * (self.frame.observed.size - len(self.frame.pieces))

    def design(self, frame: RateFrame, columns: Sequence[Column]) -> FloatArray:
        """Whitened columns (2 rows, columns)."""
        return whiten(frame.columns(columns), frame.pieces, self.noise)
