"""The two channels that a residual has: the rates of Eq. 2.3, and the specific force across the axis.

Moments show in the rates. Instruments and wind show in both, so both are regressed together; each is
divided by the noise that a rich model leaves in it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from brv_hypo.regression.frame import Piece, RateFrame
from brv_hypo.regression.whitening import NoiseModel

# The block held out of each four.
_HELD_OUT = 2
_SHORTEST = 8


@dataclass(frozen=True)
class Noise:
    """Noise models of the two channels: rates (rad/s) and force (m/s^2)."""

    rates: NoiseModel
    force: NoiseModel
    size: tuple[float, float]
    """Mean squares of the residuals that the models are of: rates, (rad/s)^2, and force, (m/s^2)^2."""
    thinning: int = 1
    """Whitened rows that are averaged into one: the columns are slow, the noise is white."""


@dataclass(frozen=True)
class Rows:
    """One history in both channels (rows,) or (rows, columns): derolled rates rad/s, transverse force
    m/s^2.
    """

    rates: ComplexArray
    force: ComplexArray

    def at(self, samples: IntArray) -> Rows:
        """The rows of these samples."""
        return Rows(self.rates[samples], self.force[samples])


@dataclass(frozen=True)
class Part:
    """Some stretches of a flight.

    `rows` are indices into the frame's rows, `samples` into the flight's arrays, `seen` where the force may
    be used (all of one length). `pieces` are the ranges that are contiguous in time; `levels` the ranges
    that share one constant of integration.
    """

    rows: IntArray
    samples: IntArray
    seen: BoolArray
    pieces: tuple[Piece, ...]
    levels: tuple[Piece, ...]

    def whitened(self, rows: Rows, noise: Noise) -> FloatArray:
        """Both channels at unit noise: (4 thinned rows, columns), rates first, then force; real before
        imaginary.
        """
        return np.concatenate([self.white_rates(rows.rates, noise), self.white_force(rows.force, noise)])

    def white_rates(self, rates: ComplexArray, noise: Noise) -> FloatArray:
        """The rates filtered, their constants of integration removed (2 thinned rows, columns)."""
        white = self._filtered(rates, noise)
        level = self._level(noise)
        for (a, b), constant in zip(self.levels, self.constants(rates, noise), strict=True):
            white[a:b] -= np.outer(level[a:b], constant)
        return np.concatenate([self._thinned(white.real, noise), self._thinned(white.imag, noise)])

    def white_rates_as_they_are(self, rates: ComplexArray, noise: Noise) -> FloatArray:
        """The rates filtered, constants of integration and all (2 thinned rows, columns)."""
        white = self._filtered(rates, noise)
        return np.concatenate([self._thinned(white.real, noise), self._thinned(white.imag, noise)])

    def constants(self, rates: ComplexArray, noise: Noise) -> ComplexArray:
        """Constants of integration (levels, columns), in the units of the rates."""
        white, level = self._filtered(rates, noise), self._level(noise)
        return np.array([level[a:b] @ white[a:b] / (level[a:b] @ level[a:b]) for a, b in self.levels])

    def _filtered(self, rates: ComplexArray, noise: Noise) -> ComplexArray:
        rows = _columns(rates)
        white = [noise.rates.whiten(rows[a:b]) for a, b in self.pieces]
        return np.asarray(np.concatenate(white) / noise.rates.sigma, dtype=complex)

    def _level(self, noise: Noise) -> FloatArray:
        """A constant of one (n,), filtered."""
        return self._filtered(np.ones(self.rows.size, dtype=complex), noise)[:, 0].real

    def white_force(self, force: ComplexArray, noise: Noise) -> FloatArray:
        """The force filtered (2 thinned rows, columns)."""
        seen = _columns(force) * self.seen[:, np.newaxis]
        white = np.concatenate([noise.force.whiten(seen[a:b]) for a, b in self.pieces]) / noise.force.sigma
        return np.concatenate([self._thinned(white.real, noise), self._thinned(white.imag, noise)])

    def thinned_pieces(self, noise: Noise) -> tuple[tuple[int, int], ...]:
        """Row range of each stretch of time among the thinned rows of one channel."""
        sizes = [len(range(a, b, noise.thinning)) for a, b in self.pieces]
        ends = np.cumsum(sizes)
        return tuple((int(end) - size, int(end)) for end, size in zip(ends, sizes, strict=True))

    def _thinned(self, white: FloatArray, noise: Noise) -> FloatArray:
        """Sums of neighbours over the root of their number, within each stretch."""
        if noise.thinning == 1:
            return white
        starts = np.concatenate([np.arange(a, b, noise.thinning) for a, b in self.pieces])
        sizes = np.diff(np.append(starts, white.shape[0]))
        return np.asarray(np.add.reduceat(white, starts, axis=0) / np.sqrt(sizes)[:, np.newaxis], dtype=float)

    def count(self, noise: Noise) -> int:
        """Real residuals, less the constants of integration."""
        pieces = self.thinned_pieces(noise)
        return 4 * pieces[-1][1] - 2 * len(self.levels)


def _columns(values: ComplexArray) -> ComplexArray:
    return values if values.ndim == 2 else values[:, np.newaxis]


def split(frame: RateFrame, seen: BoolArray, blocks: int) -> tuple[Part, Part]:
    """The part that is fitted and the part that is held out: every fourth of `blocks` even stretches of time.

    The rates on both sides of a held-out stretch share a constant of integration: what the model says of
    the moments between is felt, the samples between are not. Held-out stretches have a constant each.
    """
    time = frame.reconstructions[0].flight.time
    edges = np.linspace(time[0], time[-1], blocks + 1)
    held = np.searchsorted(edges, time, side="right").clip(1, blocks) % 4 == _HELD_OUT + 1
    return part(frame, seen, ~held, shared=True), part(frame, seen, held, shared=False)


def part(frame: RateFrame, seen: BoolArray, chosen: BoolArray, *, shared: bool) -> Part:
    """The part of the frame whose samples (n,) are chosen; stretches of few samples are left out.

    `shared`: one constant of integration for all stretches of a segment of the record.
    """
    rows: list[IntArray] = []
    samples: list[IntArray] = []
    pieces: list[Piece] = []
    levels: list[Piece] = []
    size = 0
    for segment, (first, _) in zip(frame.segments, frame.pieces, strict=True):
        begin = size
        for a, b in _runs(chosen[segment.rows]):
            rows.append(np.arange(first + a, first + b))
            samples.append(np.arange(segment.rows.start + a, segment.rows.start + b))
            pieces.append((size, size + b - a))
            size += b - a
        if size > begin:
            levels.append((begin, size))
    indices = np.concatenate(samples)
    return Part(
        np.concatenate(rows),
        indices,
        seen[indices],
        tuple(pieces),
        tuple(levels) if shared else tuple(pieces),
    )


def _runs(chosen: BoolArray) -> list[Piece]:
    """Ranges in which all are chosen, those of few samples left out."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], chosen.astype(int), [0]])))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= _SHORTEST]
