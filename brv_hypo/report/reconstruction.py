"""A reconstruction as a document and as data: ranges and standard deviations of the histories, and their charts.

First come charts of the record as it was measured: forces, rates, and the attitude by integration of the
rates alone, in which there is no wind; then motion and moments. `reconstruction_document` is the entrance.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.motion import Reconstruction
from brv_hypo.motion.kinematics import body_attitude
from brv_hypo.motion.reconstruction import angle_known
from brv_hypo.report.document import Chart, Document, Line, Panel, Picture, Table, Texts
from brv_hypo.report.motion_charts import (
    Setting,
    attitude_chart,
    masked,
    moment_by_alpha_chart,
    moment_chart,
    motion_chart,
    spectrum_chart,
    turning_rates,
)
from brv_hypo.report.style import interval, number

# ---- Charts of a record as it was measured: forces, rates, and the attitude that the rates alone make ----


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


# ---- A reconstruction as a document and as data ----


HEADINGS = ("history", "unit", "least", "greatest", "sigma (rms)")


def reconstruction_line(result: Reconstruction) -> str:
    """The outcome in one line."""
    alpha, meridian = angle_known(result.alpha_rms_sigma), angle_known(result.phi_w_rms_sigma)
    known = f"known to {alpha} in alpha and {meridian} in meridian (rms)"
    return f"motion by the {result.method} method ({result.status}): {known}"


def reconstruction_document(result: Reconstruction) -> Document:
    """Ranges and standard deviations of the histories, noise levels, warnings; on a page the charts."""
    flight = result.flight
    span = interval((float(flight.time[0]), float(flight.time[-1])))
    gravity = ", ".join(number(float(value)) for value in result.gravity_body)
    noise = (
        f"gravity in body axes at the start ({gravity}) m/s²",
        f"white noise of gyros {number(result.gyro_sigma, 2)} rad/s, of accelerometers "
        f"{number(result.accel_sigma, 2)} m/s²",
    )
    return Document(
        title=f"Reconstruction: {flight.title or flight.path}",
        subtitle=(flight.title or flight.path, f"{flight.samples} samples, {span} s, {flight.sample_rate:.4g} Hz"),
        conclusion_title="Motion",
        conclusion=reconstruction_line(result),
        decided=result.status == "ok",
        blocks=(
            Table(HEADINGS, history_rows(result)),
            Texts(noise, bullets=False),
            Texts(result.warnings, "Warnings", warning=True),
            *(Picture(chart) for chart in reconstruction_charts(result)),
            Texts(flight.notes, "Notes", shown="page"),
        ),
    )


def history_rows(result: Reconstruction) -> list[tuple[str, ...]]:
    """One row for each history: range, and the rms of its standard deviation."""
    motion, usable = result.motion, result.moments.usable
    alpha = _row(np.degrees(motion.alpha), np.degrees(result.alpha_sigma))
    meridian = _row(np.degrees(motion.windward_meridian), np.degrees(result.phi_w_sigma))
    plane, error = result.plane_moments[usable], result.moments.sigma[usable]
    return [
        ("angle of attack", "deg", *alpha),
        ("windward meridian, turns added up", "deg", *meridian),
        ("in-plane moment C_N'", "1", *_row(plane.real, error)),
        ("out-of-plane moment C_Z'", "1", *_row(plane.imag, error)),
    ]


def reconstruction_charts(result: Reconstruction) -> list[Chart]:
    """The record as measured; motion and moments with their standard deviations."""
    usable, motion = result.moments.usable, result.motion
    plane = result.plane_moments[usable]
    start, stop = float(motion.time[0]), float(motion.time[-1])
    setting = Setting((start, stop), masked=masked(result.flight.faults, stop - start))
    angles = (motion.time, motion.alpha, motion.windward_meridian)
    measured = (plane.real, plane.imag)
    return [
        *record_charts(setting, result.flight),
        motion_chart(setting, *angles, result.alpha_sigma, result.phi_w_sigma),
        moment_chart(setting, motion.time[usable], measured, result.moments.sigma[usable], ()),
        attitude_chart(setting, *angles, motion.p),
        moment_by_alpha_chart(setting, motion.alpha[usable], measured, ()),
        spectrum_chart(
            setting,
            motion.time[usable],
            {"measured": (measured, "measured")},
            turning_rates(motion.p, motion.windward_meridian_rate),
        ),
    ]


def _row(values: FloatArray, sigma: FloatArray) -> tuple[str, str, str]:
    rms = float(np.sqrt(np.mean(sigma**2)))
    return number(float(values.min())), number(float(values.max())), number(rms, 2)


def reconstruction_data(result: Reconstruction) -> dict[str, Any]:
    """The outcome as data for JSON; the histories are in the motion file."""
    flight = result.flight
    return {
        "schema": "brv-hypo/reconstruct/1",
        "flight": {
            "path": flight.path,
            "samples": flight.samples,
            "start_s": float(flight.time[0]),
            "stop_s": float(flight.time[-1]),
            "sample_rate_hz": flight.sample_rate,
        },
        "reconstruction": {
            "method": result.method,
            "status": result.status,
            "alpha_rms_sigma_rad": result.alpha_rms_sigma,
            "phi_w_rms_sigma_rad": result.phi_w_rms_sigma,
            "moment_rms_sigma": float(np.sqrt(np.mean(result.moments.sigma[result.moments.usable] ** 2))),
            "gravity_body_m_s2": result.gravity_body,
            "gyro_sigma_rad_s": result.gyro_sigma,
            "accel_sigma_m_s2": result.accel_sigma,
            "warnings": list(result.warnings),
        },
    }
