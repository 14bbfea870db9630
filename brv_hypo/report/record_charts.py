"""Charts of a record as it was measured: forces, rates, and the attitude that the rates alone make."""

from __future__ import annotations

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.motion.attitude import body_attitude
from brv_hypo.report.chart import Chart, Line, Panel
from brv_hypo.report.motion_charts import Setting

_FORCES = (("ax", "a<sub>x</sub>, m/s²"), ("ay", "a<sub>y</sub>, m/s²"), ("az", "a<sub>z</sub>, m/s²"))
_RATES = (("p", "p, deg/s"), ("q", "q, deg/s"), ("r", "r, deg/s"))


def record_charts(setting: Setting, flight: Flight) -> list[Chart]:
    """Accelerometers and gyros over time, as Figures 5.1 to 5.4 of the report have them."""
    time = flight.time
    forces = [Panel(title, [Line(time, getattr(flight, name), "measured")]) for name, title in _FORCES]
    rates = [Panel(title, [Line(time, np.degrees(getattr(flight, name)), "measured")]) for name, title in _RATES]
    return [
        setting.chart("accelerations", "Accelerometers", forces),
        setting.chart("rates", "Rate gyros", rates),
        _integrated_attitude_chart(setting, flight),
    ]


def _integrated_attitude_chart(setting: Setting, flight: Flight) -> Chart:
    """Pitch and yaw of the nose from its first direction, by integration of the rates; no wind is in it."""
    nose = np.degrees(1.0) * _pitch_and_yaw(flight)
    panels = [
        Panel(title, [Line(flight.time, angle, "measured")])
        for title, angle in zip(("theta, deg", "psi, deg"), nose, strict=True)
    ]
    caption = "In the body axes of the first sample, where both are zero: biases of the gyros add up."
    return setting.chart("integrated-attitude", "Pitch and yaw by integrated rates", panels, caption)


def _pitch_and_yaw(flight: Flight) -> FloatArray:
    """Angles (2, n) rad of the nose above and to the right of where it stood at first."""
    _, attitude = body_attitude(flight.time, flight.p, flight.q + 1j * flight.r)
    forward, right, down = attitude[:, :, 0].T
    return np.stack([np.arcsin(np.clip(-down, -1.0, 1.0)), np.unwrap(np.arctan2(right, forward))])
