"""What a trace says in words: candidates, stability, the residual, and what in the data could pose as an effect."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from brv_hypo.arrays import IntArray
from brv_hypo.constants import FINDING_SHOWN, REPORTED_DRAG, REPORTED_MERIDIAN, REPORTED_PER_CYCLE, STABLE_SIGMAS
from brv_hypo.flight.record import Flight
from brv_hypo.inference.derivatives import Derivative
from brv_hypo.motion.reconstruction import Reconstruction
from brv_hypo.tracing.acceptance import Candidate
from brv_hypo.tracing.result import Residual


def described(candidate: Candidate, flights: Sequence[Flight]) -> str:
    """What a candidate says of these flights."""
    if candidate.file is not None:
        return candidate.file.title
    effect, parts = candidate.effect, []
    for column, value in zip(candidate.fit.selected, candidate.fit.values[candidate.fit.baseline_size :], strict=True):
        name, number, when = column.label, column.flight, ""
        if effect is not None:
            number, component, *_ = candidate.variant[column.term]
            name = component.name
        elif column.time_basis.kind != "constant":
            when = f" at {max(column.time_basis.start, float(flights[number or 0].time[0])):.2f} s"
        units = "" if effect is None else f" {column.units}"
        which = "" if number is None or len(flights) == 1 else f" on flight {number + 1}"
        parts.append(f"{name} {value:.3g}{units}{when}{which}")
    time = getattr(effect, "time", None)
    at = "" if time is None else f" at {time:.3f} s"
    where = "" if effect is None or candidate.in_rates > FINDING_SHOWN else " (in the specific force only)"
    return ", ".join(parts) + at + where


def stability_in_words(slopes: Sequence[Derivative], moment: str = "static moment", doubt: bool = True) -> str:
    """Where a flight's moment at zero alpha is unstable, or, with `doubt`, not significantly stable; else empty."""
    several = len(slopes) > 1
    found = (_of_one(s, f"{moment} of flight {s.flight + 1}" if several else moment, doubt) for s in slopes)
    return " ".join(filter(None, found))


def _of_one(slope: Derivative, moment: str, doubt: bool) -> str:
    values, errors = np.array(slope.at_zero), np.array(slope.at_zero_std_error)
    doubtful = np.flatnonzero(values + (STABLE_SIGMAS if doubt else -STABLE_SIGMAS) * errors >= 0.0)
    if doubtful.size == 0:
        return ""
    runs = np.split(doubtful, np.flatnonzero(np.diff(doubtful) > 1) + 1)
    worst = int(doubtful[np.argmax((values / np.maximum(errors, 1e-300))[doubtful])])
    unstable = values[worst] > STABLE_SIGMAS * errors[worst]
    said = "is unstable" if unstable else "is not significantly stable"
    return (
        f"At alpha = 0 the {moment} {said} {' and '.join(_when(slope, run) for run in runs)}: "
        f"{values[worst]:.2g} ± {errors[worst]:.1g} per rad at {slope.time_s[worst]:.0f} s, and "
        f"{slope.at_flown[worst]:.2g} ± {slope.at_flown_std_error[worst]:.1g} at the "
        f"{np.degrees(slope.alpha_rad[worst]):.2g} deg flown there."
    )


def _when(slope: Derivative, run: IntArray) -> str:
    """Times and, where they are known, Mach numbers of neighbouring places."""
    first, last = int(run[0]), int(run[-1])
    mach = f" (Mach {slope.mach[first]:.3g} to {slope.mach[last]:.3g})" if np.isfinite(slope.mach[first]) else ""
    return f"from {slope.time_s[first]:.4g} to {slope.time_s[last]:.4g} s{mach}"


def unexplained(residual: Residual) -> str | None:
    """The residual in a sentence; None where it is white."""
    if residual.white:
        return None
    start, stop = residual.worst_region_s
    ratio = float(np.sqrt(residual.noise_ratio))  # at two digits, never with an exponent
    times = f"{float(f'{ratio:.2g}'):.6g}" if ratio < 1e6 else "more than a million"
    return (
        f"The residual has an rms of {residual.rms:.3g}, {times} times the noise of the moments; it is largest in "
        f"{residual.worst_channel} and from {start:.2f} to {stop:.2f} s, at "
        f"{residual.dominant_frequency_hz:.3g} Hz ({residual.dominant_frequency_is})."
    )


def caveats(flights: Sequence[Flight], reconstructions: Sequence[Reconstruction]) -> tuple[str, ...]:
    """What in the data could pose as an effect."""
    each = zip(flights, reconstructions, strict=True)
    return tuple(dict.fromkeys(caveat for pair in each for caveat in _caveats_of(*pair)))


def _caveats_of(flight: Flight, reconstruction: Reconstruction) -> list[str]:
    found, motion = list(reconstruction.warnings), reconstruction.motion
    turning = float(np.percentile(np.abs(motion.windward_meridian_rate), REPORTED_MERIDIAN))
    per_cycle = 2.0 * np.pi / ((turning + float(np.mean(np.abs(motion.p)))) * flight.step)
    if per_cycle < REPORTED_PER_CYCLE:
        found.append(
            f"a cycle of the fastest motion (roll and turn of the meridian together) has {per_cycle:.0f} samples: if "
            "samples are averages over their interval, the motion appears "
            f"{100.0 * (1.0 - np.sinc(1.0 / per_cycle)):.1f} % too small, and a delay of half a sample may look like "
            "damping or lag"
        )
    share = flight.ax / flight.dynamic_pressure
    centre = float(np.median(share))
    drag = None if centre == 0.0 else float(np.std(share) / abs(centre))
    if drag is not None and drag < REPORTED_DRAG:
        found.append(
            f"dynamic pressure keeps a fixed proportion to the axial force within {max(100.0 * drag, 0.01):.2g} %: "
            "where it was derived from drag, its errors are those of the assumed drag coefficient, and a stiffness "
            "that changes along the flight may in part be that coefficient's change"
        )
    return found
