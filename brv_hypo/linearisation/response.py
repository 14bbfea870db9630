"""`LinearisedFlight`: how rates and specific force change when the record, or the start of the motion, changes.

The motion is propagated from the reconstruction's start: attitude from the gyros, velocity from forces, gravity and
wind. What the reconstruction estimates (direction of the velocity at the start, gravity, the random walk of the gyros'
noise) enters the regression as unknowns with their priors, so that the answer to a perturbation is that of the whole
estimate, to first order: an effect cannot hide in the motion, nor the motion's errors pose as an effect.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, TypeVar

import numpy as np

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.linearisation.channels import ForceModel, Histories
from brv_hypo.linearisation.moment_model import MomentModel, MovedRecord
from brv_hypo.linearisation.propagated_motion import (
    GRAVITY,
    MOTION,
    START,
    PropagatedMotion,
    walk_modes,
    walk_name,
    walk_sines,
)
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect
from brv_hypo.model.term import Regressor
from brv_hypo.motion.inertial import (
    InertialRecord,
    WindStart,
    body_crossflow,
    gravity_size,
    transverse_axes,
    wind_direction,
    wind_to_body,
)
from brv_hypo.motion.inputs import ROLL_RATE
from brv_hypo.motion.interpolation import running_integral, spacing
from brv_hypo.motion.reconstruction import Reconstruction
from brv_hypo.motion.responses import AT_ONCE, RESPONSE_STEP, noise_free, perturbed

# Held by `tests.motion.study` and `tests.studies.independent.study`: errors of angles and moments against those stated.
RESPONSE_TURN = 2e-3  # rad of the start's direction that differences are a `RESPONSE_STEP` of; 1 m/s^2 of gravity
Moved = TypeVar("Moved")
MotionUnknown = tuple[str, str, Histories, float, ComplexArray | None]
"""Name, component, derivative of the residual (n,), present value in units of the prior (NaN where there is none), and
the noise (n,) rad/s that one unit of it is in the derolled rates.
"""


@dataclass(frozen=True)
class LinearisedFlight:
    """A reconstructed flight with the model that explains it, ready to be perturbed.

    `columns` and `values` are the moment model; `force` and `force_values` (4,) the normal force's; `force_valid` (n,)
    where the transverse force was measured and is no spike.
    """

    record: InertialRecord
    reconstruction: Reconstruction
    mechanisms: Mapping[str, Mechanism]
    columns: tuple[Regressor, ...]
    values: FloatArray
    force: ForceModel
    force_values: FloatArray
    force_valid: BoolArray

    @cached_property
    def known(self) -> dict[Any, Any]:
        """Histories about this point that are kept once they are found (`nuisance.nuisances`)."""
        return {}

    def spacing(self, per_cycle: int) -> int:
        """Samples from row to row where a cycle of the fastest motion keeps so many rows."""
        return spacing(
            self.reconstruction.motion.windward_meridian_rate,
            self.reconstruction.motion.p,
            self.record.flight.step,
            per_cycle,
        )

    @cached_property
    def crossflow(self) -> ComplexArray:
        """The reconstruction's crossflow (n,)."""
        return self.reconstruction.crossflow

    def effects(self, wanted: Iterable[tuple[RecordEffect, str, float]]) -> Iterator[Histories]:
        """What components of effects, by these sizes, do to the residual (n,) to first order."""
        return self._derivatives(self._quiet_moments, wanted, self._read)

    def _read(self, errors: Sequence[tuple[RecordEffect, str, float]], share: float) -> list[MovedRecord]:
        """The noise-free record with a share of each error: motion of the measured rates, rates of the model."""
        smooth, found = self._noise_free, []
        sizes = [(effect, component, share * size) for effect, component, size in errors]
        records = perturbed(smooth, [effect.perturb(smooth.flight, name, value) for effect, name, value in sizes])
        for record, (effect, component, value) in zip(records, sizes, strict=True):
            read = effect.perturb(self._as_modelled, component, value)
            found.append(replace(record, flight=replace(record.flight, q=read.q, r=read.r)))
        return self._propagated(found)

    def _derivatives(
        self, moments: MomentModel, each: Iterable[Moved], moved: Callable[[list[Moved], float], list[MovedRecord]]
    ) -> Iterator[Histories]:
        """Derivatives of the residual (n,) by each of some things; `moved` has the records that a share of each makes.

        So many at once that the records stay small, to either side.
        """
        remaining = iter(each)
        while some := list(itertools.islice(remaining, 1 + AT_ONCE // (2 * self.record.flight.samples))):
            more, less = (moved(some, sign * 0.5 * RESPONSE_STEP) for sign in (1.0, -1.0))
            found = self._changes(moments, more, less).times(1.0 / RESPONSE_STEP)
            yield from map(Histories, found.rates.T, found.force.T)

    @cached_property
    def _as_modelled(self) -> Flight:
        """The noise-free flight with the transverse rates that the moment model makes, constants of integration fitted.

        A scale of measured rates would hold what the model does not explain, and scale it away.
        """
        smooth = self._noise_free
        own, factors, kept = self._unintegrated(self._propagated([smooth]))
        nodes = self.reconstruction.nodes
        left = self._integrated(own, nodes.of(factors) * self._quiet_moments.usual(nodes.of(kept))).rates[:, 0]
        for a, b in smooth.flight.segments:
            left[a:b] -= left[a:b].mean()
        rates = smooth.flight.q + 1j * smooth.flight.r - left * np.exp(-1j * smooth.spin_angle)
        return replace(smooth.flight, q=rates.real, r=rates.imag)

    @cached_property
    def _noise_free(self) -> InertialRecord:
        """The record as it would read without noise: smoothed rates, the fitted force.

        A column made of a measured channel would hold the same noise as the response, and find itself.
        """
        return noise_free(self.record, self.force.at(self.record, self.crossflow, self.force_values))

    def motion(self) -> Iterator[MotionUnknown]:
        """What the motion and the normal force are fitted by."""
        yield from itertools.chain(self.start_and_gravity(), self.random_walk())
        for error in self.reconstruction.input_errors:
            shapes = error.shapes(self.record.flight.time)
            read = partial(self._with_input_error, error.name)
            for k, history in enumerate(self._derivatives(self._moments, shapes, read)):
                yield error.name, str(k), history, 0.0, None
        for k, column in enumerate(self.force.columns(self.record, self.crossflow).T):
            yield "force", str(k), Histories(np.zeros_like(column), column), np.nan, None

    def _with_input_error(self, name: str, changes: Sequence[FloatArray], share: float) -> list[MovedRecord]:
        """The records whose input, as smoothed, has a share of each change (n,) too much, the pressure of its size."""
        flight = self.record.flight
        if name == ROLL_RATE:
            read = [replace(flight, p=flight.p + share * each) for each in changes]
        else:
            read = [replace(flight, dynamic_pressure=flight.dynamic_pressure * (1.0 + share * x)) for x in changes]
        return self._propagated(perturbed(self.record, read))

    def start_and_gravity(self) -> Iterator[MotionUnknown]:
        """Direction of the velocity at the start (two, no prior) and gravity (three, prior its size)."""
        start, size = self.reconstruction.start, gravity_size(self.record.flight)
        across = [RESPONSE_TURN * axis[0] for axis in transverse_axes(start.direction[np.newaxis])]
        changes = [*(("direction", each) for each in across), *(("gravity", each) for each in np.eye(3))]

        def moved(some: Sequence[tuple[str, FloatArray]], share: float) -> list[MovedRecord]:
            starts = [replace(start, **{name: getattr(start, name) + share * each}) for name, each in some]
            return [each for other in starts for each in self._propagated([self.record], other)]

        present, per_unit = [np.nan, np.nan, *(start.gravity / size).tolist()], [1.0 / RESPONSE_TURN] * 2 + [size] * 3
        found = self._derivatives(self._moments, changes, moved)
        for name, change, unit, value in zip((*START, *GRAVITY), found, per_unit, present, strict=True):
            yield MOTION, name, change.times(unit), value, None

    def random_walk(self) -> Iterator[MotionUnknown]:
        """What the gyros' white noise makes of the attitude: sines of a random walk across the velocity, of prior 1.

        The integral of -i times the noise is the walk, so that a walk is seen in the rates as well.
        """
        turn = wind_to_body(self.record, wind_direction(self.record, self.reconstruction.start))
        walk, noise = walk_sines(self.record, walk_modes(self.record, self.reconstruction))
        weights = PropagatedMotion.of(self.record, self.reconstruction).weights(walk)
        derolled = turn * np.exp(1j * self.record.spin_angle)
        modes = [(axis, part, k) for k in range(weights.size) for axis, part in (("y", 1.0), ("z", 1j))]

        def moved(some: Sequence[tuple[str, complex, int]], share: float) -> list[MovedRecord]:
            return [(self.record, self.crossflow + share * part * turn * walk[:, k]) for _, part, k in some]

        found = self._derivatives(self._moments, modes, moved)
        for (axis, part, k), change in zip(modes, found, strict=True):
            present = float((weights[k] / part).real)
            yield MOTION, walk_name(axis, k), change, present, 1j * part * derolled * noise[:, k]

    def _propagated(self, records: Iterable[InertialRecord], start: WindStart | None = None) -> list[MovedRecord]:
        """Each record with its crossflow (n,) had the motion started there, or as the reconstruction has it."""
        start = start or self.reconstruction.start
        flows = ((each, body_crossflow(each, wind_direction(each, start))) for each in records)
        return [(record, self.crossflow + (flow - self._open_loop)) for record, flow in flows]

    @cached_property
    def _open_loop(self) -> ComplexArray:
        return body_crossflow(self.record, wind_direction(self.record, self.reconstruction.start))

    def _changes(self, moments: MomentModel, more: Sequence[MovedRecord], less: Sequence[MovedRecord]) -> Histories:
        """What the residuals (n, records) of some records have more than those of others."""
        nodes = self.reconstruction.nodes
        (own, factors, kept), (others, other_factors, other_kept) = (self._unintegrated(each) for each in (more, less))
        changes = moments.changes(more, less, nodes.of(kept - other_kept))
        integrands = nodes.of(0.5 * (factors + other_factors)) * changes
        integrands += nodes.of(factors - other_factors) * moments.usual(nodes.of(0.5 * (kept + other_kept)))
        return self._integrated(own - others, integrands)

    def _unintegrated(self, moved: Sequence[MovedRecord]) -> tuple[Histories, ComplexArray, FloatArray]:
        """The residual (n, records) of records at a crossflow but for the moments, the factors of these, and how much
        they keep: pressure and inertia of the linearisation point over the record's (see `MomentModel.usual`).
        """
        records = [record for record, _ in moved]
        angles = {id(record.spin_angle): record.spin_angle for record in records}  # most are the same
        turns = {key: np.exp(1j * angle) for key, angle in angles.items()}
        turn: ComplexArray = np.stack([turns[id(record.spin_angle)] for record in records], axis=1)
        rates = np.stack([each.flight.q + 1j * each.flight.r for each in records], axis=1)
        scale = np.stack([each.moment_scale for each in records], axis=1)
        residual = [each.transverse_force - self.force.at(each, xi, self.force_values) for each, xi in moved]
        usual = self.record.moment_scale[:, np.newaxis]
        kept = np.divide(usual, scale, out=np.ones_like(scale), where=scale != 0.0)
        return Histories(rates * turn, np.stack(residual, axis=1)), turn * scale, kept

    def _integrated(self, own: Histories, integrands: ComplexArray) -> Histories:
        """The residual (n, records) with its moments, which are integrated at once."""
        nodes, rates = self.reconstruction.nodes, own.rates.copy()
        for a, b in self.record.flight.segments:
            part = nodes.rows(a, b)
            rates[a:b] -= running_integral(nodes.time[part], integrands[part])[nodes.samples[a:b] - part.start]
        return Histories(rates, own.force)

    @cached_property
    def _moments(self) -> MomentModel:
        """The moment model about the motion."""
        motion = self.reconstruction.motion_at_nodes
        return MomentModel(self.reconstruction, self.mechanisms, self.columns, self.values, motion)

    @cached_property
    def _quiet_moments(self) -> MomentModel:
        """The moment model about the noise-free record's."""
        (quiet,) = self._propagated([self._noise_free])
        return self._moments.about(quiet, (self.record, self.crossflow))
