"""Refuses records that cannot hold an answer, before any numerics meet them."""

from __future__ import annotations

import numpy as np

from brv_hypo.constants import FASTEST_RATE, LARGEST_MOMENT, LEAST_SWING
from brv_hypo.errors import UnanswerableError
from brv_hypo.flight.record import Flight


def require_answerable(flight: Flight) -> None:
    """Raises UnanswerableError where the rates stand still or cannot be true, or the air is too thin."""
    rates = np.hypot(flight.q, flight.r)
    fastest = float(max(rates.max(), np.abs(flight.p).max()))
    if fastest > FASTEST_RATE:
        raise UnanswerableError(
            f"the gyros reach {fastest:.3g} rad/s, expected less than {FASTEST_RATE:.0f}: their units are "
            "probably wrong. Correct the `units` attributes of p, q and r."
        )
    motion = float(np.std(flight.q) + np.std(flight.r))
    if motion == 0.0:
        raise UnanswerableError(
            "q and r never change: a dead or missing gyro. The transverse motion cannot be reconstructed "
            "without them; give a window in which they work (--start, --stop)."
        )
    duration = float(flight.time[-1] - flight.time[0])
    pressure = float(np.max(flight.dynamic_pressure))
    swing = LARGEST_MOMENT * pressure * flight.vehicle.moment_scale * duration
    if swing < LEAST_SWING * motion:
        raise UnanswerableError(
            f"dynamic pressure is at most {pressure:.3g} Pa: even a moment coefficient of "
            f"{LARGEST_MOMENT:.0f} would change the rates by only {swing:.1g} rad/s. The vehicle is not yet in "
            "the air that matters; give a later window (--start), or check the units of dynamic_pressure."
        )
