"""The two channels that a residual has: the rates of Eq. 2.3, and the specific force across the axis.

Moments show in the rates. Instruments and wind show in both, so both are regressed together; each is
divided by its noise. `ForceModel` is the normal force that a hypothesis is fitted with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from brv_hypo.flight.clock import runs
from brv_hypo.linearisation.frame import Piece, RateFrame
from brv_hypo.linearisation.linear import solve_scaled
from brv_hypo.linearisation.whitening import NoiseModel, difference
from brv_hypo.model.term import Regressor
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.interpolation import applied
from brv_hypo.motion.motion import effective
from brv_hypo.motion.signals import ColouredNoise

HELD_OUT_OF = 4  # blocks, of which one is held out
HELD_OUT_BLOCK = 3  # which of them
HELD_OUT_SHORTEST = 8  # rows of a stretch that is fitted or held out


@dataclass(frozen=True)
class Lasting:
    """Noise of rates and force as it is beyond the motion, and the motion's frequency, rad a sample."""

    rates: ColouredNoise
    force: ColouredNoise
    motion: float


@dataclass(frozen=True)
class Noise:
    """Noise models of the two channels: rates (rad/s) and force (m/s^2).

    `thinning`: whitened rows that are averaged into one, for the columns are slow and the noise is white. `lasting` is
    None where the noise was not measured.
    """

    rates: NoiseModel
    force: NoiseModel
    thinning: int = 1
    lasting: Lasting | None = None


@dataclass(frozen=True)
class Histories:
    """One history in both channels (rows,) or (rows, columns): derolled rates rad/s, transverse force m/s^2."""

    rates: ComplexArray
    force: ComplexArray

    def __sub__(self, other: Histories) -> Histories:
        return Histories(self.rates - other.rates, self.force - other.force)

    def times(self, factor: float) -> Histories:
        """The history `factor` times as large."""
        return Histories(factor * self.rates, factor * self.force)

    def at(self, samples: IntArray | slice) -> Histories:
        """The rows of these samples."""
        return Histories(self.rates[samples], self.force[samples])

    def of(self, chosen: IntArray | BoolArray | slice) -> Histories:
        """Some of the columns."""
        return Histories(self.rates[:, chosen], self.force[:, chosen])


@dataclass(frozen=True)
class Part:
    """Some stretches of the flights of a frame.

    `rows` are indices into the frame's rows, `valid` where the force may be used. `pieces` are the ranges that are
    contiguous in time, and `flights` which flight each is of; `levels` the ranges that share one constant of
    integration.
    """

    rows: IntArray
    valid: BoolArray
    pieces: tuple[Piece, ...]
    levels: tuple[Piece, ...]
    flights: tuple[int, ...]

    def of_flight(self, flight: int) -> Part:
        """What of it is of one flight."""
        own = [piece for piece, number in zip(self.pieces, self.flights, strict=True) if number == flight]
        first, last = (own[0][0], own[-1][1]) if own else (0, 0)
        pieces, levels = (
            tuple((a - first, b - first) for a, b in each if first <= a and b <= last) for each in (own, self.levels)
        )
        mine = slice(first, last)
        return Part(self.rows[mine], self.valid[mine], pieces, levels, (flight,) * len(pieces))

    def constants(self) -> ComplexArray:
        """The constants of integration as histories of the rates (rows, 2 levels)."""
        out = np.zeros((self.rows.size, 2 * len(self.levels)), dtype=complex)
        for k, (a, b) in enumerate(self.levels):
            out[a:b, 2 * k], out[a:b, 2 * k + 1] = 1.0, 1j
        return out

    def thinned_pieces(self, noise: Noise) -> tuple[Piece, ...]:
        """Row range of each stretch of time among the thinned rows of one channel."""
        sizes = [len(range(a, b, noise.thinning)) for a, b in self.pieces]
        ends = np.cumsum(sizes)
        return tuple((int(end) - size, int(end)) for end, size in zip(ends, sizes, strict=True))

    def thinned_rows(self, noise: Noise) -> int:
        """Thinned rows of one channel."""
        return self.thinned_pieces(noise)[-1][1] if self.pieces else 0


@dataclass(frozen=True)
class Whitening:
    """Filter, unit noise and thinning of a part's two channels, each as one banded operator."""

    part: Part
    noise: Noise

    def rates(self, rates: ComplexArray) -> FloatArray:
        """The rates (rows, columns), filtered, at unit noise (2 thinned rows, columns); real before imaginary."""
        return _white(self._operators[0], rates)

    def both(self, rows: Histories) -> FloatArray:
        """Both channels: (4 thinned rows, columns), rates first, then force."""
        usable = rows.force * self.part.valid[:, np.newaxis]
        return np.concatenate([self.rates(rows.rates), _white(self._operators[1], usable)])

    @cached_property
    def _operators(self) -> list[sparse.csr_array]:
        """Of rates and force: filter and sums of neighbours over the root of their number, within each stretch."""
        found = []
        for model in (self.noise.rates, self.noise.force):
            blocks = []
            for a, b in self.part.pieces:
                starts = np.append(np.arange(0, b - a, self.noise.thinning), b - a)
                sizes = np.diff(starts)
                sums = sparse.csr_array((np.repeat(1.0 / np.sqrt(sizes), sizes), np.arange(b - a), starts))
                blocks.append(sums @ (model.operator(b - a) / model.sigma))
            found.append(sparse.csr_array(sparse.block_diag(blocks, format="csr")))
        return found


def _white(operator: sparse.csr_array, rows: ComplexArray) -> FloatArray:
    white = applied(operator, rows)
    return np.concatenate([white.real, white.imag])


def first_values(frame: RateFrame, part: Part, columns: Sequence[Regressor]) -> FloatArray:
    """Coefficients (columns,) of moments on a part by plain least squares of the rates' differences."""
    whitening = Whitening(part, Noise(difference(), difference()))
    design = whitening.rates(np.column_stack([frame.columns(columns)[part.rows], part.constants()]))
    return solve_scaled(design, whitening.rates(frame.observed[part.rows, np.newaxis])[:, 0])[: len(columns)]


def side_by_side(rows: Sequence[Histories]) -> Histories:
    """Histories, or columns of them, as columns."""
    return Histories(np.column_stack([r.rates for r in rows]), np.column_stack([r.force for r in rows]))


def whole(frame: RateFrame, valid: BoolArray) -> Part:
    """All rows of a frame; `valid` (rows,) where the force may be used."""
    return part(frame, valid, np.ones(frame.observed.size, dtype=bool), shared=True)


def split(frame: RateFrame, valid: BoolArray, blocks: int) -> tuple[Part, Part]:
    """The part that is fitted and the part that is held out: every fourth of `blocks` even stretches of each flight.

    The rates on both sides of a held-out stretch share a constant of integration: what the model says of
    the moments between is felt, the samples between are not. Held-out stretches have a constant each.
    """
    held = np.zeros(frame.observed.size, dtype=bool)
    for number in range(len(frame.reconstructions)):
        own = frame.flight_of_row == number
        time = frame.time[own]
        if time.size:
            edges = np.linspace(time.min(), time.max(), blocks + 1)
            held[own] = np.searchsorted(edges, time, side="right").clip(1, blocks) % HELD_OUT_OF == HELD_OUT_BLOCK
    return part(frame, valid, ~held, shared=True), part(frame, valid, held, shared=False)


def part(frame: RateFrame, valid: BoolArray, chosen: BoolArray, *, shared: bool) -> Part:
    """The part of the frame whose rows are chosen (rows,); stretches of few samples are left out.

    `shared`: one constant of integration for all stretches of a segment of the record.
    """
    rows: list[IntArray] = []
    pieces: list[Piece] = []
    levels: list[Piece] = []
    flights: list[int] = []
    size = 0
    for segment, (first, last) in zip(frame.segments, frame.pieces, strict=True):
        begin = size
        for a, b in (run for run in runs(chosen[first:last]) if run[1] - run[0] >= HELD_OUT_SHORTEST):
            rows.append(np.arange(first + a, first + b))
            pieces.append((size, size + b - a))
            flights.append(segment.flight)
            size += b - a
        if size > begin:
            levels.append((begin, size))
    indices = np.concatenate(rows)
    ends = (tuple(pieces), tuple(levels if shared else pieces), tuple(flights))
    return Part(indices, valid[indices], *ends)


@dataclass(frozen=True)
class ForceModel:
    """The normal force: f_y + i f_z = sum of coefficients times columns (CONVENTIONS, normal force).

    The reconstruction's `slope` (n,) 1/rad at alpha = 0 and its `bend` 1/rad^3, with a parabola in time for what they
    err by, and a bend of its own.
    """

    slope: FloatArray
    bend: float = 0.0

    def columns(self, record: InertialRecord, xi: ComplexArray) -> ComplexArray:
        """Columns (n, 4) at the crossflow xi (n,)."""
        own = effective(xi)
        flow, square = -record.force_scale * own, np.abs(own) ** 2
        parabola = np.vander(np.linspace(-1.0, 1.0, self.slope.size), 3, increasing=True)
        slopes = (flow * (self.slope + self.bend * square))[:, np.newaxis] * parabola
        return np.column_stack([slopes, flow * self.slope * square])

    def at(self, record: InertialRecord, xi: ComplexArray, values: FloatArray) -> ComplexArray:
        """The force (n,) m/s^2 with these coefficients (4,) at the crossflow xi (n,)."""
        return np.asarray(self.columns(record, xi) @ values)
