"""`Perturbation`: one error of a record with its size; the linear response of motion and moments to it.

`perturbed` gives the inertial record under it, `half_steps` both sides of a central difference about a noise-free
flight: smoothed rates, speed and pressure, and the normal force as fitted. A regressor made from measured channels
would hold the noise of the response, and find itself. `effect_responses` are the differences as a reconstruction needs
them, whose motion moves by `drift`; brv_hypo/linearisation/response.py has those of `compare`.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import astuple, dataclass, replace
from typing import Any, TypeVar

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.errors import UnanswerableError
from brv_hypo.flight.record import ACCELEROMETERS, CHANNELS, GYROS, OPTIONAL_CHANNELS, Flight, Vehicle
from brv_hypo.motion.inertial import InertialRecord, arm_acceleration, body_attitude, sensed_force
from brv_hypo.motion.interpolation import DecimatedGrid, decimated_grid, running_integral, spacing
from brv_hypo.motion.motion import windward_meridian
from brv_hypo.motion.signals import differentiated, smooth_channel

# Width of differences by errors of the record, in standard deviations: what is of second order in it would separate
# errors that the record cannot (both clocks of the inertial unit late by 1 sigma is a motion 1 sigma later).
RESPONSE_STEP = 1e-2
RESPONSE_PER_CYCLE = 24  # samples of the fastest motion that carry what errors do: 2e-6 of it is lost between them

Moved = TypeVar("Moved")
AT_ONCE = 60_000  # samples of perturbed records that are held at once, some 200 bytes each
MOST_NAMED = 3  # errors named where none can be corrected


@dataclass(frozen=True)
class Perturbation:
    """One component of an error that a record may have, as likely as N(0, size^2)."""

    effect: str  # name of the record effect
    component: str  # which of its components
    units: str  # SI units of size and value
    size: float  # 1 sigma
    apply: Callable[[Flight, float], Flight]  # the record as it would read had the error that value more


def superposed(flight: Flight, variants: Iterable[Flight]) -> Flight:
    """The flight with what each of some variants of it has otherwise: changes of channels, wind and vehicle are added.
    One after the other they would act on each other too: by which axis comes first, and so by how the axes are rolled.
    """
    changed: dict[str, Any] = {}
    for variant in variants:
        for name in (*CHANNELS, *OPTIONAL_CHANNELS, "wind"):
            before, other = getattr(flight, name), getattr(variant, name)
            if other is not before:
                # A wind that was not known was none.
                known = changed.get(name, before)
                changed[name] = other if known is before else known + (other - (0.0 if before is None else before))
        if variant.vehicle is not flight.vehicle:
            known = changed.get("vehicle", flight.vehicle)
            before, other, known = (np.hstack(astuple(each)) for each in (flight.vehicle, variant.vehicle, known))
            mass, ixx, iyy, length, area, x, y, z = (known + (other - before)).tolist()
            changed["vehicle"] = Vehicle(mass, ixx, iyy, length, area, (x, y, z))
    return replace(flight, **changed)


def perturbed(record: InertialRecord, flights: Sequence[Flight]) -> list[InertialRecord]:
    """The inertial records of flights that differ little from the one of `record`. The filter that smooths the rates is
    not chosen anew: a derivative must not see that choice.
    """
    before, time = record.flight, record.time
    turned = [k for k, flight in enumerate(flights) if _differ(flight, before, GYROS)]
    turns: dict[int, dict[str, Any]] = {}
    if turned:
        measured = np.stack([flights[k].q + 1j * flights[k].r for k in turned], axis=1)
        rolls, attitudes = body_attitude(time, np.stack([flights[k].p for k in turned], axis=1), measured)
        more = measured - (before.q + 1j * before.r)[:, np.newaxis]
        together = {
            "roll": rolls,
            "attitude": attitudes,
            "transverse_rate": record.transverse_rate[:, np.newaxis] + more,
            "rate_change": record.rate_change[:, np.newaxis] + np.gradient(more, time, axis=0),
        }
        for j, k in enumerate(turned):
            turns[k] = {name: np.ascontiguousarray(each[:, j]) for name, each in together.items()}
    swing, found = _swing(record, before), []
    for k, flight in enumerate(flights):
        moved, force, spin_angle = replace(record, flight=flight, **turns.get(k, {})), record.force, record.spin_angle
        if _differ(flight, before, ACCELEROMETERS):
            force = force + (sensed_force(flight) - sensed_force(before))
        if k in turns or flight.vehicle.accelerometer_position != before.vehicle.accelerometer_position:
            force = force + swing
            force -= _swing(moved, flight)
        if k in turns or flight.vehicle.inertia_ratio != before.vehicle.inertia_ratio:
            spin_angle = (1.0 - flight.vehicle.inertia_ratio) * moved.roll
        found.append(replace(moved, spin_angle=spin_angle, force=force))
    return found


def _differ(flight: Flight, before: Flight, names: Sequence[str]) -> bool:
    return any(getattr(flight, name) is not getattr(before, name) for name in names)


def _swing(record: InertialRecord, flight: Flight) -> FloatArray:
    """Acceleration (n, 3) m/s^2 that the declared arm of a flight makes of a record's rates."""
    p_change, arm = np.gradient(flight.p, flight.time), flight.vehicle.accelerometer_position
    return arm_acceleration(flight.p, p_change, record.transverse_rate, record.rate_change, arm)


def drift(record: InertialRecord, crossflow: ComplexArray, records: Sequence[InertialRecord]) -> FloatArray:
    """Change (n, 3, k) m/s, in the axes of the first sample, of the velocity relative to the air in the body. The
    motion, of `crossflow` (n,), starts as it did. What acts across the velocity turns it, and a turned attitude.
    """
    forward = np.sqrt(np.maximum(1.0 - np.abs(crossflow) ** 2, 0.0))
    flow = record.flight.velocity[:, None] * np.stack([forward, crossflow.real, crossflow.imag], axis=1)
    velocity = np.einsum("nij,nj->ni", record.attitude, flow)
    impulses = np.zeros((crossflow.size, 3, len(records)))
    pulled = [k for k, r in enumerate(records) if r.force is not record.force or r.attitude is not record.attitude]
    if pulled:
        before = record.force_inertial
        pulls = np.stack([records[k].force_inertial - before for k in pulled], axis=2)
        impulses[:, :, pulled] = running_integral(record.time, pulls)
    known = [np.zeros((1, 3)) if each.flight.wind is None else each.flight.wind for each in (record, *records)]
    calm, *winds = (wind - wind[0] for wind in known)
    impulses -= np.stack([np.broadcast_to(wind - calm, velocity.shape) for wind in winds], axis=2)
    direction = velocity / record.flight.velocity[:, None]
    along, steps = 0.5 * (direction[1:] + direction[:-1]), np.diff(impulses, axis=0)
    steps -= along[:, :, np.newaxis] * np.einsum("ni,nik->nk", along, steps)[:, np.newaxis]
    found = np.concatenate([np.zeros((1, *steps.shape[1:])), np.cumsum(steps, axis=0)])
    for k, other in enumerate(records):
        if other.attitude is not record.attitude:
            turned = other.to_body(found[:, :, k] + velocity)
            found[:, :, k] = np.einsum("nij,nj->ni", record.attitude, turned) - velocity
    return found


def half_steps(
    samples: int, each: Iterable[Moved], moved: Callable[[list[Moved], float], list[Any]]
) -> Iterator[tuple[list[Any], list[Any]]]:
    """What half a step more and half a step less of each of some things makes, so many at once that it stays small.
    `moved` answers to things and a share of them; differences are to be divided by `RESPONSE_STEP`.
    """
    remaining = iter(each)
    while some := list(itertools.islice(remaining, 1 + AT_ONCE // (2 * samples))):
        yield moved(some, 0.5 * RESPONSE_STEP), moved(some, -0.5 * RESPONSE_STEP)


# ---- Linear responses, and what the record says of its errors ----


@dataclass(frozen=True)
class EffectResponses:
    """Changes of the record for an error of each of k effects of one sigma; the truth lies below by that, times it."""

    effects: tuple[Perturbation, ...]  # the k effects
    rows: DecimatedGrid  # the samples that are kept
    # velocity relative to the air in the axes of the first sample, as the body sees it (kept, 3, k), m/s
    drift: FloatArray
    force: ComplexArray  # transverse force (kept, k), m/s^2
    # dynamic pressure over itself (kept, k), which the normal force follows as it follows its slope
    pressure: FloatArray
    moment: ComplexArray  # C_m + i C_n (kept, k)
    turning: ComplexArray  # the same of the rates alone, with pressure and inertia as they are (kept, k)

    @classmethod
    def none(cls, record: InertialRecord) -> EffectResponses:
        """Those of a record without errors."""
        n = record.time.size
        nothing = np.zeros((n, 0), dtype=complex)
        return cls((), DecimatedGrid(np.arange(n)), np.zeros((n, 3, 0)), nothing, nothing.real, nothing, nothing)

    def nonzero(self) -> EffectResponses:
        """Those of the effects that change anything at all."""
        each = {name: getattr(self, name) for name in ("drift", "force", "pressure", "moment", "turning")}
        nonzero = np.any([np.any(values, axis=tuple(range(values.ndim - 1))) for values in each.values()], axis=0)
        effects = tuple(effect for effect, kept in zip(self.effects, nonzero, strict=True) if kept)
        return replace(self, effects=effects, **{name: values[..., nonzero] for name, values in each.items()})


@dataclass(frozen=True)
class EffectFit:
    """What the record says of its own errors, in units of their sizes."""

    responses: EffectResponses
    known: FloatArray  # of it, what is taken out already of the record that the responses belong to (k,)
    value: FloatArray  # mean (k,)
    covariance: FloatArray  # (k, k)

    def corrected(self, flight: Flight) -> Flight:
        """The flight without the estimated errors; UnanswerableError where no speed or dynamic pressure is left."""
        errors = zip(self.responses.effects, self.value, strict=True)
        flight = superposed(flight, (effect.apply(flight, -effect.size * float(value)) for effect, value in errors))
        if min(float(np.min(flight.velocity)), float(np.min(flight.dynamic_pressure))) > 0.0:
            return flight
        largest = sorted(zip(self.value, self.responses.effects, strict=True), key=lambda pair: -abs(pair[0]))
        named = ", ".join(f"{effect.effect} {effect.component} {value:.0f}" for value, effect in largest[:MOST_NAMED])
        raise UnanswerableError(
            f"gyros, accelerometers and air data agree only with errors of many times their tolerances ({named}):"
            " no motion can be determined from them. Likely cause: gusts or controls that move the vehicle more than "
            "its own motion, or axes and signs that are not as the map says. Remedy: check the map, take another "
            "window (--start, --stop), or state wider tolerances (--instruments). What follows from the gyros "
            "alone: `brv-hypo reconstruct --method rates`."
        )


def projected_variance(rows: FloatArray, covariance: FloatArray) -> FloatArray:
    """Variance (n,) of each of `rows` (n, k) times unknowns of that covariance (k, k)."""
    return np.asarray(np.maximum(np.sum((rows @ covariance) * rows, axis=1), 0.0))


def effect_responses(
    record: InertialRecord, crossflow: ComplexArray, force: ComplexArray, effects: Sequence[Perturbation]
) -> EffectResponses:
    """Linearise each effect about the motion of `crossflow` (n,) and transverse `force` (n,) m/s^2 at the c.g."""
    if not effects:
        return EffectResponses.none(record)
    smooth, flight, meridian = noise_free(record, force), record.flight, np.unwrap(windward_meridian(crossflow))
    # The samples that the motion needs, each stretch between the ends of segments by itself.
    edges = sorted({0, flight.samples, *(edge for segment in flight.segments for edge in segment)})
    stride = spacing(np.gradient(meridian, flight.time), flight.p, flight.step, RESPONSE_PER_CYCLE)
    kept = decimated_grid(list(itertools.pairwise(edges)), stride)

    def read(some: Sequence[Perturbation], share: float) -> list[Any]:
        records = perturbed(smooth, [effect.apply(smooth.flight, share * effect.size) for effect in some])
        histories = (
            [each.transverse_force for each in records],
            [each.force_scale / smooth.force_scale for each in records],
            [each.moment for each in records],
            [each.moment * (each.moment_scale / smooth.moment_scale) for each in records],
        )
        return [drift(smooth, crossflow, records), *(np.stack(each, axis=1) for each in histories)]

    changes = [
        [kept.of(more - less) / RESPONSE_STEP for more, less in zip(*both, strict=True)]
        for both in half_steps(record.time.size, effects, read)
    ]
    columns = (np.concatenate(each, axis=-1) for each in zip(*changes, strict=True))
    return EffectResponses(tuple(effects), kept, *columns)


def noise_free(record: InertialRecord, force: ComplexArray) -> InertialRecord:
    """The record as instruments without noise would read: smoothed, with that transverse force (n,) m/s^2."""
    flight = record.flight
    roll_rate = differentiated(flight, flight.p)
    p, p_change = roll_rate.value.real, roll_rate.rate.real
    smooth = (record.force[:, 0], flight.velocity, flight.dynamic_pressure)
    axial, velocity, pressure = (smooth_channel(flight, channel) for channel in smooth)
    rate, change = record.transverse_rate, record.rate_change
    at_cg = np.stack([axial, force.real, force.imag], axis=1)
    ax, ay, az = (at_cg + arm_acceleration(p, p_change, rate, change, flight.vehicle.accelerometer_position)).T
    channels = {"p": p, "q": rate.real, "r": rate.imag, "ax": ax, "ay": ay, "az": az}
    quiet = replace(flight, **channels, velocity=velocity, dynamic_pressure=pressure)
    roll, attitude = body_attitude(record.time, p, rate)
    spin_angle = (1.0 - flight.vehicle.inertia_ratio) * roll
    return replace(record, flight=quiet, roll=roll, attitude=attitude, spin_angle=spin_angle, force=at_cg)
