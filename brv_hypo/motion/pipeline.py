"""`reconstruct`: from a flight record to its wind-relative motion and moments; the entrance of this package.

A record that cannot hold an answer is refused first (`require_answerable`); then the inertial record, one of
the methods for the crossflow, the moments (`moment_estimate`), and warnings about what limits the result (`limits_of`).

Moment coefficients are Euler's equations inverted (Eq. 2.3, Section 3.2.4): with y = (q + i r) exp(i (1 - Ix/I) roll)
the spin coupling drops out,   y' = exp(i (1 - Ix/I) roll) (q_inf S d / I) (C_m + i C_n). `axial_share` is the axial
force's coefficient over its median: by that force a c.g. off the axis turns the vehicle.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from brv_hypo import thresholds as limits
from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UnanswerableError
from brv_hypo.flight.clock import longest_crossed, strongest_frequency
from brv_hypo.flight.plausibility import impossible_rates
from brv_hypo.flight.record import GYROS, Flight
from brv_hypo.motion.inertial import InertialRecord, arm_acceleration, inertial_record
from brv_hypo.motion.interpolation import blocks
from brv_hypo.motion.methods import ReconstructionConfig, methods
from brv_hypo.motion.motion import Motion, angle_of_attack, angle_rates, plane_from_body, recorded, windward_meridian
from brv_hypo.motion.reconstruction import UNKNOWN_ANGLE, EffectEstimate, MomentEstimate, Reconstruction, WindHistory
from brv_hypo.motion.responses import EffectFit, Perturbation, projected_variance
from brv_hypo.motion.signals import rms

WARNED_LEFT = 10.0  # percent of the moments that remain beside fitted errors of the record, below which it warns
AXIAL_SIGNIFICANT = 25.0  # squares of standard errors by which the axial coefficient has to change (seed 162023)


def require_answerable(flight: Flight) -> None:
    """Raises UnanswerableError where the rates are constant or cannot be true, or the air is too thin."""
    if fault := impossible_rates(flight.time, {name: getattr(flight, name) for name in GYROS}):
        raise UnanswerableError(f"the gyros, {fault.channel}: {fault.action}.")
    motion = float(np.std(flight.q) + np.std(flight.r))
    if motion == 0.0:
        raise UnanswerableError(
            "q and r never change: a dead or missing gyro. The transverse motion cannot be reconstructed "
            "without them; give a window in which they work (--start, --stop)."
        )
    duration = float(flight.time[-1] - flight.time[0])
    pressure = float(np.max(flight.dynamic_pressure))
    swing = limits.LARGEST_MOMENT * pressure * flight.vehicle.moment_scale * duration
    if swing < limits.LEAST_SWING * motion:
        raise UnanswerableError(
            f"dynamic pressure is at most {pressure:.3g} Pa: even a moment coefficient of "
            f"{limits.LARGEST_MOMENT:.0f} would change the rates by only {swing:.1g} rad/s. The vehicle is not yet in "
            "the air that matters; give a later window (--start), or check the units of dynamic_pressure."
        )


# ---- Moment coefficients from the gyros, and the axial force ----


def moment_estimate(record: InertialRecord, effects: EffectFit) -> MomentEstimate:
    """C_m + i C_n and its standard deviation, in which noise and estimated bias of the differentiation count. `record`
    is corrected by the `known` of its errors; other estimates are subtracted here, their covariance is in `sigma`.
    """
    spin = record.spin_rate
    responses = effects.responses
    errors = responses.rows.all_of(np.asarray(responses.moment @ (effects.value - effects.known)))
    variance = np.empty(record.time.size)
    for rows in blocks(variance.size):
        changes = responses.rows.all_of(responses.moment, rows)
        variance[rows] = sum(projected_variance(part, effects.covariance) for part in (changes.real, changes.imag))
    noise = error_of_differentiation(record)
    return MomentEstimate(
        body=record.moment - errors,
        sigma=np.sqrt(noise**2 + 0.5 * variance),
        noise_sigma=noise,
        usable=record.measured & spin.interior,
        noise_correlation=spin.noise_correlation,
        spin_angle=record.spin_angle,
    )


def error_of_differentiation(record: InertialRecord) -> FloatArray:
    """Standard deviation (n,) of C_m and of C_n by the gyros' noise and the estimated bias of their differentiation.
    Positive too where errors that were taken out of an accepted record turned the sign of its dynamic pressure.
    """
    return np.asarray(np.hypot(record.rate_noise, record.spin_rate.rate_bias) / np.abs(record.moment_scale))


def axial_share(record: InertialRecord, alpha: FloatArray) -> FloatArray | None:
    """The axial force's coefficient over its median (n,): what drifts, and what goes with alpha squared. None where it
    changes the force by no more than the fit leaves, or by what errors of the accelerometers may be: a transverse force
    that they read along the axis goes with alpha too.
    """
    place = np.linspace(-1.0, 1.0, alpha.size)
    shapes = np.column_stack([np.ones_like(place), place, place**2, alpha**2])
    count, scale, valid = shapes.shape[1], record.force_scale, record.measured
    # What the axial accelerometer reads by one tolerance of its bias, tilt and place, m/s^2.
    flight, tolerances, still = record.flight, record.flight.instruments, np.zeros_like(alpha)
    _, tilt_y, tilt_z = tolerances.accel_misalignment
    errors = [np.full_like(alpha, tolerances.accel_bias[0]), tilt_z * flight.ay, tilt_y * flight.az]
    places = (
        arm_acceleration(flight.p, still, record.transverse_rate, record.rate_change, arm)[:, 0]
        for arm in np.diag(tolerances.accel_position)
    )
    columns = np.column_stack([scale[:, np.newaxis] * shapes, *errors, *places])[valid]
    force = record.force[valid, 0]
    left = max(float(np.std(force - columns @ np.linalg.lstsq(columns, force, rcond=None)[0])), 1e-300)
    rows = np.vstack([columns / left, np.eye(columns.shape[1])[count:]])  # with the priors of the errors
    values = np.linalg.lstsq(rows, np.append(force / left, np.zeros(columns.shape[1] - count)), rcond=None)[0]
    coefficient = shapes @ values[:count]
    # With the changes last, the triangle's last rows hold what of them is beyond all others.
    others = [0, *range(count, columns.shape[1])]
    _, triangle = np.linalg.qr(rows[:, [*others, *range(1, count)]])
    squares = float(np.sum((triangle[len(others) :, len(others) :] @ values[1:count]) ** 2))
    significant = float(np.std(coefficient) * np.median(scale)) > left and squares >= AXIAL_SIGNIFICANT
    return np.asarray(coefficient / np.median(coefficient), dtype=float) if significant else None


# ---- What limits a reconstruction, as far as the record itself shows, and what would help ----


def limits_of(record: InertialRecord, wind: WindHistory, moments: MomentEstimate) -> Iterator[str]:
    """Warnings of the record, the most important first."""
    flight = record.flight
    if not wind.converged:
        yield (
            "the search for the motion did not converge: alpha may be farther off than its sigma says. Give a window "
            "in which it is smaller (--start, --stop), or the tolerances that the instruments have (--instruments)"
        )
    longest = longest_crossed(flight.step, flight.q, flight.r)  # of which the rates about it give those inside
    pairs = zip(flight.gaps, flight.gaps_s, strict=True)
    if lost := [ends for gap, ends in pairs if gap.stop - gap.start > longest]:
        first, last = lost[0]
        others = "" if len(lost) == 1 else f", and {len(lost) - 1} more"
        yield (
            f"a gap of {last - first:.2g} s from {first:.2f} s on{others}: what the vehicle did in it is unknown, and "
            "the attitude after it is estimated. A window on one side of it (--start, --stop) needs no such estimate"
        )
    yield from _moment_noise(record, moments)
    yield from _samples_per_cycle(record)


def _own_limits(record: InertialRecord, wind: WindHistory) -> Iterator[str]:
    """Warnings of the errors of this very motion: an analysis that goes on from it has its own."""
    measured = record.measured
    sizes, effects = np.abs(wind.effects.value), wind.effects.responses.effects
    if effects and np.max(sizes) >= limits.FAR_TOLERANCES:
        worst = effects[int(np.argmax(sizes))]
        yield (
            f"this motion, fitted to gyros and forces, takes {worst.effect} {worst.component} at {np.max(sizes):.2g} "
            "times its tolerance: where that tolerance is right, alpha is wrong. State a wider one (--instruments), or "
            "take another window (--start, --stop)"
        )
    alpha = angle_of_attack(wind.crossflow)[measured]
    share = rms(wind.alpha_sigma[measured]) / max(rms(alpha), 1e-150)
    if share >= limits.WARNED_ALPHA:
        known = f"known to {100.0 * share:.0f} % of its rms only" if share < 10.0 else "not known"
        yield f"the angle of attack is {known}; a longer window, or one of higher dynamic pressure, would do better"


def _moment_noise(record: InertialRecord, moments: MomentEstimate) -> Iterator[str]:
    """Whether noise hides the moments that the gyros show, weighed by the dynamic pressure."""
    usable = moments.usable
    if not usable.any():
        yield "no stretch of the record is long enough to differentiate the gyros: there are no moments"
        return
    size = rms(moments.body[usable]) / np.sqrt(2.0)
    if rms(moments.noise_sigma[usable]) < limits.WARNED_MOMENTS * max(size, 1e-300):
        return
    pressure = record.flight.dynamic_pressure[usable]
    shown = max(rms(record.moment[usable] * pressure) / np.sqrt(2.0), 1e-300)
    percent = 100.0 * rms(error_of_differentiation(record)[usable] * pressure) / shown
    share = 100.0 * rms(moments.body[usable] * pressure) / np.sqrt(2.0) / shown
    left = f". Once the fitted errors of the record are taken out, {share:.2g} % of these moments remain"
    yield (
        f"the error of differentiating the gyros is {percent:.0f} % of the moments that they show (rms); "
        f"only strong mechanisms can be distinguished{left if share < WARNED_LEFT else ''}"
    )


def _samples_per_cycle(record: InertialRecord) -> Iterator[str]:
    """Few samples in a cycle at the rms frequency of the rates; beside it in one at the strongest, as `inspect`."""
    flight, spin = record.flight, record.spin_rate
    change = np.diff(spin.signal)[record.measured[1:] & record.measured[:-1]]
    noise = record.gyro_sigma**2
    power = float(np.var(spin.signal[record.measured])) - 2.0 * noise
    if power <= 0.0:
        yield "the transverse rates hold nothing but noise"
        return
    step = float(np.sqrt(max(np.mean(np.abs(change) ** 2) - 4.0 * noise, 0.0) / power))
    if 2.0 * np.pi > limits.WARNED_PER_CYCLE * step:
        return
    strongest = strongest_frequency(flight.q, flight.r, flight.step, flight.segments)
    beside = f"; that of the strongest has {flight.sample_rate / strongest:.3g}" if strongest > 0.0 else ""
    yield (
        f"a cycle of the transverse motion's rms frequency has about {2.0 * np.pi / step:.0f} samples at "
        f"{flight.sample_rate:.3g} Hz{beside}: differentiated gyros are noisy, and delays shorter than a few samples "
        "cannot be distinguished from none"
    )


def reconstruct(
    flight: Flight, config: ReconstructionConfig | None = None, perturbations: Sequence[Perturbation] = ()
) -> Reconstruction:
    """Wind-relative motion and moments of `flight`, with standard deviations. The record may err by each of
    `perturbations`, as likely as their sizes say, and the gyros' clock, which the motion is on, may be late; without
    any it has white noise alone. Raises UnanswerableError where too little of the record is of a flight.
    """
    config = config or ReconstructionConfig()
    require_answerable(flight)
    record = inertial_record(flight, config)
    wind: WindHistory = methods()[config.method](record, config, perturbations)
    moments = moment_estimate(wind.record, wind.effects)
    own = tuple(_own_limits(record, wind))
    warnings = (*wind.warnings, *own, *limits_of(record, wind, moments))
    motion = recorded(_motion(record, wind, moments))
    clock = float(flight.instruments.time_skew[0]) if perturbations else 0.0
    fit = wind.effects
    found = zip(fit.responses.effects, fit.value, np.sqrt(np.diag(fit.covariance)), strict=True)
    meridian_sigma = np.hypot(wind.phi_w_sigma, motion.windward_meridian_rate * clock)
    return Reconstruction(
        flight=flight,
        method=config.method,
        motion=motion,
        moments=moments,
        alpha_sigma=np.hypot(wind.alpha_sigma, motion.alpha_rate * clock),
        alpha_sigma_on_clock=wind.radial_sigma / np.cos(motion.alpha),
        phi_w_sigma=np.minimum(meridian_sigma, UNKNOWN_ANGLE),
        gravity_body=wind.gravity,
        normal_force_slope=wind.normal_force_slope,
        normal_force_bend=wind.normal_force_bend,
        gyro_sigma=record.gyro_sigma,
        accel_sigma=wind.accel_sigma,
        effects=tuple(
            EffectEstimate(e.effect, e.component, e.units, e.size, e.size * float(value), e.size * float(sigma))
            for e, value, sigma in found
        ),
        corrected=wind.effects.corrected(flight),
        status="degraded" if warnings else "ok",
        warnings=warnings,
        own_warnings=own,
        converged=wind.converged,
    )


def _motion(record: InertialRecord, wind: WindHistory, moments: MomentEstimate) -> Motion:
    flight, xi = record.flight, wind.crossflow
    alpha, meridian = angle_of_attack(xi), np.unwrap(windward_meridian(xi))
    # The rate of the crossflow from the kinematics: Eq. 3.1 with gravity, per unit of speed.
    own, forward = wind.record, np.sqrt(np.maximum(1.0 - np.abs(xi) ** 2, 0.0))
    acceleration = own.force + own.to_body(np.broadcast_to(wind.gravity, (flight.samples, 3)))
    transverse = acceleration[:, 1] + 1j * acceleration[:, 2]
    along = acceleration[:, 0] * forward + (transverse * np.conj(xi)).real
    turning = -1j * own.flight.p * xi + 1j * own.transverse_rate * forward
    alpha_rate, meridian_rate = angle_rates(xi, turning + (transverse - xi * along) / own.flight.velocity)
    in_plane = plane_from_body(moments.body, meridian).real
    # C_m0 + C_malpha alpha, fitted to it by weighted least squares.
    weight, line = np.where(moments.usable, 1.0 / moments.noise_sigma, 0.0), np.vander(alpha, 2)
    static = line @ np.linalg.lstsq(line * weight[:, None], in_plane * weight, rcond=None)[0]
    unknown = np.full(flight.samples, np.nan)
    return Motion(
        time=flight.time,
        alpha=alpha,
        alpha_rate=alpha_rate,
        windward_meridian=meridian,
        windward_meridian_rate=meridian_rate,
        p=flight.p,
        q=record.transverse_rate.real,
        r=record.transverse_rate.imag,
        velocity=flight.velocity,
        dynamic_pressure=flight.dynamic_pressure,
        mach=unknown if flight.mach is None else flight.mach,
        reynolds=unknown if flight.reynolds is None else flight.reynolds,
        in_plane_moment=np.asarray(static),
        reference_length=flight.vehicle.reference_length,
        roll_acceleration=np.gradient(flight.p, flight.time),
        transverse_acceleration=record.rate_change,
        axial_share=axial_share(record, alpha),
    )
