"""How motion, forces and moments answer to the errors that a record may have: one linearisation for each.

It is made on a noise-free flight: smoothed rates, speed and pressure, and the normal force as fitted. A
column made from measured channels would hold the noise of what it is to explain, and find itself.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray, IntArray
from brv_hypo.constants import RESPONSE_PER_CYCLE, RESPONSE_STEP
from brv_hypo.errors import UnanswerableError
from brv_hypo.flight.record import Flight
from brv_hypo.motion.attitude import body_attitude
from brv_hypo.motion.differentiation import differentiate
from brv_hypo.motion.frames import windward_meridian
from brv_hypo.motion.inertial import InertialRecord, arm_acceleration
from brv_hypo.motion.kept_rows import KeptRows, all_rows, blocks, kept_rows, spacing
from brv_hypo.motion.noise import white_noise_level
from brv_hypo.motion.perturbation import Perturbation, perturbed, superposed
from brv_hypo.motion.splines import running_integral
from brv_hypo.motion.wind import across_impulse

Values = TypeVar("Values", FloatArray, ComplexArray)

# Samples of perturbed records that are held at once, some 200 bytes each.
AT_ONCE = 60_000
MOST_NAMED = 3  # errors told where none can be taken out


@dataclass(frozen=True)
class Responses(Generic[Values]):
    """One quantity's changes by those effects, `which` (m,), that change it at all: `values` (kept, m)."""

    which: IntArray
    rows: KeptRows
    values: Values

    def at(self, rows: slice) -> Values:
        """These rows of the changes (rows, m)."""
        return self.rows.all_of(self.values, rows)

    def of(self, effects: FloatArray) -> Values:
        """The change (n,) by effects of these sizes (k,)."""
        return self.rows.all_of(np.asarray(self.values @ effects[self.which]))

    def variance(self, covariance: FloatArray) -> FloatArray:
        """Variance (n,) of both parts by effects of that covariance (k, k)."""
        own = covariance[np.ix_(self.which, self.which)]
        out = np.empty(self.rows.count)
        for rows in blocks(out.size):
            changes = self.at(rows)
            out[rows] = projected_variance(changes.real, own) + projected_variance(changes.imag, own)
        return out


@dataclass(frozen=True)
class EffectResponses:
    """Changes of what the record says, for an error of each of k effects of one standard deviation.

    `rows` are the samples that are kept; `drift` (kept, 3, k) m/s: the velocity relative to the air in the axes of the
    first sample, as the body sees it; `force` m/s^2: the transverse force; `pressure`: the dynamic pressure over
    itself, which the normal force follows as it follows its slope; `moment`: C_m + i C_n. The truth lies below the
    record by that much, times the error.
    """

    effects: tuple[Perturbation, ...]
    rows: KeptRows
    drift: FloatArray
    force: Responses[ComplexArray]
    pressure: Responses[FloatArray]
    moment: Responses[ComplexArray]


@dataclass(frozen=True)
class EffectFit:
    """What the record says of its own errors: mean (k,) and covariance (k, k), in units of their sizes.

    `known` (k,) of it is taken out already of the record that the responses belong to.
    """

    responses: EffectResponses
    known: FloatArray
    value: FloatArray
    covariance: FloatArray


def projected_variance(rows: FloatArray, covariance: FloatArray) -> FloatArray:
    """Variance (n,) of each of `rows` (n, k) times unknowns of that covariance (k, k)."""
    return np.asarray(np.maximum(np.sum((rows @ covariance) * rows, axis=1), 0.0))


def no_responses(record: InertialRecord) -> EffectResponses:
    """Those of a record without errors."""
    rows, none = all_rows(record.time.size), np.zeros(0, dtype=np.int64)
    nothing = np.zeros((rows.count, 0))
    unchanged: Responses[ComplexArray] = Responses(none, rows, nothing.astype(complex))
    return EffectResponses(
        (), rows, np.zeros((rows.count, 3, 0)), unchanged, Responses(none, rows, nothing), unchanged
    )


def as_expected(responses: EffectResponses) -> EffectFit:
    """What is known of the errors before the record is asked."""
    count = len(responses.effects)
    return EffectFit(responses, np.zeros(count), np.zeros(count), np.eye(count))


def corrected(flight: Flight, fit: EffectFit) -> Flight:
    """The flight with the errors that were found taken out.

    Raises UnanswerableError where they are so large that no speed or dynamic pressure is left.
    """
    errors = zip(fit.responses.effects, fit.value, strict=True)
    flight = superposed(flight, (effect.apply(flight, -effect.size * float(value)) for effect, value in errors))
    if min(float(np.min(flight.velocity)), float(np.min(flight.dynamic_pressure))) > 0.0:
        return flight
    largest = sorted(zip(fit.value, fit.responses.effects, strict=True), key=lambda pair: -abs(pair[0]))
    told = ", ".join(
        f"{effect.effect} {effect.component} {value:.0f}" for value, effect in largest[:MOST_NAMED]
    )
    raise UnanswerableError(
        f"gyros, accelerometers and air data agree only with errors of many times their tolerances ({told}): no motion "
        "can be told from them. Likely cause: gusts or controls that move the vehicle more than its own motion, or "
        "axes and signs that are not as the map says. Remedy: check the map, take another window (--start, --stop), or "
        "state wider tolerances (--instruments). What the gyros alone tell, and how well: `brv-hypo reconstruct "
        "--method rates`."
    )


def effect_responses(
    record: InertialRecord, crossflow: ComplexArray, force: ComplexArray, effects: Sequence[Perturbation]
) -> EffectResponses:
    """Linearise each effect about the motion of `crossflow` (n,) and transverse `force` (n,) m/s^2 at the c.g."""
    if not effects:
        return no_responses(record)
    smooth, kept = noise_free(record, force), _kept(record, crossflow)
    width = max(1, AT_ONCE // kept.count)
    drift = np.empty((kept.size, 3, len(effects)))
    forces, pressures, moments = _Gathered(kept), _Gathered(kept), _Gathered(kept)
    for first in range(0, len(effects), width):
        some = effects[first : first + width]
        both = [
            effect.apply(smooth.flight, sign * 0.5 * RESPONSE_STEP * effect.size)
            for sign in (1.0, -1.0)
            for effect in some
        ]
        records = perturbed(smooth, both)
        drifts = kept.of(_drift(smooth, crossflow, records))
        drift[:, :, first : first + width] = drifts[:, :, : len(some)] - drifts[:, :, len(some) :]
        pairs = zip(records[: len(some)], records[len(some) :], strict=True)
        for k, (more, less) in enumerate(pairs, start=first):
            forces.add(k, more.transverse_force - less.transverse_force)
            pressures.add(k, (more.force_scale - less.force_scale) / smooth.force_scale)
            moments.add(k, more.moment - less.moment)
    drift /= RESPONSE_STEP
    return EffectResponses(
        tuple(effects), kept, drift, forces.all_of(complex), pressures.all_of(float), moments.all_of(complex)
    )


def _kept(record: InertialRecord, crossflow: ComplexArray) -> KeptRows:
    """The samples that the motion needs, each stretch between the ends of segments by itself."""
    flight = record.flight
    edges = sorted({0, flight.samples, *(edge for segment in flight.segments for edge in segment)})
    rate = np.gradient(np.unwrap(windward_meridian(crossflow)), flight.time)
    return kept_rows(list(itertools.pairwise(edges)), spacing(rate, flight.p, flight.step, RESPONSE_PER_CYCLE))


class _Gathered:
    """Changes of one quantity, effect by effect; those that are none are not kept."""

    def __init__(self, kept: KeptRows) -> None:
        self._kept = kept
        self._found: dict[int, Any] = {}

    def add(self, effect: int, change: Any) -> None:
        """The change (n,) by one effect."""
        if np.any(change):
            self._found[effect] = self._kept.of(change)

    def all_of(self, kind: type) -> Responses[Any]:
        """All of them per unit of the effects, which are let go one by one."""
        which = np.array(list(self._found), dtype=np.int64)
        values: Any = np.empty((self._kept.size, which.size), dtype=kind, order="F")
        for place, effect in enumerate(which.tolist()):
            np.divide(self._found.pop(effect), RESPONSE_STEP, out=values[:, place])
        return Responses(which, self._kept, values)


def telling(responses: EffectResponses) -> EffectResponses:
    """The responses of those effects that change anything."""
    tells = np.any(responses.drift != 0.0, axis=(0, 1))
    for each in (responses.force, responses.pressure, responses.moment):
        tells[each.which] = True
    if np.all(tells):
        return responses
    place = np.cumsum(tells) - 1
    return EffectResponses(
        tuple(effect for effect, tell in zip(responses.effects, tells, strict=True) if tell),
        responses.rows,
        responses.drift[:, :, tells],
        replace(responses.force, which=place[responses.force.which]),
        replace(responses.pressure, which=place[responses.pressure.which]),
        replace(responses.moment, which=place[responses.moment.which]),
    )


def noise_free(record: InertialRecord, force: ComplexArray) -> InertialRecord:
    """The record as instruments without noise would read: smoothed, with that transverse force (n,) m/s^2."""
    flight = record.flight
    p, p_change = _smoothed(record, flight.p)
    axial, _ = _smoothed(record, record.force[:, 0])
    rate, change = record.transverse_rate, record.rate_change
    at_cg = np.stack([axial, force.real, force.imag], axis=1)
    arm = np.asarray(flight.vehicle.accelerometer_position, dtype=float)
    ax, ay, az = (at_cg + arm_acceleration(p, p_change, rate, change, arm)).T
    quiet = replace(
        flight,
        p=p,
        q=rate.real,
        r=rate.imag,
        ax=ax,
        ay=ay,
        az=az,
        velocity=_smoothed(record, flight.velocity)[0],
        dynamic_pressure=_smoothed(record, flight.dynamic_pressure)[0],
    )
    roll, attitude = body_attitude(record.time, p, rate)
    spin_angle = (1.0 - flight.vehicle.inertia_ratio) * roll
    return replace(record, flight=quiet, roll=roll, attitude=attitude, spin_angle=spin_angle, force=at_cg)


def _smoothed(record: InertialRecord, channel: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A channel (n,) less its noise, and its derivative, 1/s."""
    segments = record.flight.segments
    noise = white_noise_level(channel, segments)
    found = differentiate(channel.astype(complex), record.flight.step, noise, segments)
    return found.value.real, found.rate.real


def _drift(
    smooth: InertialRecord, crossflow: ComplexArray, records: Sequence[InertialRecord]
) -> FloatArray:
    """Change (n, 3, k) m/s of the velocity relative to the air, in the axes of the first sample.

    A turned attitude moves the air as much as a turned velocity does.
    """
    forward = np.sqrt(np.maximum(1.0 - np.abs(crossflow) ** 2, 0.0))
    seen = smooth.flight.velocity[:, None] * np.stack([forward, crossflow.real, crossflow.imag], axis=1)
    velocity = np.einsum("nij,nj->ni", smooth.attitude, seen)
    before = smooth.force_inertial
    impulses = np.zeros((smooth.time.size, 3, len(records)))
    moved = [
        k for k, r in enumerate(records) if r.force is not smooth.force or r.attitude is not smooth.attitude
    ]
    if moved:
        pulls = np.stack([records[k].force_inertial - before for k in moved], axis=2)
        impulses[:, :, moved] = running_integral(smooth.time, pulls)
    impulses -= np.stack([_wind(record) - _wind(smooth) for record in records], axis=2)
    drift = across_impulse(velocity / smooth.flight.velocity[:, None], impulses)
    for k, record in enumerate(records):
        if record.attitude is not smooth.attitude:
            drift[:, :, k] += velocity
            drift[:, :, k] = np.einsum("nij,nj->ni", smooth.attitude, record.to_body(drift[:, :, k])) - velocity
    return drift


def _wind(record: InertialRecord) -> FloatArray:
    """The wind (n, 3) m/s that is known, less that of the first sample."""
    wind = record.flight.wind
    return np.zeros((record.time.size, 3)) if wind is None else wind - wind[0]
