"""The weak form of Eq. 2.3: moments integrated to transverse rates, of one segment and of all flights together.

With omega = q + i r, k = Ix / I and Phi the integral of (1 - k) p, the pitch and yaw equations are one,

    d/dt (omega e^{i Phi}) = (q_inf S d / I) (C_m + i C_n) e^{i Phi},

so the derolled rate is a constant plus the integrals of the columns, and its error is the gyro's own: no
differentiation colours it. Integrals run on cubic splines; jumps and ramps at a knot are exact combinations
of the antiderivatives, for any time of the knot, so that knots can be refined continuously.

`RateFrame` has the derolled rates of all flights, and integrates columns to rate histories, for every hypothesis.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from brv_hypo import thresholds as limits
from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from brv_hypo.errors import UnanswerableError
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.checked import checked, read_only
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.model.common_time import CommonTime, OwnTime
from brv_hypo.model.term import Regressor, Theta, TimeBasis, evaluated, summed
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.interpolation import Quadrature, SplineGrid, running_integral
from brv_hypo.motion.motion import Motion, with_in_plane_moment
from brv_hypo.motion.reconstruction import Reconstruction
from brv_hypo.motion.signals import derivatives

# Share of the last step before a segment's end within which what begins is nothing of it: the difference of two
# integrals up to there is rounding, and least squares would fit the last sample's noise by any multiple of that.
_END = 1e-9
SHORTEST = 8  # samples of a segment that is usable


@dataclass(frozen=True)
class Antiderivative:
    """Splines through `values` (m, columns) at nodes and their integrals from the first. `weight` (m,), where there is
    one, multiplies them, linear between nodes: the product is integrated as it is. A spline through the product differs
    from it by more than what a short ramp far from the origin is.
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
        i = self.grid.time[1:-1].searchsorted(time, side="right")  # the interval of nodes that holds each time
        u = time - self.grid.time[i]
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


Integrals = tuple[Antiderivative, Antiderivative]


@dataclass(frozen=True)
class Nodes:
    """Where a segment's moments are evaluated: `time` (k,) s, on the clock of time bases, factor of the integrand.
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
    `common_time` (m,) s is the time that flights share, the clock of time bases; None where it is their own. `finer`
    are the nodes of its integrals; None where its samples are.
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
        """Time on the clock of time bases (m,), s."""
        return self.time if self.common_time is None else self.common_time

    def own_times(self, spans: FloatArray) -> FloatArray:
        """The segment's own times (k,) of those of time bases (k,): before it its first sample's, after it infinite."""
        before, end = self.coefficient_time[-2:]
        own = np.interp(spans, self.coefficient_time, self.time)
        return np.where(spans > end - _END * (end - before), np.inf, own)

    @cached_property
    def _grid(self) -> SplineGrid:
        return SplineGrid.on(self.nodes.time)

    def integrate(self, integrands: ComplexArray) -> Integrals:
        """Antiderivatives of columns (k, columns) on the nodes, C_m + i C_n times the factor of the integrand; and of
        these times the time since the first sample, which ramps need.
        """
        since = self.nodes.coefficient_time - self.coefficient_time[0]
        return Antiderivative(self._grid, integrands), Antiderivative(self._grid, integrands, since)

    def columns(self, integrals: Integrals, which: IntArray, bases: Sequence[TimeBasis]) -> ComplexArray:
        """Columns `which` (k,) times their courses, integrated from the first sample to each sample (m, k)."""
        start, stop = np.array([(basis.start, basis.stop) for basis in bases]).T
        begin, end, (plain, since) = self.own_times(start), self.own_times(stop), integrals
        out = self._between(plain, which, begin, end)
        if (ramps := np.flatnonzero([basis.kind == "ramp" for basis in bases])).size:
            which, (start, stop, begin, end) = which[ramps], (each[ramps] for each in (start, stop, begin, end))
            out[:, ramps] *= self.coefficient_time[0] - start
            out[:, ramps] += self._between(since, which, begin, end)
            last = np.full(ramps.size, self.time[-1])
            if np.any(end < last):  # what its last value brings after it has ended
                held = np.minimum(stop, self.coefficient_time[-1]) - start
                out[:, ramps] += held * self._between(plain, which, end, last)
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
    """The usable segments of a flight, those of at least `SHORTEST` samples, with their derolled rates. `common_time`
    (n,) s: see `WeakSegment`; `nodes`, those of its integrals, are its samples where not given.
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


# ---- All flights ----


Piece = tuple[int, int]

# Values of terms that are kept, of all mechanisms and thetas together: some 100 bytes each.
_KEPT_VALUES = 300_000

_Key = tuple[str, Theta]  # a mechanism's name and its nonlinear parameters
_Place = tuple[Theta, str]  # the name of a term at these


@dataclass(frozen=True)
class _Shapes:
    """Unit moments of one mechanism at one or several thetas, C_m + i C_n (nodes, terms) a flight, and their
    antiderivatives, one a segment. `position` is the place of the term of a theta.
    """

    position: Mapping[_Place, int]
    moments: tuple[ComplexArray, ...]
    integrals: tuple[Integrals, ...]


@dataclass(frozen=True)
class RateFrame:
    """Reconstructed flights as one linear problem; rows run over the samples of all segments. `observed` (rows,) rad/s
    are the derolled rates; `pieces` the row ranges that are contiguous in time. `finer` are the motions with their C_mw
    where moments are integrated (`Reconstruction.nodes`). `common` is the time that the flights share, the clock of
    time bases; None where theirs is each flight's own. `design`, one (k,) a flight at its nodes, is what the vehicle's
    design adds to C_mw beside the columns; empty if nothing.
    """

    reconstructions: tuple[Reconstruction, ...]
    finer: tuple[Motion, ...]
    segments: tuple[WeakSegment, ...]
    mechanisms: Mapping[str, Mechanism]
    common: CommonTime | None = None
    design: tuple[FloatArray, ...] = ()

    @cached_property
    def _evaluated(self) -> dict[_Key, _Shapes]:
        return {}

    @cached_property
    def motions(self) -> tuple[Motion, ...]:
        """Each flight's at its samples."""
        return tuple(each.motion for each in self.reconstructions)

    @cached_property
    def _shown(self) -> tuple[Motion, ...]:
        return tuple(read_only(motion) for motion in self.finer)

    @cached_property
    def observed(self) -> ComplexArray:
        """Derolled transverse rates of all segments (rows,), rad/s."""
        return np.concatenate([segment.observed for segment in self.segments])

    @cached_property
    def pieces(self) -> tuple[Piece, ...]:
        """Row range [a, b) of each segment."""
        ends = np.cumsum([segment.time.size for segment in self.segments])
        return tuple((int(b) - s.time.size, int(b)) for b, s in zip(ends, self.segments, strict=True))

    @property
    def time(self) -> FloatArray:
        """Time of each row (rows,), s."""
        return np.concatenate([segment.time for segment in self.segments])

    @property
    def coefficient_time(self) -> FloatArray:
        """Time on the clock of time bases, of each row (rows,), s."""
        return np.concatenate([segment.coefficient_time for segment in self.segments])

    @cached_property
    def reference(self) -> int:
        """The flight whose clock is that of time bases, in any order; of one clock for all, the longest record."""
        if self.common is not None:
            return self.common.reference
        lengths = [(float(own.time[-1] - own.time[0]), float(np.sum(own.p**2))) for own in self.motions]
        return max(range(len(lengths)), key=lengths.__getitem__)

    def own_time(self, flight: int) -> OwnTime | None:
        """How one flight's time goes with the common one; None where there is none."""
        return None if self.common is None else self.common.flights[flight]

    @property
    def flight_of_row(self) -> FloatArray:
        """Index of the flight of each row (rows,)."""
        return np.concatenate([np.full(segment.time.size, segment.flight) for segment in self.segments])

    def span(self, flight: int) -> slice:
        """The rows of one flight."""
        own = [piece for segment, piece in zip(self.segments, self.pieces, strict=True) if segment.flight == flight]
        return slice(own[0][0], own[-1][1]) if own else slice(0, 0)

    def samples(self, flight: int) -> IntArray:
        """The sample of a flight that each of its rows is."""
        rows = [np.arange(s.rows.start, s.rows.stop) for s in self.segments if s.flight == flight]
        return np.concatenate([np.zeros(0, dtype=np.int64), *rows])

    def columns(self, columns: Sequence[Regressor]) -> ComplexArray:
        """Integrated rate histories (rows, columns) per unit of each coefficient, rad/s."""
        out = np.zeros((self.observed.size, len(columns)), dtype=complex)
        for k, shapes, members, which in self._acting(columns):
            bases = [columns[j].time_basis for j in members]
            out[slice(*self.pieces[k]), members] = self.segments[k].columns(shapes.integrals[k], which, bases)
        return out

    def moments(self, columns: Sequence[Regressor]) -> ComplexArray:
        """C_m + i C_n (rows, columns) per unit of each coefficient."""
        out = np.zeros((self.observed.size, len(columns)), dtype=complex)
        for k, shapes, members, which in self._acting(columns):
            segment, nodes, rows = self.segments[k], self.segments[k].nodes, slice(*self.pieces[k])
            body = shapes.moments[segment.flight][nodes.rows][nodes.samples]
            for j, term in zip(members, which, strict=True):
                out[rows, j] = body[:, term] * columns[j].time_basis(segment.coefficient_time)
        return out

    def with_mechanisms(self, mechanisms: Sequence[Mechanism]) -> RateFrame:
        """The same frame, knowing these mechanisms too."""
        known = {**self.mechanisms, **{mechanism.name: mechanism for mechanism in mechanisms}}
        out, same = replace(self, mechanisms=known), {name for name, it in self.mechanisms.items() if known[name] is it}
        out._evaluated.update({key: found for key, found in self._evaluated.items() if key[0] in same})
        return out

    def of_flight(self, flight: int) -> RateFrame:
        """The frame of one flight alone."""
        segments = tuple(replace(segment, flight=0) for segment in self.segments if segment.flight == flight)
        alone = (self.reconstructions[flight],), (self.finer[flight],)
        return RateFrame(*alone, segments, self.mechanisms, None, self.design[flight : flight + 1])

    def same_motions(self, other: RateFrame) -> bool:
        """Whether the motions are those of another frame but for their in-plane moment."""
        names = [field.name for field in fields(Motion) if field.name not in ("in_plane_moment", "history")]
        return len(self.motions) == len(other.motions) and all(
            getattr(own, name) is getattr(theirs, name)
            for own, theirs in zip(self.motions, other.motions, strict=True)
            for name in names
        )

    def with_in_plane_moment(self, columns: Sequence[Regressor], values: FloatArray) -> RateFrame:
        """The frame with C_mw of Eq. 5.1 from fitted wind-fixed columns and the `design`, others evaluated anew."""
        moments = self.in_plane_moments(columns, values)
        if self.design:
            moments = tuple(own + known for own, known in zip(moments, self.design, strict=True))
        pairs = zip(self.finer, moments, strict=True)
        out = replace(self, finer=tuple(itertools.starmap(with_in_plane_moment, pairs)))
        out._evaluated.update({key: it for key, it in self._evaluated.items() if self.mechanisms[key[0]].wind_fixed})
        return out

    def in_plane_moments(self, columns: Sequence[Regressor], values: FloatArray) -> tuple[FloatArray, ...]:
        """What wind-fixed columns make of C_mw, one (k,) a flight at its nodes."""
        fixed, moments = [(c, values[j]) for j, c in enumerate(columns) if self.mechanisms[c.mechanism].wind_fixed], []
        for number, motion in enumerate(self.finer):
            here = [(column, value) for column, value in fixed if column.acts_on(number)]
            shapes = (term.in_plane for term in evaluated([column for column, _ in here], self.mechanisms, motion))
            weights = (value * column.time_basis(motion.coefficient_time) for column, value in here)
            moments.append(summed(shapes, weights, motion.alpha))
        return tuple(moments)

    def _acting(self, columns: Sequence[Regressor]) -> Iterator[tuple[int, _Shapes, list[int], IntArray]]:
        """Of each segment, by its number, shapes in turn: which columns act there, and each one's term among them."""
        self._evaluate_missing({(column.mechanism, column.theta): None for column in columns})
        for flight in range(len(self.finer)):
            shared: dict[int, tuple[_Shapes, list[int]]] = {}
            for j, column in enumerate(columns):
                if column.acts_on(flight):
                    shapes = self._evaluated[column.mechanism, column.theta]
                    shared.setdefault(id(shapes), (shapes, []))[1].append(j)
            for shapes, members in shared.values():
                places = np.array([shapes.position[columns[j].theta, columns[j].term] for j in members])
                yield from ((k, shapes, members, places) for k, s in enumerate(self.segments) if s.flight == flight)

    def _evaluate_missing(self, wanted: Mapping[_Key, None]) -> None:
        """Shapes that are not known yet, those of a mechanism's thetas together; where many are kept, these alone."""
        kept = {id(shapes): len(shapes.position) for shapes in self._evaluated.values()}
        if sum(kept.values()) * self.observed.size > _KEPT_VALUES:
            for key in self._evaluated.keys() - wanted.keys():
                del self._evaluated[key]
        missing: dict[str, list[Theta]] = {}
        for name, theta in wanted:
            if (name, theta) not in self._evaluated:
                missing.setdefault(name, []).append(theta)
        for name, thetas in missing.items():
            mechanism, moments, position = checked(self.mechanisms[name]), list[ComplexArray](), dict[_Place, int]()
            for motion in self._shown:
                terms = {(theta, t.name): t for theta in thetas for t in mechanism.terms(motion, dict(theta))}
                position = {term: k for k, term in enumerate(terms)}
                body = [motion.to_body(term.in_plane, term.out_of_plane) for term in terms.values()]
                moments.append(np.stack(body, axis=1))
            pairs = [(s, s.nodes.factor[:, np.newaxis] * moments[s.flight][s.nodes.rows]) for s in self.segments]
            shapes = _Shapes(position, tuple(moments), tuple(s.integrate(weighted) for s, weighted in pairs))
            self._evaluated.update({(name, theta): shapes for theta in thetas})


def build_frame(
    reconstructions: Sequence[Reconstruction], mechanisms: Sequence[Mechanism], common: CommonTime | None = None
) -> RateFrame:
    """The frame of flights, of usable segments. Raises UnanswerableError where a vehicle tumbles."""
    for motion, weight in ((rec.motion, rec.flight.dynamic_pressure**2) for rec in reconstructions):
        beyond = motion.alpha > np.radians(limits.TUMBLING_ALPHA)
        if np.sum(weight[beyond]) > limits.TUMBLING_SHARE * np.sum(weight):
            raise UnanswerableError(
                f"the angle of attack reaches {np.degrees(np.max(motion.alpha)):.0f} deg, and is beyond "
                f"{limits.TUMBLING_ALPHA:.0f} deg from {motion.time[np.argmax(beyond)]:.4g} s on: the vehicle tumbles, "
                "and no model here has its moments. Give a window before that (--stop), or after it (--start)."
            )
    if common is not None:
        shared = [own.common_at(rec.motion.time) for own, rec in zip(common.flights, reconstructions, strict=True)]
        pairs = zip(reconstructions, shared, strict=True)
        reconstructions = [replace(rec, motion=replace(rec.motion, common_time=time)) for rec, time in pairs]
    segments = [
        segment
        for number, rec in enumerate(reconstructions)
        for segment in weak_segments(rec.flight, number, common_time=rec.motion.common_time, nodes=rec.nodes)
    ]
    finer, known = (rec.motion_at_nodes for rec in reconstructions), {each.name: each for each in mechanisms}
    return RateFrame(tuple(reconstructions), tuple(finer), tuple(segments), known, common)


# ---- Residual rates as moment coefficients: the residual of a model, in the terms that it is reported in ----


@dataclass(frozen=True)
class ResidualMoments:
    """C_m + i C_n measured less modelled (rows, ...) of a frame, and on which rows it is usable. `noise` (rows,) is the
    standard deviation of C_m and of C_n that the gyros' noise makes of them, by their filter.
    """

    body: ComplexArray
    usable: BoolArray
    noise: FloatArray

    def mean_square(self, rows: BoolArray | IntArray | slice = slice(None)) -> float:
        """Of either coefficient, over all or some rows as far as they are usable; 0 where none is."""
        found = self.body[rows][self.usable[rows]]
        return float(np.mean(np.abs(found) ** 2) / 2.0) if found.size else 0.0

    def mean_square_of_noise(self, rows: BoolArray | IntArray | slice = slice(None)) -> float:
        """Of its noise over the same."""
        found = self.noise[rows][self.usable[rows]]
        return float(np.mean(found**2)) if found.size else 0.0


def residual_moments(frame: RateFrame, records: Sequence[InertialRecord], rates: ComplexArray) -> ResidualMoments:
    """Moments from what a model leaves of the derolled rates, (rows,) rad/s, or several models (rows, models). The
    filter that differentiates the rates acts on measurement and model alike, and rounds both alike.
    """
    body = np.zeros(rates.shape, dtype=complex)
    usable = np.zeros(rates.shape[0], dtype=bool)
    noise = np.full(rates.shape[0], np.inf)
    for segment, (a, b) in zip(frame.segments, frame.pieces, strict=True):
        record, rows = records[segment.flight], segment.rows
        spin = record.spin_rate
        if b - a <= 2 * spin.half_width:
            continue
        both = np.stack([rates[a:b].real.T, rates[a:b].imag.T])
        rate = derivatives(both, spin.order, spin.half_width, record.flight.step)
        body[a:b] = ((rate[0] + 1j * rate[1]) * (np.exp(-1j * record.spin_angle[rows]) / record.moment_scale[rows])).T
        usable[a:b] = (record.measured & spin.interior)[rows]
        noise[a:b] = (record.rate_noise / np.abs(record.moment_scale))[rows]
    return ResidualMoments(body, usable, noise)
