"""What limits a reconstruction, as far as the record itself tells, and what would help."""

from __future__ import annotations

import itertools

import numpy as np

from brv_hypo.constants import WARNED_ALPHA, WARNED_GRAVITY, WARNED_MOMENTS, WARNED_PER_CYCLE
from brv_hypo.flight.resample import longest_crossed
from brv_hypo.motion.frames import angle_of_attack
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.methods import WindHistory
from brv_hypo.motion.reconstruction import MomentEstimate
from brv_hypo.motion.wind import gravity_magnitude


def limits_of(record: InertialRecord, wind: WindHistory, moments: MomentEstimate) -> tuple[str, ...]:
    """Warnings, most telling first."""
    checks = (
        _attitude_lost(record),
        _alpha_error(record, wind),
        _moment_noise(moments),
        _samples_per_cycle(record),
        _gravity(record, wind),
    )
    return tuple(text for text in checks if text is not None)


def _attitude_lost(record: InertialRecord) -> str | None:
    """Gaps that are too long for the rates about them to tell what they were inside."""
    flight = record.flight
    longest = longest_crossed(flight.step, flight.q, flight.r)
    lost = [(b, a) for (_, b), (a, _) in itertools.pairwise(flight.segments) if a - b > longest]
    if not lost:
        return None
    first, last = lost[0]
    others = "" if len(lost) == 1 else f", and {len(lost) - 1} more"
    return (
        f"a gap of {(last - first) * flight.step:.2g} s from {flight.time[first]:.2f} s on{others}: nothing tells the "
        "attitude across it, and what is left may pose as errors or moments. Give a window on one side of it (--start, "
        "--stop)"
    )


def _alpha_error(record: InertialRecord, wind: WindHistory) -> str | None:
    alpha = angle_of_attack(wind.crossflow)[record.measured]
    sigma = wind.alpha_sigma[record.measured]
    share = float(np.sqrt(np.mean(sigma**2)) / max(np.sqrt(np.mean(alpha**2)), 1e-150))
    if share < WARNED_ALPHA:
        return None
    return (
        f"the angle of attack is known to {100.0 * share:.0f} % of its rms only; a longer window, or one of "
        "higher dynamic pressure, ties the attitude to the wind better"
    )


def _moment_noise(moments: MomentEstimate) -> str | None:
    if not moments.usable.any():
        return "no stretch of the record is long enough to differentiate the gyros: there are no moments"
    size = float(np.sqrt(np.mean(np.abs(moments.body[moments.usable]) ** 2) / 2.0))
    share = float(np.sqrt(np.mean(moments.noise_sigma[moments.usable] ** 2))) / max(size, 1e-300)
    if share < WARNED_MOMENTS:
        return None
    percent = 100.0 * share
    return f"gyro noise makes {percent:.0f} % of the moments' rms; only strong mechanisms can be told apart"


def _samples_per_cycle(record: InertialRecord) -> str | None:
    """Samples in one cycle of the motion, from the rms of the rate's steps over that of the rate."""
    spin = record.spin_rate
    change = np.diff(spin.signal)[record.measured[1:] & record.measured[:-1]]
    noise = record.gyro_sigma**2
    power = float(np.var(spin.signal[record.measured])) - 2.0 * noise
    if power <= 0.0:
        return "the transverse rates hold nothing but noise"
    step = float(np.sqrt(max(np.mean(np.abs(change) ** 2) - 4.0 * noise, 0.0) / power))
    if 2.0 * np.pi > WARNED_PER_CYCLE * step:
        return None
    return (
        f"about {2.0 * np.pi / step:.0f} samples per cycle of the oscillation at "
        f"{record.flight.sample_rate:.3g} Hz: differentiated gyros are "
        "noisy, and delays shorter than a few samples cannot be told from none"
    )


def _gravity(record: InertialRecord, wind: WindHistory) -> str | None:
    expected = gravity_magnitude(record.flight)
    found = float(np.linalg.norm(wind.gravity))
    if expected is None or found == 0.0 or found < WARNED_GRAVITY * expected:
        return None
    return (
        f"the velocity turns as if gravity were {found:.1f} m/s^2 where {expected:.1f} is expected: wind "
        "shear, gyro bias or a wrong accelerometer position are likely"
    )
