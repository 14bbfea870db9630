"""What is fitted along in every hypothesis: the motion, the normal force, and the errors of record and vehicle.

No flight has perfect instruments. Each unknown is a history of the residual, linearised once on the fitted, noise-free
motion; those that the record's tolerances bound have that Gaussian prior. Histories have the rows that motion needs.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from brv_hypo.linearisation.channels import Channels, side_by_side
from brv_hypo.linearisation.frame import RateFrame
from brv_hypo.linearisation.response import MOTION, LinearisedFlight
from brv_hypo.mechanisms.contract import Component, Mechanism, RecordEffect, RecordProcess
from brv_hypo.model.term import term_column
from brv_hypo.motion.interpolation import DecimatedGrid, decimated_grid
from brv_hypo.motion.responses import RESPONSE_PER_CYCLE

# Probability that the largest of a result's errors of record and vehicle, each drawn at its tolerance, is named as
# beyond it (one flight has 53 of them, and beyond 3 tolerances is one in 7 of such flights).
BEYOND_CHANCE = 0.01
# Values of histories that are made at once: 16 bytes each, several times over.
AT_ONCE = 2_000_000


@dataclass(frozen=True)
class FlightHistories:
    """Histories of the unknowns in `places` on one flight: `kept` (m, unknowns) of them, on the rows that `grid` keeps
    of those (`span`) that the flight has of the frame. Those in `walks` are of the very noise that the rates show;
    `noise` (m, walks) rad/s is one unit of each.
    """

    span: slice
    grid: DecimatedGrid
    places: IntArray
    kept: Channels
    walks: IntArray
    noise: ComplexArray

    def at_once(self, count: int) -> list[slice]:
        """Of `count` unknowns so many at once that their histories (rows of the flight, some) stay small."""
        width = max(count, 1) if self.grid.spread is None else max(1, AT_ONCE // self.grid.spread.shape[0])
        return [slice(first, min(first + width, count)) for first in range(0, count, width)]

    def all_of(self, kept: Channels) -> Channels:
        """All rows of the flight of those that are kept."""
        return Channels(self.grid.all_of(kept.rates), self.grid.all_of(kept.force))

    def beside(self, more: Mapping[int, Channels]) -> FlightHistories:
        """With what is kept of further unknowns, by their places."""
        places = np.append(self.places, np.array(list(more), dtype=np.int64))
        return replace(self, places=places, kept=side_by_side([self.kept, *more.values()]))

    def only(self, chosen: BoolArray, places: IntArray) -> FlightHistories:
        """Those chosen, all of the walk among them; all have other places."""
        own, walks = places[self.places[chosen]], places[self.walks]
        return replace(self, places=own, kept=self.kept.of(chosen), walks=walks)


@dataclass(frozen=True)
class Nuisance:
    """One unknown of one flight, or of all (`flight` None). `size` is one unit of its history in `units`, the prior's
    sigma where it has one. `present` is what the linearisation holds already of the prior's residual, in units of
    `size`; NaN where there is no prior. `applied` is what was taken out of the record before, in `units`; None for what
    is not of the record. `stated`: its size is a tolerance that the record states.
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


def beyond_level(count: int) -> float:
    """Tolerances that the largest of so many errors, drawn at theirs, exceeds with the probability `BEYOND_CHANCE`."""
    return float(-ndtri(0.5 * BEYOND_CHANCE / max(count, 1)))


def beyond_tolerance(label: str, value: float, size: float, units: str, count: int) -> str | None:
    """In words: the data imply an error of so much (1 sigma: `size`); None where one of so many may be so large."""
    times = abs(value) / size
    stated = f"{value:.3g}" + ("" if units == "1" else f" {units}")
    return f"{label} is {stated}, {times:.1f} times its tolerance" if times > beyond_level(count) else None


@dataclass(frozen=True)
class Nuisances:
    """The unknowns and their histories on the `rows` of a frame, flight by flight."""

    items: tuple[Nuisance, ...]
    rows: int
    flights: tuple[FlightHistories, ...]

    @property
    def bounded(self) -> IntArray:
        """Which of them have a prior."""
        return np.flatnonzero([np.isfinite(item.present) for item in self.items])

    @property
    def present(self) -> FloatArray:
        """Present values of those that have a prior."""
        return np.array([item.present for item in self.items])[self.bounded]

    def histories(self, values: FloatArray) -> Channels:
        """Their sum (frame rows, ...) with the unknowns at `values` (unknowns, ...)."""
        rates = np.zeros((self.rows, *values.shape[1:]), dtype=complex)
        force = np.zeros_like(rates)
        for own in self.flights:
            there = values[own.places]
            made = own.all_of(Channels(own.kept.rates @ there, own.kept.force @ there))
            rates[own.span], force[own.span] = made.rates, made.force
        return Channels(rates, force)

    def without(self, names: frozenset[str]) -> Nuisances:
        """Those of other names."""
        stays = np.array([item.name not in names for item in self.items])
        flights = tuple(own.only(stays[own.places], np.cumsum(stays) - 1) for own in self.flights)
        items = tuple(item for item, stay in zip(self.items, stays.tolist(), strict=True) if stay)
        return Nuisances(items, self.rows, flights)

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
    """Motion, normal force and record effects of every flight, and what the vehicle's tolerances allow. `vehicle` are
    mechanisms that state a tolerance; `free`, one a flight, the effect of each (effect, component) that has no prior
    there, in place of that of the same name; `corrections`, one a flight, what was taken out of its record before. What
    has no influence on a flight is left out.
    """
    before, frame = corrections or tuple({} for _ in flights), frame.with_mechanisms(vehicle)
    items: list[Nuisance] = []
    found: list[FlightHistories] = []
    for number, linearised in enumerate(flights):
        flight, known = linearised.record.flight, linearised.known
        samples, span = frame.samples(number), frame.span(number)
        pieces = [(a - span.start, b - span.start) for a, b in frame.pieces if span.start <= a < span.stop]
        grid = decimated_grid(pieces, linearised.spacing(RESPONSE_PER_CYCLE))
        if MOTION not in known:
            known[MOTION] = [
                (
                    Nuisance(name, component, number, "1", 1.0, value),
                    _kept(grid, history.at(samples)),
                    None if noise is None else grid.of(noise[samples]),
                )
                for name, component, history, value, noise in linearised.motion()
            ]
        errors = _of_record(number, linearised, effects, free[number] if free else {}, before[number])
        missing = [each for each in errors if _key(*each[:2]) not in known]
        changes = linearised.effects((effect, component.name, component.size) for effect, component, _ in missing)
        for (effect, component, _), history in zip(missing, changes, strict=True):
            known[_key(effect, component)] = _kept(grid, history.at(samples))
        of_record = ((item, known[_key(effect, component)], None) for effect, component, item in errors)
        of_vehicle = (
            (item, _kept(grid, history), None)
            for mechanism in vehicle
            if mechanism.of_each_flight(flight)
            for item, history in _tolerated(frame, number, mechanism)
        )
        rows, noises = dict[int, Channels](), dict[int, ComplexArray]()
        for item, history, noise in itertools.chain(known[MOTION], of_record, of_vehicle):
            if np.any(history.rates) or np.any(history.force):
                if noise is not None:
                    noises[len(items)] = noise
                rows[len(items)] = history
                items.append(item)
        nothing = np.zeros((grid.size, 0), dtype=complex)
        walks, noise = np.array(list(noises), dtype=np.int64), np.column_stack([nothing, *noises.values()])
        empty = FlightHistories(span, grid, walks[:0], Channels(nothing, nothing), walks, noise)
        found.append(empty.beside(rows))
    whole = Nuisances(tuple(items), frame.observed.size, tuple(found))
    for mechanism in vehicle:
        if not mechanism.of_each_flight(flights[0].record.flight):
            whole = with_shared(whole, frame, mechanism)
    return whole


def _key(effect: RecordEffect, component: Component) -> tuple[str, str]:
    """By which a history is kept: the effect with all that was set of it, as the splines of a process."""
    return f"{effect!r} {vars(effect)}", component.name


def _kept(grid: DecimatedGrid, history: Channels) -> Channels:
    """What is kept of a history on the rows of a flight."""
    return Channels(grid.of(history.rates), grid.of(history.force))


def _of_record(
    number: int,
    linearised: LinearisedFlight,
    effects: Sequence[RecordEffect],
    free: Mapping[tuple[str, str], RecordEffect],
    before: Errors,
) -> list[tuple[RecordEffect, Component, Nuisance]]:
    """The errors of one record that are fitted along."""
    without_prior = {name: effect for (name, _), effect in free.items()}
    corrected, found = {(each.effect, each.component): each.value for each in linearised.reconstruction.effects}, []
    for effect in (*(each for each in effects if each.name not in without_prior), *without_prior.values()):
        for component in effect.components(linearised.record.flight):
            key, size = (effect.name, component.name), component.size
            if effect.carried or isinstance(effect, RecordProcess) or key in free:
                applied = corrected.get(key, 0.0) + before.get(key, 0.0)
                present = np.nan if key in free else -applied / size
                item = Nuisance(*key, number, component.units, size, present, applied, key not in free)
                found.append((effect, component, item))
    return found


def with_shared(known: Nuisances, frame: RateFrame, mechanism: Mechanism) -> Nuisances:
    """Those, and what the tolerance of a mechanism allows that all flights share."""
    found = [_tolerated(frame, number, mechanism, shared=True) for number in range(len(known.flights))]
    acting = [each for each in zip(*found, strict=True) if any(np.any(history.rates) for _, history in each)]
    flights, places = [], range(len(known.items), len(known.items) + len(acting))
    for number, own in enumerate(known.flights):
        kept = [_kept(own.grid, each[number][1]) for each in acting]
        flights.append(own.beside(dict(zip(places, kept, strict=True))))
    return replace(known, items=(*known.items, *(each[0][0] for each in acting)), flights=tuple(flights))


def on_frame(frame: RateFrame, number: int, history: Channels) -> Channels:
    """A flight's history (n,) on all rows of the frame, zero on those of the other flights."""
    rates = np.zeros(frame.observed.size, dtype=complex)
    force, span, own = np.zeros_like(rates), frame.span(number), history.at(frame.samples(number))
    rates[span], force[span] = own.rates, own.force
    return Channels(rates, force)


def _tolerated(
    frame: RateFrame, number: int, mechanism: Mechanism, shared: bool = False
) -> list[tuple[Nuisance, Channels]]:
    """Unknowns of a tolerance's terms, with histories on the rows of a flight; `shared`: all flights have it."""
    sizes = mechanism.tolerance(frame.reconstructions[frame.reference if shared else number].flight)
    terms = () if sizes is None else mechanism.terms(frame.motions[number], {})
    columns = [term_column(mechanism, term, flight=number) for term in terms]
    flight, rates = None if shared else number, frame.columns(columns)[frame.span(number)]
    return [
        (
            Nuisance(mechanism.name, column.term, flight, column.units, size, 0.0, stated=not shared),
            Channels(size * own, np.zeros_like(own)),
        )
        for column, size, own in zip(columns, sizes or (), rates.T, strict=True)
    ]
