"""How the residual answers to a change of the record, or of where the motion starts.

The motion is propagated from the reconstruction's start: attitude from the gyros, velocity from forces,
gravity and wind. What the reconstruction estimates (direction of the velocity at the start, gravity, the
random walk of the gyros' noise) enters the regression as unknowns with their priors, so that the answer to
a perturbation is that of the whole estimate, to first order: an effect cannot hide in the motion, nor the
motion's errors pose as an effect.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray
from brv_hypo.constants import RESPONSE_PULL, RESPONSE_STEP, RESPONSE_TURN
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect, Term
from brv_hypo.model.baseline import PitchDamping, StaticMoment
from brv_hypo.model.columns import Column, Theta
from brv_hypo.motion.angles import angles_of, crossflow_rate
from brv_hypo.motion.effect_responses import AT_ONCE
from brv_hypo.motion.frames import crossflow
from brv_hypo.motion.history import recorded
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.inputs import ROLL_RATE, smooth_channel
from brv_hypo.motion.kept_rows import spacing
from brv_hypo.motion.motion import Motion
from brv_hypo.motion.perturbation import perturbed
from brv_hypo.motion.quadrature import AtNodes
from brv_hypo.motion.reconstruction import Reconstruction
from brv_hypo.motion.smoothing import InputError
from brv_hypo.motion.splines import running_integral
from brv_hypo.motion.wind import (
    WindStart,
    body_crossflow,
    propagated_crossflows,
    transverse_axes,
    wind_direction,
)
from brv_hypo.regression.channels import Rows
from brv_hypo.regression.force import ForceModel
from brv_hypo.regression.propagated_motion import GRAVITY, START, PropagatedMotion, gravity_size, walk_name
from brv_hypo.regression.wander import (
    walk_modes,
    walk_noise,
    walk_sines,
    wind_to_body,
)

Moved = TypeVar("Moved")


@dataclass(frozen=True)
class LinearisedFlight:
    """A reconstructed flight with the model that explains it, ready to be perturbed.

    `columns` and `values` are the moment model; `force` and `force_values` (4,) the normal force's; `force_seen` (n,)
    where the transverse force was measured and is no spike.
    """

    record: InertialRecord
    reconstruction: Reconstruction
    start: WindStart
    mechanisms: Mapping[str, Mechanism]
    columns: tuple[Column, ...]
    values: FloatArray
    force: ForceModel
    force_values: FloatArray
    force_seen: BoolArray

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

    def effects(self, wanted: Iterable[tuple[RecordEffect, str, float]]) -> Iterator[Rows]:
        """What components of effects, by these sizes, do to the residual (n,) to first order, on the fitted, noise-free
        motion.
        """
        for some in self._so_many(wanted):
            both = (
                self._propagated((record, self.start) for record in self._read(some, sign * 0.5 * RESPONSE_STEP))
                for sign in (1.0, -1.0)
            )
            yield from _slopes(*both)

    def _read(self, errors: Sequence[tuple[RecordEffect, str, float]], share: float) -> Iterator[InertialRecord]:
        """The noise-free record with a share of each of some errors: its motion is that of the measured rates, its
        rates the model's.
        """
        smooth = self._noise_free
        sizes = [(effect, component, share * size) for effect, component, size in errors]
        records = perturbed(smooth, [effect.perturb(smooth.flight, name, value) for effect, name, value in sizes])
        for record, (effect, component, value) in zip(records, sizes, strict=True):
            yield _reading(record, effect.perturb(self._as_modelled, component, value))

    def _so_many(self, each: Iterable[Moved]) -> Iterator[list[Moved]]:
        """Lists of what records are moved by, so many at once that the records stay small."""
        remaining = iter(each)
        width = 1 + AT_ONCE // self.record.flight.samples
        while some := list(itertools.islice(remaining, width)):
            yield some

    @cached_property
    def _as_modelled(self) -> Flight:
        """The noise-free flight with the transverse rates that the moment model makes, constants of integration fitted.

        A scale of measured rates would hold what the model does not explain, and scale it away.
        """
        smooth = self._noise_free
        shift = body_crossflow(smooth, wind_direction(smooth, self.start)) - self._open_loop
        left = self._residuals([(smooth, self.crossflow + shift)])[0].rates
        for a, b in smooth.flight.segments:
            left[a:b] -= left[a:b].mean()
        rates = smooth.flight.q + 1j * smooth.flight.r - left * np.exp(-1j * smooth.spin_angle)
        return replace(smooth.flight, q=rates.real, r=rates.imag)

    def effect(self, effect: RecordEffect, component: str, size: float) -> Rows:
        """Derivative of the residual (n,) by one component of a record effect, on the fitted, noise-free motion."""
        (change,) = self.effects([(effect, component, size)])
        return change.times(1.0 / size)

    @cached_property
    def _noise_free(self) -> InertialRecord:
        """The record as it would read without noise: smoothed rates, the fitted force.

        A column made of a measured channel would hold the same noise as the response, and find itself.
        """
        record, flight = self.record, self.record.flight
        modelled = self.force.at(record, self.crossflow, self.force_values)
        noise = record.transverse_force - modelled
        rate = record.transverse_rate
        quiet = replace(
            flight,
            p=smooth_channel(flight, flight.p),
            q=rate.real,
            r=rate.imag,
            ax=smooth_channel(flight, flight.ax),
            ay=flight.ay - noise.real,
            az=flight.az - noise.imag,
            dynamic_pressure=smooth_channel(flight, flight.dynamic_pressure),
            velocity=smooth_channel(flight, flight.velocity),
        )
        return replace(perturbed(record, [quiet])[0], transverse_rate=rate)

    def input_noise(self, error: InputError) -> Iterator[Rows]:
        """Derivatives of the residual (n,) by the weight of each shape of what smoothing left of an input's noise.

        A weight is what the record, as smoothed, has of that shape too much.
        """
        for some in self._so_many(error.shapes(self.record.flight.time)):
            both = (
                self._propagated(
                    (record, self.start)
                    for record in perturbed(self.record, [self._with_input_error(error, share * each) for each in some])
                )
                for share in (0.5 * RESPONSE_STEP, -0.5 * RESPONSE_STEP)
            )
            yield from _slopes(*both)

    def _with_input_error(self, error: InputError, change: FloatArray) -> Flight:
        """The flight whose input reads so much (n,) more, the pressure of its own size."""
        flight = self.record.flight
        if error.name == ROLL_RATE:
            return replace(flight, p=flight.p + change)
        return replace(flight, dynamic_pressure=flight.dynamic_pressure * (1.0 + change))

    def start_and_gravity(self) -> tuple[list[str], list[Rows], FloatArray]:
        """Names, derivatives by what the reconstruction estimates, and present values in units of their prior.

        Direction of the velocity at the start (two, no prior: NaN) and gravity (three, prior its size).
        """
        second, third = transverse_axes(self.start.direction[np.newaxis])
        size = gravity_size(self.record.flight)
        turned = [RESPONSE_TURN * axis[0] for axis in (second, third)]
        pulled = [RESPONSE_PULL * axis for axis in np.eye(3)]
        starts = [replace(self.start, direction=self.start.direction + s * turn) for turn in turned for s in (1, -1)]
        starts += [replace(self.start, gravity=self.start.gravity + s * pull) for pull in pulled for s in (1, -1)]
        per_unit = [0.5 / RESPONSE_TURN] * 2 + [0.5 * size / RESPONSE_PULL] * 3
        moved = list(self._propagated((self.record, start) for start in starts))
        pairs = zip(moved[::2], moved[1::2], per_unit, strict=True)
        rows = [(high - low).times(unit) for high, low, unit in pairs]
        return [*START, *GRAVITY], rows, np.concatenate([[np.nan] * 2, self.start.gravity / size])

    def random_walk(self) -> Iterator[tuple[str, Rows, float, ComplexArray]]:
        """Name, derivative and present value of what the gyros' white noise makes of the attitude, and that noise.

        Sines of a random walk across the velocity (Karhunen-Loeve; prior 1). The noise (n,) rad/s that one unit of each
        is in the derolled rates: the integral of -i times it is the walk, so that a walk is seen in the rates as well.
        """
        turn = wind_to_body(self.record, wind_direction(self.record, self.start))
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
            both = (
                self._residuals([(self.record, self.crossflow + sign * each) for each in half])
                for sign in (1.0, -1.0)
            )
            for (name, number, part, present), change in zip(some, _slopes(*both), strict=True):
                yield name, change, present, 1j * part * derolled * noise[:, number]

    def _propagated(self, moved: Iterable[tuple[InertialRecord, WindStart]]) -> Iterator[Rows]:
        """The residual had the record read so and the motion started there, for each of these in turn."""
        for batch in in_batches(moved):
            shifts = [each - self._open_loop for each in propagated_crossflows(batch)]
            yield from self._residuals(
                [(record, self.crossflow + shift) for (record, _), shift in zip(batch, shifts, strict=True)]
            )

    @cached_property
    def _open_loop(self) -> ComplexArray:
        return body_crossflow(self.record, wind_direction(self.record, self.start))

    def _residuals(self, moved: Sequence[tuple[InertialRecord, ComplexArray]]) -> list[Rows]:
        """The residual of records of the same times at a crossflow; their moments are integrated at once."""
        flight, nodes, known = moved[0][0].flight, self.reconstruction.nodes, AtNodes(self.reconstruction.nodes)
        turns = {id(record.spin_angle): np.exp(1j * record.spin_angle) for record, _ in moved}
        derotations = [turns[id(record.spin_angle)] for record, _ in moved]
        scales = [record.moment_scale for record, _ in moved]
        factors = np.stack([turn * scale for turn, scale in zip(derotations, scales, strict=True)], axis=1)
        integrands: ComplexArray = nodes.of(factors)
        kept = nodes.of(np.stack([self._kept(scale) for scale in scales], axis=1))
        angles = self._angles(np.stack([xi - self.crossflow for _, xi in moved], axis=1))
        for k, (record, _) in enumerate(moved):
            motion = self._moved(record, {name: each[k] for name, each in angles.items()}, known)
            integrands[:, k] *= self._moment(motion, kept[:, k])
        rates = np.stack(
            [(r.flight.q + 1j * r.flight.r) * turn for (r, _), turn in zip(moved, derotations, strict=True)]
        )
        for a, b in flight.segments:
            part = nodes.rows(a, b)
            integral = running_integral(nodes.time[part], integrands[part])
            rates[:, a:b] -= integral[nodes.samples[a:b] - part.start].T
        return [
            Rows(own, record.transverse_force - self.force.at(record, xi, self.force_values))
            for own, (record, xi) in zip(rates, moved, strict=True)
        ]

    def _kept(self, scale: FloatArray) -> FloatArray:
        """Pressure and inertia of the linearisation point over those of a record with this moment scale (n,)."""
        return np.divide(self.record.moment_scale, scale, out=np.ones_like(scale), where=scale != 0.0)

    def _angles(self, shifts: ComplexArray) -> dict[str, Any]:
        """The motions' angles at the nodes (records, m) where the crossflow differs by `shifts` (n, records)."""
        motion, nodes = self.reconstruction.motion_at_nodes, self.reconstruction.nodes
        xi, rate = self._crossflow_at_nodes
        changes = np.gradient(shifts, self.record.flight.time, axis=0)
        moved, moved_rate = (np.ascontiguousarray(nodes.of(each).T) for each in (shifts, changes))
        return angles_of(xi + moved, rate + moved_rate, motion.windward_meridian)

    def _moment(self, motion: Motion, kept: FloatArray) -> ComplexArray:
        """C_m + i C_n of the model at the nodes (m,).

        What is tested keeps the pressure and inertia of the linearisation point, which are `kept` (m,) of the record's:
        its coefficients make up for both, and a hypothesis without it would take an error of either for a share of it.
        """
        inside, outside = np.zeros(motion.time.size), np.zeros(motion.time.size)
        found: dict[tuple[str, Theta], dict[str, Term]] = {}
        for column, course in zip(self.columns, self._courses, strict=True):
            key = (column.mechanism, column.theta)
            if key not in found:
                terms = self.mechanisms[column.mechanism].terms(motion, dict(column.theta))
                found[key] = {term.name: term for term in terms}
            term = found[key][column.term]
            weight = course if column.mechanism in self._always else course * kept
            inside += weight * term.in_plane
            outside += weight * term.out_of_plane
        return motion.to_body(inside, outside)

    @cached_property
    def _courses(self) -> list[FloatArray]:
        """Each column's coefficient at the nodes (m,)."""
        time = self.reconstruction.motion_at_nodes.course_time
        return [value * column.course(time) for column, value in zip(self.columns, self.values, strict=True)]

    @cached_property
    def _always(self) -> frozenset[str]:
        """Mechanisms that are part of every hypothesis: the baseline, and what tolerances of the vehicle bound."""
        own, flight = (StaticMoment.name, PitchDamping.name), self.record.flight
        return frozenset(
            name for name, each in self.mechanisms.items() if name in own or each.tolerance(flight) is not None
        )

    def _moved(self, record: InertialRecord, angles: Mapping[str, Any], known: AtNodes) -> Motion:
        """The motion at the nodes (m,) with these angles and the record's own rates and air data.

        `known`: what was found there before.
        """
        motion, flight = self.reconstruction.motion_at_nodes, record.flight
        rate = known.of(record.transverse_rate)
        moved = replace(
            motion,
            **angles,
            p=known.of(flight.p),
            q=rate.real,
            r=rate.imag,
            velocity=known.of(flight.velocity),
            dynamic_pressure=known.of(flight.dynamic_pressure),
            mach=motion.mach if flight.mach is None else known.of(flight.mach),
            reynolds=motion.reynolds if flight.reynolds is None else known.of(flight.reynolds),
        )
        return recorded(moved) if any(column.theta for column in self.columns) else moved

    @cached_property
    def _crossflow_at_nodes(self) -> tuple[ComplexArray, ComplexArray]:
        """The reconstruction's crossflow (m,) and its rate (m,) 1/s."""
        motion = self.reconstruction.motion_at_nodes
        xi = crossflow(motion.alpha, motion.windward_meridian)
        return xi, crossflow_rate(motion, xi)


def _slopes(more: Iterable[Rows], less: Iterable[Rows]) -> Iterator[Rows]:
    """Derivatives from what half a step to either side leaves."""
    return ((high - low).times(1.0 / RESPONSE_STEP) for high, low in zip(more, less, strict=True))


def _reading(record: InertialRecord, seen: Flight) -> InertialRecord:
    """The record with the transverse rates of another flight; its motion stays."""
    return replace(record, flight=replace(record.flight, q=seen.q, r=seen.r))


def in_batches(
    moved: Iterable[tuple[InertialRecord, Moved]],
) -> Iterator[list[tuple[InertialRecord, Moved]]]:
    """Records of the same times, so many at once that they stay small."""
    batch: list[tuple[InertialRecord, Moved]] = []
    for each in moved:
        time = each[0].flight.time
        if batch and (len(batch) * time.size > AT_ONCE or not np.array_equal(time, batch[0][0].flight.time)):
            yield batch
            batch = []
        batch.append(each)
    if batch:
        yield batch
