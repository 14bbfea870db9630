"""The moment of a model on a flight's motion, and on records that move a little otherwise.

Mechanisms work elementwise (`Motion`): a moment is a function of what the motion is at that instant, and its slopes by
each of these quantities, found once, serve every change of the record. What is made of the past has none, and is
evaluated anew for each.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.constants import MOMENT_SLOPE_STEP
from brv_hypo.mechanisms.contract import Mechanism, Term
from brv_hypo.model.baseline import PitchDamping, StaticMoment
from brv_hypo.model.columns import Column, Theta
from brv_hypo.motion.angles import crossflow_rate, with_crossflow
from brv_hypo.motion.frames import crossflow
from brv_hypo.motion.history import recorded
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.motion import Motion
from brv_hypo.motion.reconstruction import Reconstruction

# The parts of the crossflow and of its rate, as names of quantities.
_TURNED = ("y", "z", "rate y", "rate z")
# Quantities that a record reads, or may not.
_READ = ("p", "q", "r", "velocity", "dynamic_pressure", "mach", "reynolds")

Values = TypeVar("Values", FloatArray, ComplexArray)
MovedRecord = tuple[InertialRecord, ComplexArray]
"""A record of a flight's times, and its crossflow (n,)."""


@dataclass(frozen=True)
class MomentModel:
    """`columns` of `mechanisms` with their `values` (columns,) on a reconstructed flight; linear about a `motion` (m,)
    at its nodes.
    """

    reconstruction: Reconstruction
    mechanisms: Mapping[str, Mechanism]
    columns: tuple[Column, ...]
    values: FloatArray
    motion: Motion

    def about(self, moved: MovedRecord) -> MomentModel:
        """The same about the motion of a record that differs little."""
        changes = {name: change[:, 0] for name, change in self._changes([moved]).items()}
        return replace(self, motion=self._changed(changes))

    def at(self, moved: Sequence[MovedRecord], kept: FloatArray) -> ComplexArray:
        """C_m + i C_n at the nodes (m, records), to first order, of records that differ little, at a crossflow (n,).

        What is tested keeps the pressure and inertia of the linearisation point, which are `kept` (m, records) of the
        record's: its coefficients make up for both, and a hypothesis without it would take an error of either for a
        share of it.
        """
        changes = self._changes(moved)
        always, tested = self._now
        out = always[:, np.newaxis] + tested[:, np.newaxis] * kept
        for name, slope in self._slopes.items():
            if np.any(changes[name]):
                out += slope[:, np.newaxis] * changes[name]
        past = [j for j, column in enumerate(self.columns) if column.theta]
        for k in range(len(moved) if past else 0):
            there = recorded(self._changed({name: change[:, k] for name, change in changes.items()}))
            always, tested = self._moments(past, there)
            out[:, k] += always + tested * kept[:, k]
        return out

    @cached_property
    def _of_the_instant(self) -> list[int]:
        """Columns that are not made of the past."""
        return [j for j, column in enumerate(self.columns) if not column.theta]

    @cached_property
    def _now(self) -> tuple[ComplexArray, ComplexArray]:
        """Their moments (see `_moments`)."""
        return self._moments(self._of_the_instant, self.motion)

    @cached_property
    def _slopes(self) -> dict[str, ComplexArray]:
        """Their slopes (m,) by each quantity that they follow."""
        found = {}
        for name, value in self._quantities.items():
            step = MOMENT_SLOPE_STEP * np.maximum(np.abs(value), 1.0)
            ends = [
                np.sum(self._moments(self._of_the_instant, self._changed({name: sign * step})), axis=0)
                for sign in (1.0, -1.0)
            ]
            slope = np.asarray((ends[0] - ends[1]) / (2.0 * step), dtype=complex)
            if np.any(slope):
                found[name] = slope
        return found

    @cached_property
    def _quantities(self) -> dict[str, FloatArray]:
        """What the motion is at the nodes (m,), by name; without what the record does not read."""
        flight = self.reconstruction.flight
        read = {name: getattr(self.motion, name) for name in _READ if getattr(flight, name) is not None}
        return {**_parts(*_crossflow(self.motion)), **read}

    def _changes(self, moved: Sequence[MovedRecord]) -> dict[str, FloatArray]:
        """How much more each quantity is at the nodes (m, records)."""
        shifts = np.stack([xi for _, xi in moved], axis=1) - self.reconstruction.crossflow[:, np.newaxis]
        rates = np.gradient(shifts, self.reconstruction.flight.time, axis=0)
        usual = _crossflow(self.reconstruction.motion_at_nodes)
        xi, rate = (
            own[:, np.newaxis] + self.reconstruction.nodes.of(each)
            for own, each in zip(usual, (shifts, rates), strict=True)
        )
        turning = self._at_nodes([record.transverse_rate for record, _ in moved])
        found = {**_parts(xi, rate), "q": turning.real, "r": turning.imag}
        for name in self._quantities.keys() - found.keys():
            found[name] = self._at_nodes([getattr(record.flight, name) for record, _ in moved])
        return {
            name: np.broadcast_to(now - self._quantities[name][:, np.newaxis], xi.shape) for name, now in found.items()
        }

    def _at_nodes(self, values: Sequence[Values]) -> Values:
        """What records read (n,) at the nodes (m, records); (m, 1) where they read the same."""
        alike = all(each is values[0] for each in values)
        return self.reconstruction.nodes.of(values[0][:, np.newaxis] if alike else np.stack(values, axis=1))

    def _changed(self, changes: Mapping[str, FloatArray]) -> Motion:
        """The motion with so much more (m,) of some quantities."""
        quantities: dict[str, Any] = {name: self._quantities[name] + change for name, change in changes.items()}
        read = {name: quantities[name] for name in changes if name in _READ}
        if not changes.keys() - read.keys():
            return replace(self.motion, **read)
        y, z, rate_y, rate_z = (self._quantities[name] + changes.get(name, 0.0) for name in _TURNED)
        return replace(with_crossflow(self.motion, y + 1j * z, rate_y + 1j * rate_z), **read)

    def _moments(self, which: Sequence[int], motion: Motion) -> tuple[ComplexArray, ComplexArray]:
        """C_m + i C_n (m,) of some columns on a motion at the nodes: of those that are always there, and of others."""
        plane = np.zeros((2, motion.time.size), dtype=complex)
        found: dict[tuple[str, Theta], dict[str, Term]] = {}
        for j in which:
            column = self.columns[j]
            key = (column.mechanism, column.theta)
            if key not in found:
                terms = self.mechanisms[column.mechanism].terms(motion, dict(column.theta))
                found[key] = {term.name: term for term in terms}
            term, own = found[key][column.term], plane[0 if column.mechanism in self._always else 1]
            own.real += self._courses[j] * term.in_plane
            own.imag += self._courses[j] * term.out_of_plane
        always, others = (motion.to_body(each.real, each.imag) for each in plane)
        return always, others

    @cached_property
    def _always(self) -> frozenset[str]:
        """Mechanisms that are part of every hypothesis: the baseline, and what tolerances of the vehicle bound."""
        own, flight = (StaticMoment.name, PitchDamping.name), self.reconstruction.flight
        return frozenset(
            name for name, each in self.mechanisms.items() if name in own or each.tolerance(flight) is not None
        )

    @cached_property
    def _courses(self) -> list[FloatArray]:
        """Each column's coefficient at the nodes (m,)."""
        time = self.reconstruction.motion_at_nodes.course_time
        return [value * column.course(time) for column, value in zip(self.columns, self.values, strict=True)]


def _crossflow(motion: Motion) -> tuple[ComplexArray, ComplexArray]:
    """The crossflow (m,) of a motion and its rate (m,) 1/s."""
    xi = crossflow(motion.alpha, motion.windward_meridian)
    return xi, crossflow_rate(motion, xi)


def _parts(xi: ComplexArray, rate: ComplexArray) -> dict[str, FloatArray]:
    """A crossflow and its rate as quantities."""
    return dict(zip(_TURNED, (xi.real, xi.imag, rate.real, rate.imag), strict=True))
