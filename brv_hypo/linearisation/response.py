"""The motion to linearise about, and how rates and specific force change when the record, or its start, changes.

`PropagatedMotion` is a motion by where it starts and how its attitude wanders by the gyros' white noise, a random walk
of a few sines (Karhunen-Loeve): a fit moves both. `LinearisedFlight` propagates from the reconstruction's
start: attitude from the gyros, velocity from forces, gravity and wind. What the reconstruction estimates (direction of
the velocity at the start, gravity, the walk) enters the regression as unknowns with their priors, so that the answer to
a perturbation is that of the whole estimate, to first order: an effect cannot hide in the motion, nor the reverse.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.linearisation.channels import Channels, ForceModel
from brv_hypo.linearisation.moment_model import MomentModel, MovedRecord
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect
from brv_hypo.model.term import Regressor
from brv_hypo.motion.inertial import InertialRecord, NominalMotion, WindStart, gravity_known, inertial_record
from brv_hypo.motion.inputs import ROLL_RATE, smoothed_inputs
from brv_hypo.motion.interpolation import SplineGrid, running_integral, spacing
from brv_hypo.motion.methods import ReconstructionConfig
from brv_hypo.motion.motion import Motion, crossflow, crossflow_rate, recorded, windward_meridian, with_crossflow
from brv_hypo.motion.pipeline import axial_share
from brv_hypo.motion.reconstruction import Reconstruction
from brv_hypo.motion.responses import RESPONSE_STEP, Moved, half_steps, noise_free, perturbed

WALK_FEWEST_MODES = 10  # sines of the attitude's random walk
WALK_MOST_MODES = 80  # bounds the time
# Sines for each cycle of the motion. A walk at frequency f turns the vehicle by the static moment, which is (f_n / f)^2
# of the noise that the walk is made of: half as fast again as the motion, with two sines a cycle, it is lost in it.
WALK_MODES_PER_CYCLE = 3.0
WALK_LEFT_OUT = 0.8  # standard deviations of alpha, of what the sines may leave of the walk


def walk_modes(record: InertialRecord, reconstruction: Reconstruction) -> int:
    """How many sines approximate the random walk. The remainder is less than alpha's own uncertainty, and faster
    than what the motion answers to. The variance beyond the first k of them is 2 / (pi^2 k) of the walk's at its end.
    """
    size = record.gyro_sigma * np.sqrt(record.time[-1] * record.flight.step)
    wanted = 2.0 / np.pi**2 * (size / (WALK_LEFT_OUT * float(np.median(reconstruction.alpha_sigma_on_clock)))) ** 2
    wanted = max(wanted, WALK_MODES_PER_CYCLE * cycles(reconstruction.motion))
    return int(np.clip(np.ceil(wanted), WALK_FEWEST_MODES, WALK_MOST_MODES))


def cycles(motion: Motion) -> float:
    """Cycles of the crossflow over the record, in axes that do not roll."""
    roll = np.asarray(cumulative_trapezoid(motion.p, motion.time, initial=0), dtype=float)
    turned = crossflow(motion.alpha, motion.windward_meridian) * np.exp(1j * roll)
    rate = np.gradient(turned, motion.time)
    frequency = np.linalg.norm(rate) / max(float(np.linalg.norm(turned - turned.mean())), 1e-300)
    return float(frequency * (motion.time[-1] - motion.time[0]) / (2.0 * np.pi))


def walk_sines(record: InertialRecord, count: int) -> tuple[FloatArray, FloatArray]:
    """Sines (n, count) rad of a random walk, of prior variance 1, and the gyros' noise rad/s that they integrate."""
    order, duration, step = np.pi * (np.arange(count) + 0.5), record.time[-1], record.flight.step
    angle = np.outer(record.time / duration, order)
    sigma = record.gyro_walk.sigma_at(order * step / duration)  # of white noise as large at each frequency
    sines = sigma * np.sqrt(2.0 * duration * step) / order * np.sin(angle)
    return sines, sigma * np.sqrt(2.0 * step / duration) * np.cos(angle)


# Names of a motion's unknowns: what a fit says that it has too much of.
MOTION = "motion"
START = ("start y", "start z")
GRAVITY_ERRORS = ("gravity 1", "gravity 2", "gravity 3")  # along `gravity_axes`


def walk_name(axis: str, number: int) -> str:
    """Name of a sine of the walk about an axis, y or z."""
    return f"walk {axis} {number}"


def gravity_axes(nominal: NominalMotion) -> tuple[FloatArray, FloatArray]:
    """Mean (3,) of what is known of gravity, and independent errors of it, 1-sigma each (3, 3), in columns."""
    mean, information = gravity_known(nominal)
    sizes, axes = np.linalg.eigh(information)
    return mean, axes / np.sqrt(sizes)


@dataclass(frozen=True)
class PropagatedMotion:
    """A motion by its `start` and the `walk` (n,) rad of the attitude across the velocity, in axes carried along it."""

    start: WindStart
    walk: ComplexArray

    @classmethod
    def of(cls, record: InertialRecord, reconstruction: Reconstruction) -> PropagatedMotion:
        """That of a reconstruction."""
        nominal = NominalMotion(record, reconstruction.start)
        offset = reconstruction.crossflow - nominal.crossflow
        return cls(reconstruction.start, np.asarray(offset * np.conj(nominal.turn)))

    def less(self, record: InertialRecord, found: Mapping[tuple[str, str], float]) -> PropagatedMotion:
        """The motion without what a fit about it found too much, by (MOTION, name)."""
        across = complex(*(found.get((MOTION, name), 0.0) for name in START))
        errors = gravity_axes(NominalMotion(record, self.start))[1]
        count = sum((MOTION, walk_name("y", number)) in found for number in range(len(found)))
        weights = [complex(*(found[MOTION, walk_name(axis, number)] for axis in "yz")) for number in range(count)]
        return PropagatedMotion(
            self.start.moved(-across, -errors @ [found.get((MOTION, name), 0.0) for name in GRAVITY_ERRORS]),
            self.walk - walk_sines(record, count)[0] @ np.array(weights, dtype=complex),
        )

    def crossflow(self, record: InertialRecord) -> ComplexArray:
        """The crossflow (n,) of a record that moves so."""
        return NominalMotion(record, self.start).with_offset(self.walk)


def linearisation_point(
    reconstruction: Reconstruction, config: ReconstructionConfig, motion: PropagatedMotion | None = None
) -> tuple[InertialRecord, Reconstruction]:
    """The flight with what was found of its errors taken out, and the motion to linearise about. `motion` is that of a
    fit whose errors are out of the flight already: nothing more is taken out then. A new one from the forces alone
    would lie as far off as they leave it, and the next fit as far from linear as the last.
    """
    if motion is not None:  # the flight is taken as it reads, under this gravity
        none_found = tuple(replace(each, value=0.0) for each in reconstruction.effects)
        as_read = replace(reconstruction, corrected=reconstruction.flight, effects=none_found)
        reconstruction = replace(as_read, gravity_body=motion.start.gravity)
    flight, errors = smoothed_inputs(reconstruction, reconstruction.corrected)
    record = inertial_record(flight, config)
    read = replace(
        reconstruction.motion,
        p=flight.p,
        q=record.transverse_rate.real,
        r=record.transverse_rate.imag,
        velocity=flight.velocity,
        dynamic_pressure=flight.dynamic_pressure,
    )
    smooth = replace(reconstruction, flight=flight, motion=read, input_errors=errors)
    if motion is None:
        motion, sines = PropagatedMotion.of(record, smooth), walk_sines(record, walk_modes(record, smooth))[0]
        # The faster part follows errors as they turn with the body, and those are unknowns of their own.
        motion = replace(motion, walk=sines @ np.linalg.lstsq(sines, motion.walk, rcond=None)[0])
    before, after = smooth.crossflow, motion.crossflow(record)
    rate = crossflow_rate(read, before) + np.gradient(after - before, read.time)
    moved = with_crossflow(replace(read, history=None), after, rate)
    moved = replace(
        moved,
        windward_meridian=np.unwrap(windward_meridian(after)),  # not next to that before: near alpha = 0 it is another
        roll_acceleration=SplineGrid.on(record.time).slopes(record.flight.p[:, np.newaxis])[:, 0],
        transverse_acceleration=record.rate_change,
        axial_share=axial_share(record, moved.alpha),
    )
    return record, replace(smooth, motion=recorded(moved))


# ---- What a change of the record does to the residual ----

# Held by `tests.motion.study` and `tests.studies.independent.study`: errors of angles and moments against those stated.
RESPONSE_TURN = 2e-3  # rad of the start's direction that differences are a `RESPONSE_STEP` of; 1 sigma of gravity
MotionUnknown = tuple[str, str, Channels, float, ComplexArray | None]
"""Name, component, derivative of the residual (n,), present value in units of the prior (NaN where there is none), and
the noise (n,) rad/s that one unit of it is in the derolled rates.
"""


@dataclass(frozen=True)
class LinearisedFlight:
    """A reconstructed flight with its model, ready to be perturbed. `columns` and `values` are the moment model;
    `force` and `force_values` (4,) the normal force's; `force_valid` (n,) where that was measured, and no spike.
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
        motion = self.reconstruction.motion
        return spacing(motion.windward_meridian_rate, motion.p, self.record.flight.step, per_cycle)

    def effects(self, wanted: Iterable[tuple[RecordEffect, str, float]]) -> Iterator[Channels]:
        """What components of effects, by these sizes, do to the residual (n,) to first order."""
        return self._derivatives(wanted, self._read)

    def _read(self, errors: Sequence[tuple[RecordEffect, str, float]], share: float) -> list[MovedRecord]:
        """The noise-free record with a share of each error: motion of the measured rates, rates of the model."""
        smooth, found = self._noise_free.record, []
        sizes = [(effect, component, share * size) for effect, component, size in errors]
        flights = [effect.perturb(smooth.flight, name, value) for effect, name, value in sizes]
        moved = self._propagated(self._noise_free, flights)
        for (record, xi), (effect, component, value) in zip(moved, sizes, strict=True):
            read = effect.perturb(self._as_modelled, component, value)
            found.append((replace(record, flight=replace(record.flight, q=read.q, r=read.r)), xi))
        return found

    def _derivatives(
        self, each: Iterable[Moved], moved: Callable[[list[Moved], float], list[MovedRecord]]
    ) -> Iterator[Channels]:
        """Derivatives of the residual (n,) by each of some things; `moved`: records with a share of each."""
        for more, less in half_steps(self.record.flight.samples, each, moved):
            found = self._changes(more, less).times(1.0 / RESPONSE_STEP)
            yield from map(Channels, found.rates.T, found.force.T)

    @cached_property
    def _as_modelled(self) -> Flight:
        """The noise-free flight with the transverse rates of the moment model, constants of integration fitted."""
        smooth = self._noise_free.record
        own, factors, kept = self._unintegrated([(smooth, self.reconstruction.crossflow)])
        nodes = self.reconstruction.nodes
        left = self._integrated(own, nodes.of(factors) * self._moments.usual(nodes.of(kept))).rates[:, 0]
        for a, b in smooth.flight.segments:
            left[a:b] -= left[a:b].mean()
        rates = smooth.flight.q + 1j * smooth.flight.r - left * np.exp(-1j * smooth.spin_angle)
        return replace(smooth.flight, q=rates.real, r=rates.imag)

    @cached_property
    def _noise_free(self) -> NominalMotion:
        """The record as it would read without noise: columns made of measured channels would find that noise."""
        force = self.force.at(self.record.force_scale, self.reconstruction.crossflow, self.force_values)
        return NominalMotion(noise_free(self.record, force), self.reconstruction.start)

    def _propagated(self, nominal: NominalMotion, flights: Sequence[Flight]) -> list[MovedRecord]:
        """The records of flights that differ little, with their crossflows (n,) had the motion started as it did. As
        motions are propagated once errors are out of the record: `drift` would not follow what the air's speed changes
        otherwise than forces change it, and so the next motion would not be the one that was fitted.
        """
        motions = (NominalMotion(each, nominal.start) for each in perturbed(nominal.record, flights))
        here = self.reconstruction.crossflow - nominal.crossflow
        return [(each.record, here + each.crossflow) for each in motions]

    def motion(self) -> Iterator[MotionUnknown]:
        """What the motion and the normal force are fitted by."""
        yield from itertools.chain(self.start_and_gravity(), self.random_walk())
        for error in self.reconstruction.input_errors:
            shapes = error.shapes(self.record.flight.time)
            read = partial(self._with_input_error, error.name)
            for k, history in enumerate(self._derivatives(shapes, read)):
                yield error.name, str(k), history, 0.0, None
        for k, column in enumerate(self.force.columns(self.record, self.reconstruction.crossflow).T):
            yield "force", str(k), Channels(np.zeros_like(column), column), np.nan, None

    def _with_input_error(self, name: str, changes: Sequence[FloatArray], share: float) -> list[MovedRecord]:
        """The records whose input, as smoothed, has a share of each change (n,) too much, the pressure of its size."""
        flight = self.record.flight
        if name == ROLL_RATE:
            read = [replace(flight, p=flight.p + share * each) for each in changes]
        else:
            read = [replace(flight, dynamic_pressure=flight.dynamic_pressure * (1.0 + share * x)) for x in changes]
        return self._propagated(self._nominal, read)

    def start_and_gravity(self) -> Iterator[MotionUnknown]:
        """Direction of the velocity at the start (two, no prior) and gravity (three, as it is known)."""
        start, (mean, errors) = self.reconstruction.start, gravity_axes(self._nominal)
        by_start = self._nominal.by_start(lambda moved: moved.with_offset(self._walk))
        found = self._by_crossflow(np.column_stack([RESPONSE_TURN * by_start[:, :2], by_start[:, 2:] @ errors]).T)
        for name in START:
            yield MOTION, name, next(found).times(1.0 / RESPONSE_TURN), np.nan, None
        for name, value in zip(GRAVITY_ERRORS, np.linalg.solve(errors, start.gravity - mean).tolist(), strict=True):
            yield MOTION, name, next(found), value, None

    def random_walk(self) -> Iterator[MotionUnknown]:
        """What the gyros' white noise makes of the attitude: sines of a random walk across the velocity, of prior 1.
        The integral of -i times the noise is the walk, so that a walk is observed in the rates as well.
        """
        walk, noise = walk_sines(self.record, walk_modes(self.record, self.reconstruction))
        weights = np.linalg.lstsq(walk, self._walk, rcond=None)[0]
        derolled = self._nominal.turn * np.exp(1j * self.record.spin_angle)
        modes = [(axis, part, k) for k in range(weights.size) for axis, part in (("y", 1.0), ("z", 1j))]
        found = self._by_crossflow(part * self._nominal.turn * walk[:, k] for _, part, k in modes)
        for (axis, part, k), change in zip(modes, found, strict=True):
            present = float((weights[k] / part).real)
            yield MOTION, walk_name(axis, k), change, present, 1j * part * derolled * noise[:, k]

    def _by_crossflow(self, changes: Iterable[ComplexArray]) -> Iterator[Channels]:
        """Derivatives of the residual (n,) by changes (n,) of the motion alone."""

        def moved(some: Sequence[ComplexArray], share: float) -> list[MovedRecord]:
            return [(self.record, self.reconstruction.crossflow + share * each) for each in some]

        return self._derivatives(changes, moved)

    @cached_property
    def _walk(self) -> ComplexArray:
        return PropagatedMotion.of(self.record, self.reconstruction).walk

    @cached_property
    def _nominal(self) -> NominalMotion:
        return NominalMotion(self.record, self.reconstruction.start)

    def _changes(self, more: Sequence[MovedRecord], less: Sequence[MovedRecord]) -> Channels:
        """What the residuals (n, records) of some records have more than those of others."""
        nodes = self.reconstruction.nodes
        (own, factors, kept), (others, other_factors, other_kept) = (self._unintegrated(each) for each in (more, less))
        changes = self._moments.changes(more, less, nodes.of(kept - other_kept))
        integrands = nodes.of(0.5 * (factors + other_factors)) * changes
        integrands += nodes.of(factors - other_factors) * self._moments.usual(nodes.of(0.5 * (kept + other_kept)))
        return self._integrated(own - others, integrands)

    def _unintegrated(self, moved: Sequence[MovedRecord]) -> tuple[Channels, ComplexArray, FloatArray]:
        """The residual (n, records) of records at a crossflow but for the moments, the factors of these, and how much
        they keep: pressure and inertia of the linearisation point over the record's (see `MomentModel.usual`).
        """
        records = [record for record, _ in moved]
        angles = {id(record.spin_angle): record.spin_angle for record in records}  # most are the same
        turns = {key: np.exp(1j * angle) for key, angle in angles.items()}
        turn: ComplexArray = np.stack([turns[id(record.spin_angle)] for record in records], axis=1)
        rates = np.stack([each.flight.q + 1j * each.flight.r for each in records], axis=1)
        scale = np.stack([each.moment_scale for each in records], axis=1)
        force = np.stack([each.transverse_force for each in records], axis=1)
        scales = np.stack([each.force_scale for each in records], axis=1)
        force -= self.force.at(scales, np.stack([xi for _, xi in moved], axis=1), self.force_values)
        usual = self.record.moment_scale[:, np.newaxis]
        kept = np.divide(usual, scale, out=np.ones_like(scale), where=scale != 0.0)
        return Channels(rates * turn, force), turn * scale, kept

    def _integrated(self, own: Channels, integrands: ComplexArray) -> Channels:
        """The residual (n, records) with its moments, which are integrated at once."""
        nodes, rates = self.reconstruction.nodes, own.rates.copy()
        for a, b in self.record.flight.segments:
            part = nodes.rows(a, b)
            rates[a:b] -= running_integral(nodes.time[part], integrands[part])[nodes.samples[a:b] - part.start]
        return Channels(rates, own.force)

    @cached_property
    def _moments(self) -> MomentModel:
        motion = self.reconstruction.motion_at_nodes
        return MomentModel(self.reconstruction, self.mechanisms, self.columns, self.values, motion)
