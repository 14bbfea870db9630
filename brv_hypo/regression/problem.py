"""What all hypotheses of a comparison share, and the least-squares rows that they are fitted on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.model.columns import Column
from brv_hypo.regression.crossflow_errors import crossflow_errors
from brv_hypo.regression.frame import Piece, RateFrame, whiten
from brv_hypo.regression.whitening import NoiseModel


@dataclass(frozen=True)
class Task:
    """Data, baseline columns, knots (s), noise and limits; `efficiency` is effective over actual samples."""

    frame: RateFrame
    baseline: tuple[Column, ...]
    knots: FloatArray
    noise: NoiseModel
    efficiency: float
    max_terms: int
    exact_terms: int
    refine: bool

    @cached_property
    def response(self) -> FloatArray:
        """Whitened derolled rates, what the reconstruction cannot know projected out (rows,)."""
        return self._rows.of(self.frame.observed[:, None])[:, 0]

    @cached_property
    def samples(self) -> int:
        """Real residuals less the constants of integration that were projected out."""
        return 2 * (self.frame.observed.size - len(self.frame.pieces))

    def design(self, frame: RateFrame, columns: Sequence[Column]) -> FloatArray:
        """Whitened columns (rows, columns), projected like the response."""
        return self._rows.of(frame.columns(columns))

    def rows_without(self, pieces: tuple[Piece, ...]) -> WhitenedRows:
        """The rows of some pieces of the record alone."""
        return WhitenedRows.build(pieces, self.noise, self._errors)

    @cached_property
    def _errors(self) -> ComplexArray:
        return crossflow_errors(self.frame)

    @cached_property
    def _rows(self) -> WhitenedRows:
        return WhitenedRows.build(self.frame.pieces, self.noise, self._errors)


@dataclass(frozen=True)
class WhitenedRows:
    """Pieces of the record, whitened; a Gaussian prior on the reconstruction's errors adds a row for each."""

    pieces: tuple[Piece, ...]
    noise: NoiseModel
    basis: FloatArray

    @classmethod
    def build(cls, pieces: tuple[Piece, ...], noise: NoiseModel, errors: ComplexArray) -> WhitenedRows:
        """`errors` (record rows, m): rate histories of errors with prior N(0, 1)."""
        prior = noise.sigma * np.eye(errors.shape[1])
        basis, _ = np.linalg.qr(np.vstack([whiten(errors, pieces, noise), prior]))
        return cls(pieces, noise, basis)

    def of(self, rates: ComplexArray) -> FloatArray:
        """Rate histories (record rows, columns) as least-squares rows, the errors projected out."""
        white = whiten(rates, self.pieces, self.noise)
        rows = np.vstack([white, np.zeros((self.basis.shape[1], white.shape[1]))])
        return np.asarray(rows - self.basis @ (self.basis.T @ rows), dtype=float)
