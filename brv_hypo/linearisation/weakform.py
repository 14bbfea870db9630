"""The weak form of Eq. 2.3: moment columns integrated to transverse rates.

With omega = q + i r, k = Ix / I and Phi the integral of (1 - k) p, the pitch and yaw equations are one,

    d/dt (omega e^{i Phi}) = (q_inf S d / I) (C_m + i C_n) e^{i Phi},

so the derolled rate is a constant plus the integrals of the columns, and its error is the gyro's own: no
differentiation colours it. Integrals run on cubic splines; jumps and ramps at a knot are exact combinations
of the antiderivatives, for any time of the knot, so that knots can be refined continuously.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray, IntArray
from brv_hypo.flight.record import Flight
from brv_hypo.model.term import TimeBasis
from brv_hypo.motion.interpolation import Quadrature, SplineGrid, among, running_integral

# Share of the last step before a segment's end within which what begins is nothing of it: the difference of two
# integrals up to there is rounding, and least squares would fit the last sample's noise by any multiple of that.
_END = 1e-9
SHORTEST = 8  # samples of a segment that is usable


@dataclass(frozen=True)
class Antiderivative:
    """Splines through `values` (m, columns) at nodes and their integrals from the first.

    `weight` (m,), where there is one, multiplies them, linear between nodes: the product is integrated as it is. A
    spline through the product differs from it by more than what a short ramp far from the origin is.
    """

    grid: SplineGrid
    values: ComplexArray
    weight: FloatArray | None = None

    @cached_property
    def _slopes(self) -> ComplexArray:
        return self.grid.slopes(self.values)

    @cached_property
    def at_nodes(self) -> ComplexArray:
        """Integrals up to each node (m, columns)."""
        plain = self.grid.integrals(self.values, self._slopes)
        if self.weight is None:
            return plain
        h, g, s = self.grid.steps, self.values, self._slopes
        moments = h**2 * (3.0 * g[:-1] + 7.0 * g[1:]) / 20.0 + h**3 * (s[:-1] / 30.0 - s[1:] / 20.0)
        start, rate = self.weight[:-1, np.newaxis], self._rates[:, np.newaxis]
        out = np.zeros_like(plain)
        np.cumsum(start * np.diff(plain, axis=0) + rate * moments, axis=0, out=out[1:])
        return out

    @cached_property
    def _rates(self) -> FloatArray:
        """By how much the weight changes per second between nodes (m - 1,)."""
        assert self.weight is not None
        return np.asarray(np.diff(self.weight) / self.grid.steps[:, 0])

    def at(self, time: FloatArray, columns: IntArray) -> ComplexArray:
        """Integral of each column (k,) up to its own time (k,) s."""
        i, u = among(self.grid.time, time)
        h = self.grid.steps[i, 0]
        g, s = self.values[i, columns], self._slopes[i, columns]
        chord = (self.values[i + 1, columns] - g) / h
        bend = (s + self._slopes[i + 1, columns] - 2.0 * chord) / h
        c2, c3 = (chord - s) / h - bend, bend / h
        inside = u * (g + u * (s / 2.0 + u * (c2 / 3.0 + u * c3 / 4.0)))
        if self.weight is not None:
            moment = u**2 * (g / 2.0 + u * (s / 3.0 + u * (c2 / 4.0 + u * c3 / 5.0)))
            inside = self.weight[i] * inside + self._rates[i] * moment
        return np.asarray(self.at_nodes[i, columns] + inside, dtype=complex)


class Integrals(NamedTuple):
    """Antiderivatives over one segment of columns g (m, columns), and of (s - origin) g, which ramps need."""

    plain: Antiderivative
    first: Antiderivative


@dataclass(frozen=True)
class Nodes:
    """Where a segment's moments are evaluated: `time` (k,) s, that which courses are told in, factor of the integrand.

    `rows` are they among the flight's nodes, `samples` (m,) those of them that are the segment's samples.
    """

    time: FloatArray
    coefficient_time: FloatArray
    factor: ComplexArray
    rows: slice
    samples: IntArray | slice


@dataclass(frozen=True)
class WeakSegment:
    """One contiguous part of a flight: derolled rates `observed` (m,) rad/s, factor of the integrand (m,).

    `common_time` (m,) s is the time that flights share, in which courses are told; None where it is their own.
    `finer` are the nodes of its integrals; None where its samples are.
    """

    time: FloatArray
    observed: ComplexArray
    factor: ComplexArray
    flight: int
    rows: slice
    common_time: FloatArray | None = None
    finer: Nodes | None = None

    @cached_property
    def nodes(self) -> Nodes:
        """The nodes of its integrals."""
        return self.finer or Nodes(self.time, self.coefficient_time, self.factor, self.rows, slice(None))

    @property
    def coefficient_time(self) -> FloatArray:
        """The time that courses are told in (m,), s."""
        return self.time if self.common_time is None else self.common_time

    def own_times(self, spans: FloatArray) -> FloatArray:
        """The segment's own times (k,) of times that courses are told in (k,); before it that of its first sample.

        After it infinite: what begins there is nothing of it.
        """
        before, end = self.coefficient_time[-2:]
        shared = self.common_time is not None
        own = np.interp(spans, self.coefficient_time, self.time) if shared else np.maximum(spans, self.time[0])
        return np.where(spans > end - _END * (end - before), np.inf, own)

    @cached_property
    def _grid(self) -> SplineGrid:
        return SplineGrid.on(self.nodes.time)

    def integrate(self, integrands: ComplexArray) -> Integrals:
        """Antiderivatives for columns (k, columns) on the nodes: C_m + i C_n times the factor of the integrand."""
        since = self.nodes.coefficient_time - self.coefficient_time[0]
        return Integrals(Antiderivative(self._grid, integrands), Antiderivative(self._grid, integrands, since))

    def columns(self, integrals: Integrals, which: IntArray, bases: Sequence[TimeBasis]) -> ComplexArray:
        """Columns `which` (k,) times their courses, integrated from the first sample to each sample (m, k)."""
        start, stop = np.array([(basis.start, basis.stop) for basis in bases]).T
        begin, end = self.own_times(start), self.own_times(stop)
        out = self._between(integrals.plain, which, begin, end)
        if (ramps := np.flatnonzero([basis.kind == "ramp" for basis in bases])).size:
            which, (start, stop, begin, end) = which[ramps], (each[ramps] for each in (start, stop, begin, end))
            out[:, ramps] *= self.coefficient_time[0] - start
            out[:, ramps] += self._between(integrals.first, which, begin, end)
            last = np.full(ramps.size, self.time[-1])
            if np.any(end < last):  # what its last value brings after it has ended
                held = np.minimum(stop, self.coefficient_time[-1]) - start
                out[:, ramps] += held * self._between(integrals.plain, which, end, last)
        return out

    def _between(self, integral: Antiderivative, which: IntArray, begin: FloatArray, end: FloatArray) -> ComplexArray:
        """Integral from `begin` (k,) to each sample, 0 before it and constant after `end` (m, k), in its own times."""
        out = integral.at_nodes[self.nodes.samples][:, which]
        base = np.zeros(which.size, dtype=complex)
        late = np.flatnonzero((begin > self.time[0]) & np.isfinite(begin))
        if late.size:
            base[late] = integral.at(begin[late], which[late])
            out -= base
            for j, first in zip(late.tolist(), self.time.searchsorted(begin[late]).tolist(), strict=True):
                out[:first, j] = 0.0
        out[:, np.isposinf(begin)] = 0.0
        early = np.flatnonzero(end < self.time[-1])
        if early.size:
            last = integral.at(end[early], which[early]) - base[early]
            for j, after, value in zip(early.tolist(), self.time.searchsorted(end[early]).tolist(), last, strict=True):
                out[after:, j] = value
        return out


def weak_segments(
    flight: Flight, index: int, common_time: FloatArray | None = None, nodes: Quadrature | None = None
) -> tuple[WeakSegment, ...]:
    """The usable segments of a flight, those of at least `SHORTEST` samples, with their derolled rates.

    `common_time` (n,) s: see `WeakSegment`; `nodes`, those of its integrals, are its samples where not given.
    """
    derotation = np.exp(1j * (1.0 - flight.vehicle.inertia_ratio) * running_integral(flight.time, flight.p))
    factor = derotation * flight.dynamic_pressure * flight.vehicle.moment_scale
    observed, found = (flight.q + 1j * flight.r) * derotation, []
    for a, b in (segment for segment in flight.segments if segment[1] - segment[0] >= SHORTEST):
        own, common, finer = slice(a, b), None if common_time is None else common_time[a:b], None
        if nodes is not None and nodes.spread is not None:
            rows, samples = nodes.rows(a, b), nodes.samples[a:b]
            time = nodes.time[rows]
            coefficient_time = time if common_time is None else nodes.of(common_time)[rows]
            finer = Nodes(time, coefficient_time, nodes.of(factor)[rows], rows, samples - rows.start)
        found.append(WeakSegment(flight.time[own], observed[own], factor[own], index, own, common, finer))
    return tuple(found)
