"""`LinearisedFlight`: how rates and specific force change when the record, or the start of the motion, changes.

The motion is propagated from the reconstruction's start: attitude from the gyros, velocity from forces, gravity and
wind. What the reconstruction estimates (direction of the velocity at the start, gravity, the random walk of the gyros'
noise) enters the regression as unknowns with their priors, so that the answer to a perturbation is that of the whole
estimate, to first order: an effect cannot hide in the motion, nor the motion's errors pose as an effect.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.linearisation.channels import ForceModel, Histories
from brv_hypo.linearisation.moment_model import MomentModel, MovedRecord
from brv_hypo.linearisation.propagated_motion import (
    GRAVITY,
    START,
    PropagatedMotion,
    walk_modes,
    walk_name,
    walk_noise,
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
from brv_hypo.motion.signals import InputError

# Held by `tests.motion.study` and `tests.studies.independent.study`: errors of angles and moments against those stated.
RESPONSE_TURN = 1e-5  # rad, half the width of differences by the start's direction
RESPONSE_PULL = 5e-3  # m/s^2, the same by gravity
Moved = TypeVar("Moved")


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
        for some in self._so_many(wanted):
            both = (self._read(some, sign * 0.5 * RESPONSE_STEP) for sign in (1.0, -1.0))
            yield from self._slopes(self._quiet_moments, *both)

    def _read(self, errors: Sequence[tuple[RecordEffect, str, float]], share: float) -> Iterator[InertialRecord]:
        """The noise-free record with a share of each error: motion of the measured rates, rates of the model."""
        smooth = self._noise_free
        sizes = [(effect, component, share * size) for effect, component, size in errors]
        records = perturbed(smooth, [effect.perturb(smooth.flight, name, value) for effect, name, value in sizes])
        for record, (effect, component, value) in zip(records, sizes, strict=True):
            read = effect.perturb(self._as_modelled, component, value)
            yield replace(record, flight=replace(record.flight, q=read.q, r=read.r))

    def _so_many(self, each: Iterable[Moved]) -> Iterator[list[Moved]]:
        """Lists of what records are moved by, so many at once that the records stay small, to either side."""
        remaining = iter(each)
        width = 1 + AT_ONCE // (2 * self.record.flight.samples)
        while some := list(itertools.islice(remaining, width)):
            yield some

    @cached_property
    def _as_modelled(self) -> Flight:
        """The noise-free flight with the transverse rates that the moment model makes, constants of integration fitted.

        A scale of measured rates would hold what the model does not explain, and scale it away.
        """
        smooth = self._noise_free
        own, factors, kept = self._unintegrated(self._propagated([(smooth, self.reconstruction.start)]))
        nodes = self.reconstruction.nodes
        (left,) = self._integrated(own, nodes.of(factors) * self._quiet_moments.usual(nodes.of(kept)))
        for a, b in smooth.flight.segments:
            left.rates[a:b] -= left.rates[a:b].mean()
        rates = smooth.flight.q + 1j * smooth.flight.r - left.rates * np.exp(-1j * smooth.spin_angle)
        return replace(smooth.flight, q=rates.real, r=rates.imag)

    @cached_property
    def _noise_free(self) -> InertialRecord:
        """The record as it would read without noise: smoothed rates, the fitted force.

        A column made of a measured channel would hold the same noise as the response, and find itself.
        """
        return noise_free(self.record, self.force.at(self.record, self.crossflow, self.force_values))

    def input_noise(self, error: InputError) -> Iterator[Histories]:
        """Derivatives of the residual (n,) by the weight of each shape of what smoothing left of an input's noise.

        A weight is what the record, as smoothed, has of that shape too much.
        """
        for some in self._so_many(error.shapes(self.record.flight.time)):
            both = (
                perturbed(self.record, [self._with_input_error(error, share * each) for each in some])
                for share in (0.5 * RESPONSE_STEP, -0.5 * RESPONSE_STEP)
            )
            yield from self._slopes(self._moments, *both)

    def _with_input_error(self, error: InputError, change: FloatArray) -> Flight:
        """The flight whose input reads so much (n,) more, the pressure of its own size."""
        flight = self.record.flight
        if error.name == ROLL_RATE:
            return replace(flight, p=flight.p + change)
        return replace(flight, dynamic_pressure=flight.dynamic_pressure * (1.0 + change))

    def start_and_gravity(self) -> Iterator[tuple[str, Histories, float]]:
        """Name, derivative by what the reconstruction estimates, and present value in units of its prior.

        Direction of the velocity at the start (two, no prior: NaN) and gravity (three, prior its size).
        """
        start = self.reconstruction.start
        second, third = transverse_axes(start.direction[np.newaxis])
        size = gravity_size(self.record.flight)
        turned = [RESPONSE_TURN * axis[0] for axis in (second, third)]
        pulled = [RESPONSE_PULL * axis for axis in np.eye(3)]
        both = (
            [
                *(replace(start, direction=start.direction + sign * turn) for turn in turned),
                *(replace(start, gravity=start.gravity + sign * pull) for pull in pulled),
            ]
            for sign in (1.0, -1.0)
        )
        per_unit = [0.5 / RESPONSE_TURN] * 2 + [0.5 * size / RESPONSE_PULL] * 3
        moved = (self._propagated([(self.record, start) for start in starts]) for starts in both)
        changes = self._changes(self._moments, *moved)
        present = [np.nan, np.nan, *(start.gravity / size).tolist()]
        for name, change, unit, value in zip((*START, *GRAVITY), changes, per_unit, present, strict=True):
            yield name, change.times(unit), value

    def random_walk(self) -> Iterator[tuple[str, Histories, float, ComplexArray]]:
        """Name, derivative and present value of what the gyros' white noise makes of the attitude, and that noise.

        Sines of a random walk across the velocity (Karhunen-Loeve; prior 1). The noise (n,) rad/s that one unit of each
        is in the derolled rates: the integral of -i times it is the walk, so that a walk is seen in the rates as well.
        """
        turn = wind_to_body(self.record, wind_direction(self.record, self.reconstruction.start))
        count = walk_modes(self.record, self.reconstruction)
        walk, noise = walk_sines(self.record, count), walk_noise(self.record, count)
        weights = PropagatedMotion.of(self.record, self.reconstruction).weights(walk)
        derolled = turn * np.exp(1j * self.record.spin_angle)
        modes = [
            (walk_name(axis, number), number, part, float(value))
            for number, weight in enumerate(weights)
            for axis, part, value in (("y", 1.0, weight.real), ("z", 1j, weight.imag))
        ]
        for some in self._so_many(modes):
            half = [0.5 * RESPONSE_STEP * part * turn * walk[:, number] for _, number, part, _ in some]
            both = ([(self.record, self.crossflow + sign * each) for each in half] for sign in (1.0, -1.0))
            for (name, number, part, present), change in zip(some, self._changes(self._moments, *both), strict=True):
                yield name, change.times(1.0 / RESPONSE_STEP), present, 1j * part * derolled * noise[:, number]

    def _slopes(self, moments: MomentModel, *both: Iterable[InertialRecord]) -> Iterator[Histories]:
        """Derivatives from records by half a step to either side."""
        moved = (self._propagated((record, self.reconstruction.start) for record in records) for records in both)
        changes = self._changes(moments, *moved)
        return (change.times(1.0 / RESPONSE_STEP) for change in changes)

    def _propagated(self, moved: Iterable[tuple[InertialRecord, WindStart]]) -> list[MovedRecord]:
        """Each record with its crossflow (n,) had the motion started there."""
        return [
            (record, self.crossflow + (body_crossflow(record, wind_direction(record, start)) - self._open_loop))
            for record, start in moved
        ]

    @cached_property
    def _open_loop(self) -> ComplexArray:
        return body_crossflow(self.record, wind_direction(self.record, self.reconstruction.start))

    def _changes(
        self, moments: MomentModel, more: Sequence[MovedRecord], less: Sequence[MovedRecord]
    ) -> list[Histories]:
        """What the residuals of some records have more than those of others; their moments are integrated at once."""
        nodes = self.reconstruction.nodes
        (own, factors, kept), (others, other_factors, other_kept) = (self._unintegrated(each) for each in (more, less))
        changes = moments.changes(more, less, nodes.of(kept - other_kept))
        integrands = nodes.of(0.5 * (factors + other_factors)) * changes
        integrands += nodes.of(factors - other_factors) * moments.usual(nodes.of(0.5 * (kept + other_kept)))
        return self._integrated([one - other for one, other in zip(own, others, strict=True)], integrands)

    def _unintegrated(self, moved: Sequence[MovedRecord]) -> tuple[list[Histories], ComplexArray, FloatArray]:
        """The residual of records at a crossflow but for the moments, the factors (n, records) of these, and how much
        they keep (see `MomentModel.usual`).
        """
        angles = {id(record.spin_angle): record.spin_angle for record, _ in moved}
        turns = {key: np.exp(1j * angle) for key, angle in angles.items()}
        derotations = [turns[id(record.spin_angle)] for record, _ in moved]
        scales = [record.moment_scale for record, _ in moved]
        factors = np.stack([turn * scale for turn, scale in zip(derotations, scales, strict=True)], axis=1)
        own = [
            Histories(
                (record.flight.q + 1j * record.flight.r) * turn,
                record.transverse_force - self.force.at(record, xi, self.force_values),
            )
            for (record, xi), turn in zip(moved, derotations, strict=True)
        ]
        return own, factors, np.stack([self._kept(scale) for scale in scales], axis=1)

    def _integrated(self, own: Sequence[Histories], integrands: ComplexArray) -> list[Histories]:
        """The residual with its moments."""
        nodes, rates = self.reconstruction.nodes, [each.rates.copy() for each in own]
        for a, b in self.record.flight.segments:
            part = nodes.rows(a, b)
            integral = running_integral(nodes.time[part], integrands[part])[nodes.samples[a:b] - part.start]
            for k, each in enumerate(rates):
                each[a:b] -= integral[:, k]
        return [Histories(each, rows.force) for each, rows in zip(rates, own, strict=True)]

    def _kept(self, scale: FloatArray) -> FloatArray:
        """Pressure and inertia of the linearisation point over those of a record with this moment scale (n,)."""
        return np.divide(self.record.moment_scale, scale, out=np.ones_like(scale), where=scale != 0.0)

    @cached_property
    def _moments(self) -> MomentModel:
        """The moment model about the motion."""
        motion = self.reconstruction.motion_at_nodes
        return MomentModel(self.reconstruction, self.mechanisms, self.columns, self.values, motion)

    @cached_property
    def _quiet_moments(self) -> MomentModel:
        """The moment model about the noise-free record's."""
        (quiet,) = self._propagated([(self._noise_free, self.reconstruction.start)])
        return self._moments.about(quiet, (self.record, self.crossflow))
