"""What limits a reconstruction, as far as the record itself tells, and what would help."""

from __future__ import annotations

import itertools

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.constants import WARNED_ALPHA, WARNED_GRAVITY, WARNED_LEFT, WARNED_MOMENTS, WARNED_PER_CYCLE
from brv_hypo.flight.resample import longest_crossed, strongest_frequency
from brv_hypo.motion.frames import angle_of_attack
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.methods import WindHistory
from brv_hypo.motion.moments import error_of_differentiation
from brv_hypo.motion.reconstruction import MomentEstimate
from brv_hypo.motion.wind import gravity_magnitude


def limits_of(record: InertialRecord, wind: WindHistory, moments: MomentEstimate) -> tuple[str, ...]:
    """Warnings, most telling first."""
    checks = (
        _attitude_lost(record),
        _alpha_error(record, wind),
        _moment_noise(record, moments),
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
    known = f"known to {100.0 * share:.0f} % of its rms only"
    return (
        f"the angle of attack is {known if share < 10.0 else 'not known'}; a longer window, or one of "
        "higher dynamic pressure, ties the attitude to the wind better"
    )


def _moment_noise(record: InertialRecord, moments: MomentEstimate) -> str | None:
    """Whether what is left of the moments is hidden; told of the moments that the gyros show.

    Weighed by the dynamic pressure: as it falls, a coefficient's error grows without bound, a moment's does not.
    """
    usable = moments.usable
    if not usable.any():
        return "no stretch of the record is long enough to differentiate the gyros: there are no moments"
    size = _rms(moments.body[usable]) / np.sqrt(2.0)
    if _rms(moments.noise_sigma[usable]) < WARNED_MOMENTS * max(size, 1e-300):
        return None
    pressure = record.flight.dynamic_pressure[usable]
    shown = _rms(record.moment[usable] * pressure) / np.sqrt(2.0)
    percent = 100.0 * _rms(error_of_differentiation(record)[usable] * pressure) / max(shown, 1e-300)
    text = (
        f"the error of differentiating the gyros is {percent:.0f} % of the moments that they show (rms); "
        "only strong mechanisms can be told apart"
    )
    share = 100.0 * _rms(moments.body[usable] * pressure) / np.sqrt(2.0) / max(shown, 1e-300)
    if share < WARNED_LEFT:
        text += f". The errors of the record that were fitted leave {share:.2g} % of these moments"
    return text


def _rms(values: FloatArray | ComplexArray) -> float:
    return float(np.sqrt(np.mean(np.abs(values) ** 2)))


def _samples_per_cycle(record: InertialRecord) -> str | None:
    """Samples in a cycle at the rms frequency of the rates, from the rms of their steps over their own.

    The strongest motion, of which `inspect` tells, may be far slower, and is named beside it.
    """
    flight, spin = record.flight, record.spin_rate
    change = np.diff(spin.signal)[record.measured[1:] & record.measured[:-1]]
    noise = record.gyro_sigma**2
    power = float(np.var(spin.signal[record.measured])) - 2.0 * noise
    if power <= 0.0:
        return "the transverse rates hold nothing but noise"
    step = float(np.sqrt(max(np.mean(np.abs(change) ** 2) - 4.0 * noise, 0.0) / power))
    if 2.0 * np.pi > WARNED_PER_CYCLE * step:
        return None
    strongest = strongest_frequency(flight.q, flight.r, flight.step, flight.segments)
    beside = f"; that of the strongest has {flight.sample_rate / strongest:.3g}" if strongest > 0.0 else ""
    return (
        f"a cycle of the transverse motion's rms frequency has about {2.0 * np.pi / step:.0f} samples at "
        f"{flight.sample_rate:.3g} Hz{beside}: differentiated gyros are noisy, and delays shorter than a few samples "
        "cannot be told from none"
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
