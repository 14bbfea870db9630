"""What is fitted along in every hypothesis: the motion, the normal force, and the errors of record and vehicle.

No flight has perfect instruments. Each unknown is a history of the residual, linearised once on the fitted, noise-free
motion; those that the record's tolerances bound have that Gaussian prior. Histories are kept on as many rows as the
motion needs.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from brv_hypo.constants import BEYOND_TOLERANCE
from brv_hypo.linearisation.channels import Rows, side_by_side
from brv_hypo.linearisation.frame import RateFrame
from brv_hypo.linearisation.propagated_motion import MOTION
from brv_hypo.linearisation.response import LinearisedFlight
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect, RecordProcess
from brv_hypo.motion.interpolation import DecimatedGrid, decimated_grid, full_grid
from brv_hypo.motion.responses import RESPONSE_PER_CYCLE

# Values of histories that are made at once: 16 bytes each, several times over.
AT_ONCE = 2_000_000


@dataclass(frozen=True)
class FlightHistories:
    """Histories of the unknowns in `places` on one flight: `kept` (m, unknowns) of them, on the rows that `grid` keeps
    of those (`span`) that the flight has of the frame.
    """

    span: slice
    places: IntArray
    grid: DecimatedGrid
    kept: Rows

    def batches(self) -> Iterator[tuple[slice, Rows]]:
        """So many unknowns at once that their histories (rows of the flight, some) stay small."""
        count = self.places.size
        width = max(count, 1) if self.grid.spread is None else max(1, AT_ONCE // self.grid.count)
        for first in range(0, count, width):
            some = slice(first, min(first + width, count))
            yield some, self.all_of(self.kept.of(some))

    def all_of(self, kept: Rows) -> Rows:
        """All rows of the flight of those that are kept."""
        return Rows(self.grid.all_of(kept.rates), self.grid.all_of(kept.force))

    def of(self, history: Rows) -> Rows:
        """What is kept of a history on the rows of the flight."""
        return Rows(self.grid.of(history.rates), self.grid.of(history.force))

    def rates_of(self, values: FloatArray) -> ComplexArray:
        """Sum of the rates (rows of the flight, k) with all unknowns at `values` (unknowns, k)."""
        return self.grid.all_of(self.kept.rates @ values[self.places])

    def beside(self, more: Mapping[int, Rows]) -> FlightHistories:
        """With what is kept of further unknowns, by their places."""
        places = np.append(self.places, np.array(list(more), dtype=np.int64))
        return replace(self, places=places, kept=side_by_side([self.kept, *more.values()]))

    def only(self, chosen: BoolArray, places: IntArray) -> FlightHistories:
        """Those chosen, which have other places."""
        return replace(self, places=places[self.places[chosen]], kept=self.kept.of(chosen))


@dataclass(frozen=True)
class Histories:
    """Histories of all flights in both channels, `shape` (frame rows, unknowns)."""

    shape: tuple[int, int]
    flights: tuple[FlightHistories, ...]

    def of(self, values: FloatArray) -> Rows:
        """Their sum (frame rows, ...) with the unknowns at `values` (unknowns, ...)."""
        out = self._zeros(values.shape[1:])
        for own in self.flights:
            there = values[own.places]
            made = own.all_of(Rows(own.kept.rates @ there, own.kept.force @ there))
            out.rates[own.span], out.force[own.span] = made.rates, made.force
        return out

    def batches(self) -> Iterator[tuple[slice, Rows]]:
        """So many unknowns at once that their histories (frame rows, some) stay small."""
        rows, count = self.shape
        width = max(1, AT_ONCE // rows)
        for first in range(0, count, width):
            some = slice(first, min(first + width, count))
            out = self._zeros((some.stop - first,))
            for own in self.flights:
                mine = np.flatnonzero((own.places >= first) & (own.places < some.stop))
                made, places = own.all_of(own.kept.of(mine)), own.places[mine] - first
                out.rates[own.span, places], out.force[own.span, places] = made.rates, made.force
            yield some, out

    def _zeros(self, shape: tuple[int, ...]) -> Rows:
        rates = np.zeros((self.shape[0], *shape), dtype=complex)
        return Rows(rates, np.zeros_like(rates))


@dataclass(frozen=True)
class Nuisance:
    """One unknown of one flight, or of all (`flight` None).

    `size` is one unit of its history in `units`, the prior's sigma where it has one. `present` is what the
    linearisation holds already of the prior's residual, in units of `size`; NaN where there is no prior. `applied` is
    what was taken out of the record before, in `units`; None for what is not of the record. `stated`: its size is a
    tolerance that the record states.
    """

    name: str
    component: str
    flight: int | None
    units: str
    size: float
    present: float
    applied: float | None = None
    stated: bool = False

    @property
    def label(self) -> str:
        """Name, component and flight, unique within a problem."""
        return self.plain_label + ("" if self.flight is None else f" [flight {self.flight}]")

    @property
    def plain_label(self) -> str:
        """Name and component."""
        return f"{self.name} {self.component}"

    def whole(self, fitted: float) -> float:
        """A fitted value with what was taken out before, in `units`."""
        return fitted * self.size + (self.applied or 0.0)


Errors = Mapping[tuple[str, str], float]
"""Values (SI) of one flight's errors, by effect (or mechanism) and component (or term)."""


def beyond_tolerance(label: str, value: float, size: float, units: str) -> str | None:
    """In words, that the data want an error of so much, though its tolerance (1 sigma) is `size`; None within reach."""
    times = abs(value) / size
    stated = f"{value:.3g}" + ("" if units == "1" else f" {units}")
    return f"{label} is {stated}, {times:.1f} times its tolerance" if times > BEYOND_TOLERANCE else None


@dataclass(frozen=True)
class Nuisances:
    """The unknowns and their histories on the rows of a frame.

    `correlated` are those made of the very noise that the rates show, the random walk of the attitude; `noise` rad/s is
    what one unit of each is of it, in the rates alone.
    """

    items: tuple[Nuisance, ...]
    histories: Histories
    correlated: IntArray
    noise: Histories

    @property
    def bounded(self) -> IntArray:
        """Which of them have a prior."""
        return np.flatnonzero([np.isfinite(item.present) for item in self.items])

    @property
    def present(self) -> FloatArray:
        """Present values of those that have a prior."""
        return np.array([item.present for item in self.items])[self.bounded]

    def without(self, names: frozenset[str]) -> Nuisances:
        """Those of other names."""
        stays = np.array([item.name not in names for item in self.items])
        place = np.cumsum(stays) - 1
        flights = tuple(own.only(stays[own.places], place) for own in self.histories.flights)
        histories = Histories((self.histories.shape[0], int(np.sum(stays))), flights)
        items = tuple(item for item, stay in zip(self.items, stays.tolist(), strict=True) if stay)
        return Nuisances(items, histories, place[self.correlated], self.noise)

    def values(self, fitted: FloatArray, flights: int) -> tuple[Errors, ...]:
        """Fitted unknowns (unknowns,) in SI with what was taken out before, one mapping a flight."""
        found: list[dict[tuple[str, str], float]] = [{} for _ in range(flights)]
        for item, value in zip(self.items, fitted.tolist(), strict=True):
            for own in found if item.flight is None else (found[item.flight],):
                own[item.name, item.component] = item.whole(value)
        return tuple(found)


def nuisances(
    frame: RateFrame,
    flights: Sequence[LinearisedFlight],
    effects: Sequence[RecordEffect],
    vehicle: Sequence[Mechanism],
    free: Sequence[Mapping[tuple[str, str], RecordEffect]] | None = None,
    corrections: Sequence[Errors] | None = None,
) -> Nuisances:
    """Motion, normal force and record effects of every flight, and what the vehicle's tolerances allow.

    `vehicle` are mechanisms that state a tolerance; `free`, one a flight, the effect of each (effect, component) that
    has no prior there, in place of that of the same name; `corrections`, one a flight, what was taken out of its record
    before. What has no influence on a flight is left out.
    """
    known_before = corrections or tuple({} for _ in flights)
    items: list[Nuisance] = []
    of_items: list[FlightHistories] = []
    of_noise: list[FlightHistories] = []
    correlated: list[int] = []
    for number, linearised in enumerate(flights):
        empty = _no_histories(frame, number, linearised)
        rows: dict[int, Rows] = {}
        noise: dict[int, Rows] = {}

        def add(item: Nuisance, history: Rows, shown: ComplexArray | None = None) -> None:
            """One of this flight, its history and the noise that shows in its rates (n,)."""
            own = _on_flight(frame, number, history)  # noqa: B023 - is done with before the next flight
            if np.any(own.rates) or np.any(own.force):
                if shown is not None:
                    show = _on_flight(frame, number, Rows(shown, np.zeros_like(shown)))  # noqa: B023
                    noise[len(correlated)] = empty.of(show)  # noqa: B023
                    correlated.append(len(items))
                rows[len(items)] = empty.of(own)  # noqa: B023
                items.append(item)

        known = {(e.effect, e.component): e.value for e in linearised.reconstruction.effects}
        names, histories, values = linearised.start_and_gravity()
        for name, history, value in zip(names, histories, values, strict=True):
            add(Nuisance(MOTION, name, number, "1", 1.0, float(value)), history)
        for name, history, value, shown in linearised.random_walk():
            add(Nuisance(MOTION, name, number, "1", 1.0, value), history, shown)
        for error in linearised.reconstruction.input_errors:
            for k, history in enumerate(linearised.input_noise(error)):
                add(Nuisance(error.name, str(k), number, "1", 1.0, 0.0), history)
        force = linearised.force.columns(linearised.record, linearised.crossflow)
        nothing = np.zeros(force.shape[0], dtype=complex)
        for k, column in enumerate(force.T):
            add(Nuisance("force", str(k), number, "1", 1.0, np.nan), Rows(nothing, column))
        without_prior = {} if free is None else free[number]
        own = {name: effect for (name, _), effect in without_prior.items()}
        wanted = [
            (effect, component)
            for effect in (*(effect for effect in effects if effect.name not in own), *own.values())
            for component in effect.components(linearised.record.flight)
            if effect.carried or isinstance(effect, RecordProcess) or (effect.name, component.name) in without_prior
        ]
        changes = linearised.effects((effect, component.name, component.size) for effect, component in wanted)
        for (effect, component), history in zip(wanted, changes, strict=True):
            key, size = (effect.name, component.name), component.size
            found = known.get(key, 0.0) + known_before[number].get(key, 0.0)
            present = np.nan if key in without_prior else -found / size
            add(Nuisance(*key, number, component.units, size, present, found, key not in without_prior), history)
        for mechanism in vehicle:
            if mechanism.of_each_flight(linearised.record.flight):
                for item, size, moved in _tolerated(frame, number, mechanism):
                    if np.any(moved):
                        rows[len(items)] = empty.of(Rows(size * moved, np.zeros_like(moved)))
                        items.append(item)
        of_items.append(empty.beside(rows))
        of_noise.append(empty.beside(noise))
    count = frame.observed.size
    carried = Nuisances(
        tuple(items),
        Histories((count, len(items)), tuple(of_items)),
        np.array(correlated, dtype=np.int64),
        Histories((count, len(correlated)), tuple(of_noise)),
    )
    for mechanism in vehicle:
        if not mechanism.of_each_flight(flights[0].record.flight):
            carried = with_shared(carried, frame, mechanism)
    return carried


def with_shared(known: Nuisances, frame: RateFrame, mechanism: Mechanism) -> Nuisances:
    """Those, and what the tolerance of a mechanism allows that all flights share."""
    (count, first), flights = known.histories.shape, known.histories.flights
    found = [_tolerated(frame, number, mechanism, shared=True) for number in range(len(flights))]
    acting = [each for each in zip(*found, strict=True) if any(np.any(moved) for _, _, moved in each)]
    more: list[dict[int, Rows]] = [{} for _ in flights]
    for place, each in enumerate(acting, start=first):
        for own, kept, (_, size, moved) in zip(flights, more, each, strict=True):
            kept[place] = own.of(Rows(size * moved, np.zeros_like(moved)))
    wider = tuple(own.beside(kept) for own, kept in zip(flights, more, strict=True))
    items = (*known.items, *(each[0][0] for each in acting))
    return replace(known, items=items, histories=Histories((count, len(items)), wider))


def _no_histories(frame: RateFrame, number: int, linearised: LinearisedFlight) -> FlightHistories:
    """Those of no unknown yet, on the rows of one flight that are kept."""
    span = _span(frame, number)
    pieces = [(a - span.start, b - span.start) for a, b in frame.pieces if span.start <= a < span.stop]
    grid = decimated_grid(pieces, linearised.spacing(RESPONSE_PER_CYCLE)) if pieces else full_grid(0)
    nothing = np.zeros((grid.size, 0), dtype=complex)
    return FlightHistories(span, np.zeros(0, dtype=np.int64), grid, Rows(nothing, nothing))


def on_frame(frame: RateFrame, number: int, history: Rows) -> Rows:
    """A flight's history (n,) on all rows of the frame, zero on those of the other flights."""
    rates = np.zeros(frame.observed.size, dtype=complex)
    force, span, own = np.zeros_like(rates), _span(frame, number), _on_flight(frame, number, history)
    rates[span], force[span] = own.rates, own.force
    return Rows(rates, force)


def _span(frame: RateFrame, number: int) -> slice:
    """The rows of a frame that are of one flight."""
    own = [piece for segment, piece in zip(frame.segments, frame.pieces, strict=True) if segment.flight == number]
    return slice(own[0][0], own[-1][1]) if own else slice(0, 0)


def _on_flight(frame: RateFrame, number: int, history: Rows) -> Rows:
    """A flight's history (n,) on its rows of the frame."""
    rows = [np.arange(s.rows.start, s.rows.stop) for s in frame.segments if s.flight == number]
    return history.at(np.concatenate([np.zeros(0, dtype=np.int64), *rows]))


def _tolerated(
    frame: RateFrame, number: int, mechanism: Mechanism, shared: bool = False
) -> list[tuple[Nuisance, float, ComplexArray]]:
    """Unknowns of the terms of a tolerance, one sigma of each, and the rates (rows of a flight,) per unit of it.

    `shared`: all flights have it, and the tolerance is that of the flight in whose time histories are.
    """
    flight = frame.reference if shared else number
    sizes = mechanism.tolerance(frame.reconstructions[flight].flight)
    if sizes is None:
        return []
    names = [(term.name, term.units) for term in mechanism.terms(frame.motions[flight], {})]
    terms, motion = mechanism.terms(frame.finer[number], {}), frame.finer[number]
    body = np.stack([motion.to_body(term.in_plane, term.out_of_plane) for term in terms], axis=1)
    own = [segment for segment in frame.segments if segment.flight == number]
    parts = [s.integrate(body[s.nodes.rows]).plain.at_nodes[s.nodes.samples] for s in own]
    rates = np.concatenate([np.zeros((0, len(names)), dtype=complex), *parts])
    of_flight = None if shared else number
    return [
        (Nuisance(mechanism.name, name, of_flight, units, size, 0.0, stated=not shared), size, rates[:, k])
        for k, ((name, units), size) in enumerate(zip(names, sizes, strict=True))
    ]
