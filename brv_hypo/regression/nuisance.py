"""What is fitted along in every hypothesis: the motion, the normal force, and the errors of record and vehicle.

No flight has perfect instruments. Each unknown is a history of the residual, linearised once on the fitted, noise-free
motion; those that the record's tolerances bound have that Gaussian prior. Histories are kept on as many rows as the
motion needs.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray, IntArray
from brv_hypo.constants import BEYOND_TOLERANCE
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect, RecordProcess
from brv_hypo.motion.interpolation import DecimatedGrid, decimated_grid
from brv_hypo.motion.responses import RESPONSE_PER_CYCLE
from brv_hypo.regression.channels import Rows, side_by_side
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.propagated_motion import MOTION
from brv_hypo.regression.response import LinearisedFlight

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
        kept = [k for k, item in enumerate(self.items) if item.name not in names]
        place = {k: new for new, k in enumerate(kept)}
        rates, force = (each[:, kept] for each in (self.histories.kept.rates, self.histories.kept.force))
        correlated = np.array([place[k] for k in self.correlated.tolist()], dtype=np.int64)
        items = tuple(self.items[k] for k in kept)
        return Nuisances(items, Histories(self.histories.rows, Rows(rates, force)), correlated, self.noise)

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
    kept = decimated_grid(frame.pieces, min(each.spacing(RESPONSE_PER_CYCLE) for each in flights))
    items: list[Nuisance] = []
    rows: list[Rows] = []
    noise: dict[int, Rows] = {}

    def add(item: Nuisance, history: Rows, shown: Rows | None = None) -> None:
        if np.any(history.rates) or np.any(history.force):
            if shown is not None:
                noise[len(items)] = Rows(kept.of(shown.rates), kept.of(shown.force))
            items.append(item)
            rows.append(Rows(kept.of(history.rates), kept.of(history.force)))

    for number, linearised in enumerate(flights):
        known = {(e.effect, e.component): e.value for e in linearised.reconstruction.effects}
        names, histories, values = linearised.start_and_gravity()
        for name, history, value in zip(names, histories, values, strict=True):
            add(Nuisance(MOTION, name, number, "1", 1.0, float(value)), on_frame(frame, number, history))
        for name, history, value, shown in linearised.random_walk():
            item = Nuisance(MOTION, name, number, "1", 1.0, value)
            add(item, on_frame(frame, number, history), on_frame(frame, number, Rows(shown, np.zeros_like(shown))))
        for error in linearised.reconstruction.input_errors:
            for k, history in enumerate(linearised.input_noise(error)):
                item = Nuisance(error.name, str(k), number, "1", 1.0, 0.0)
                add(item, on_frame(frame, number, history))
        force = linearised.force.columns(linearised.record, linearised.crossflow)
        nothing = np.zeros(force.shape[0], dtype=complex)
        for k, column in enumerate(force.T):
            add(Nuisance("force", str(k), number, "1", 1.0, np.nan), on_frame(frame, number, Rows(nothing, column)))
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
            item = Nuisance(*key, number, component.units, size, present, found, key not in without_prior)
            add(item, on_frame(frame, number, history))
        for mechanism in vehicle:
            if mechanism.of_each_flight(linearised.record.flight):
                for item, rates in _tolerated(frame, number, mechanism):
                    add(item, Rows(rates, np.zeros_like(rates)))
    correlated = np.array(list(noise), dtype=np.int64)
    carried = Nuisances(
        tuple(items),
        Histories(kept, side_by_side(rows)),
        correlated,
        Histories(kept, side_by_side(list(noise.values()))),
    )
    for mechanism in vehicle:
        if not mechanism.of_each_flight(flights[0].record.flight):
            carried = with_shared(carried, frame, mechanism)
    return carried


def with_shared(known: Nuisances, frame: RateFrame, mechanism: Mechanism) -> Nuisances:
    """Those, and what the tolerance of a mechanism allows that all flights share."""
    kept = known.histories.rows
    more = [(item, kept.of(rates)) for item, rates in _tolerated(frame, None, mechanism) if np.any(rates)]
    rows = side_by_side([known.histories.kept, *(Rows(rates, np.zeros_like(rates)) for _, rates in more)])
    return replace(known, items=(*known.items, *(item for item, _ in more)), histories=Histories(kept, rows))


def on_frame(frame: RateFrame, number: int, history: Rows) -> Rows:
    """A flight's history (n,) on all rows of the frame, zero on those of the other flights."""
    rates = np.zeros(frame.observed.size, dtype=complex)
    force = np.zeros_like(rates)
    for segment, (a, b) in zip(frame.segments, frame.pieces, strict=True):
        if segment.flight == number:
            rates[a:b], force[a:b] = history.rates[segment.rows], history.force[segment.rows]
    return Rows(rates, force)


def _tolerated(frame: RateFrame, number: int | None, mechanism: Mechanism) -> list[tuple[Nuisance, ComplexArray]]:
    """The residual rates (rows,) that one sigma of each term of a tolerance leaves on one flight; on all for None."""
    flight = frame.reference if number is None else number
    sizes = mechanism.tolerance(frame.reconstructions[flight].flight)
    if sizes is None:
        return []
    names = [(term.name, term.units) for term in mechanism.terms(frame.motions[flight], {})]
    rates = np.zeros((frame.observed.size, len(names)), dtype=complex)
    for segment, (a, b) in zip(frame.segments, frame.pieces, strict=True):
        if number is None or segment.flight == number:
            motion, nodes = frame.finer[segment.flight], segment.nodes
            for k, term in enumerate(mechanism.terms(motion, {})):
                body = motion.to_body(term.in_plane, term.out_of_plane)[nodes.rows]
                rates[a:b, k] = segment.integrate(body[:, np.newaxis]).plain.at_nodes[nodes.samples, 0]
    return [
        (
            Nuisance(mechanism.name, name, number, units, size, 0.0, stated=number is not None),
            np.asarray(size * rates[:, k], dtype=complex),
        )
        for k, ((name, units), size) in enumerate(zip(names, sizes, strict=True))
    ]
