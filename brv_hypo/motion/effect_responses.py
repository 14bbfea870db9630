"""How motion, forces and moments answer to the errors that a record may have: one linearisation for each.

It is made on a noise-free flight: smoothed rates, speed and pressure, and the normal force as fitted. A
column made from measured channels would hold the noise of what it is to explain, and find itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.errors import UnanswerableError
from brv_hypo.flight.record import Flight
from brv_hypo.motion.attitude import body_attitude
from brv_hypo.motion.differentiation import differentiate
from brv_hypo.motion.inertial import InertialRecord, arm_acceleration
from brv_hypo.motion.noise import white_noise_level
from brv_hypo.motion.perturbation import Perturbation, perturbed
from brv_hypo.motion.splines import running_integral

# Width of differences, in standard deviations: what is of second order in it would tell apart errors that the record
# cannot (both clocks of the inertial unit late by 1 sigma is a motion 1 sigma later, and else nothing).
STEP = 1e-3
# Samples of perturbed records that are held at once, some 200 bytes each.
AT_ONCE = 200_000
MOST_NAMED = 3  # errors told where none can be taken out


@dataclass(frozen=True)
class EffectResponses:
    """Changes of what the record says, for an error of each effect of one standard deviation.

    `drift` (n, 3, k) m/s: the velocity relative to the air in the axes of the first sample, as the body sees
    it; `force` (n, k) m/s^2: the transverse force; `pressure` (n, k): the dynamic pressure over itself, which the
    normal force follows as it follows its slope; `moment` (n, k): C_m + i C_n. The truth lies below the record by that
    much, times the error.
    """

    effects: tuple[Perturbation, ...]
    drift: FloatArray
    force: ComplexArray
    pressure: FloatArray
    moment: ComplexArray


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
    n = record.time.size
    nothing = np.zeros((n, 0), dtype=complex)
    return EffectResponses((), np.zeros((n, 3, 0)), nothing, nothing.real, nothing)


def as_expected(responses: EffectResponses) -> EffectFit:
    """What is known of the errors before the record is asked."""
    count = len(responses.effects)
    return EffectFit(responses, np.zeros(count), np.zeros(count), np.eye(count))


def corrected(flight: Flight, fit: EffectFit) -> Flight:
    """The flight with the errors that were found taken out.

    Raises UnanswerableError where they are so large that no speed or dynamic pressure is left.
    """
    for effect, value in zip(fit.responses.effects, fit.value, strict=True):
        flight = effect.apply(flight, -effect.size * float(value))
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
    smooth = noise_free(record, force)
    width = max(1, AT_ONCE // record.time.size)
    some = [
        _responses(smooth, crossflow, force, effects[first : first + width]) for first in range(0, len(effects), width)
    ]
    return EffectResponses(
        effects=tuple(effects),
        drift=np.concatenate([each.drift for each in some], axis=2),
        force=np.concatenate([each.force for each in some], axis=1),
        pressure=np.concatenate([each.pressure for each in some], axis=1),
        moment=np.concatenate([each.moment for each in some], axis=1),
    )


def _responses(
    smooth: InertialRecord, crossflow: ComplexArray, force: ComplexArray, effects: Sequence[Perturbation]
) -> EffectResponses:
    """Those of some effects on a noise-free record."""
    records = [perturbed(smooth, effect.apply(smooth.flight, STEP * effect.size)) for effect in effects]
    pressure = np.stack([r.force_scale / smooth.force_scale - 1.0 for r in records], axis=1)
    forces = np.stack([r.transverse_force - smooth.transverse_force for r in records], axis=1)
    return EffectResponses(
        effects=tuple(effects),
        drift=_drift(smooth, crossflow, records) / STEP,
        force=forces / STEP,
        pressure=pressure / STEP,
        moment=np.stack([r.moment - smooth.moment for r in records], axis=1) / STEP,
    )


def telling(responses: EffectResponses) -> EffectResponses:
    """The responses of those effects that change anything."""
    drift, force, pressure, moment = responses.drift, responses.force, responses.pressure, responses.moment
    tells = np.any(drift != 0.0, axis=(0, 1))
    for each in (force, pressure, moment):
        tells |= np.any(each != 0.0, axis=0)
    kept = tuple(effect for effect, tell in zip(responses.effects, tells, strict=True) if tell)
    return EffectResponses(
        kept, drift[:, :, tells], force[:, tells], pressure[:, tells], moment[:, tells]
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
    drift = np.zeros((smooth.time.size, 3, len(records)))
    moved = [
        k for k, r in enumerate(records) if r.force is not smooth.force or r.attitude is not smooth.attitude
    ]
    if moved:
        pulls = np.stack([records[k].force_inertial - before for k in moved], axis=2)
        drift[:, :, moved] = running_integral(smooth.time, pulls)
    for k, record in enumerate(records):
        drift[:, :, k] -= _wind(record) - _wind(smooth)
        if record.attitude is not smooth.attitude:
            drift[:, :, k] += velocity
            drift[:, :, k] = np.einsum("nij,nj->ni", smooth.attitude, record.to_body(drift[:, :, k])) - velocity
    return drift


def _wind(record: InertialRecord) -> FloatArray:
    """The wind (n, 3) m/s that is known, less that of the first sample."""
    wind = record.flight.wind
    return np.zeros((record.time.size, 3)) if wind is None else wind - wind[0]
