"""A reconstruction as a document and as data: ranges and standard deviations of the histories, and their charts.

First come charts of the record as it was measured: forces, rates, and the attitude by integration of the
rates alone, in which there is no wind; then motion and moments. `reconstruction_document` is the entrance.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.comparison.result import MotionHistories
from brv_hypo.comparison.summary import motion_histories, motion_summary
from brv_hypo.flight.record import Flight
from brv_hypo.io.text import interval, number
from brv_hypo.motion import Reconstruction
from brv_hypo.motion.inertial import body_attitude
from brv_hypo.report import motion_charts as charts
from brv_hypo.report.document import Chart, Document, Line, Panel, Table, Texts
from brv_hypo.report.motion_charts import Drawn, Setting
from brv_hypo.report.tables import motion_known


def record_charts(setting: Setting, flight: Flight) -> list[Chart]:
    """Accelerometers, gyros, pitch and yaw by integrated rates, without wind, as the report's Figures 5.1 to 5.4."""
    _, attitude = body_attitude(flight.time, flight.p, flight.q + 1j * flight.r)
    forward, right, down = attitude[:, :, 0].T  # of the nose
    nose = np.degrees([np.arcsin(np.clip(-down, -1.0, 1.0)), np.unwrap(np.arctan2(right, forward))])
    forces = {f"a<sub>{axis}</sub>, m/s²": getattr(flight, f"a{axis}") for axis in "xyz"}
    rates = {f"{name}, deg/s": np.degrees(getattr(flight, name)) for name in "pqr"}
    angles = dict(zip(("theta, deg", "psi, deg"), nose, strict=True))
    read = "In the body axes of the first sample, where both are zero. Biases of the gyros accumulate."

    def chart(name: str, heading: str, histories: Mapping[str, FloatArray], caption: str = "") -> Chart:
        panels = [Panel(title, [Line(flight.time, history, "measured")]) for title, history in histories.items()]
        return setting.chart(name, heading, panels, caption)

    return [
        chart("accelerations", "Accelerometers", forces),
        chart("rates", "Rate gyros", rates),
        chart("integrated-attitude", "Pitch and yaw by integrated rates", angles, read),
    ]


def record_document(flight: Flight) -> Document:
    """A record as it was measured: its charts, and what was changed on reading."""
    setting = Setting((float(flight.time[0]), float(flight.time[-1])))
    return Document(
        title=f"Record: {flight.title or flight.path}",
        subtitle=(),
        conclusion_title="Record",
        conclusion=flight.headline(),
        decided=not flight.faults,
        blocks=(*record_charts(setting, flight), Texts(flight.notes, "Notes")),
    )


def reconstruction_charts(result: Reconstruction) -> list[Chart]:
    """The record as measured; motion and moments with their standard deviations."""
    usable, motion = result.moments.usable, result.motion
    start, stop = float(motion.time[0]), float(motion.time[-1])
    setting = Setting((start, stop), shaded=charts.shaded(result.flight.faults, stop - start, result.flight.gaps_s))
    kept = MotionHistories(**motion_histories(result, np.arange(motion.time.size)))
    plane = result.plane_moments[usable]
    measured = np.stack([plane.real, plane.imag])
    return [
        *record_charts(setting, result.flight),
        *charts.flight_charts(setting, kept),
        charts.moment_chart(setting, motion.time[usable], result.moments.sigma[usable], (), measured),
        charts.moment_by_alpha_chart(setting, motion.alpha[usable], measured, ()),
        charts.spectrum_chart(setting, kept, [Drawn("measured", measured, "measured")]),
    ]


def reconstruction_document(result: Reconstruction) -> Document:
    """Ranges and standard deviations of the histories, noise levels, warnings; on a page the charts."""
    flight = result.flight
    span = f"{flight.samples} samples, {interval((float(flight.time[0]), float(flight.time[-1])))} s"
    rate = f"{flight.sample_rate:.4g} Hz, instruments {flight.instruments.described}"
    gyros, forces = number(result.gyro_sigma, 2), number(result.accel_sigma, 2)
    moved = "compare and trace move it, and the errors of the record, to fit a model of the moments, and say how far."
    known = f"{motion_known(motion_summary([result]))}. {moved}"
    more = f" (and {len(result.warnings) - 1} more)" if len(result.warnings) > 1 else ""
    return Document(
        title=f"Reconstruction: {flight.title or flight.path}",
        subtitle=(flight.title or flight.path, f"{span}, {rate}"),
        conclusion_title="Motion",
        conclusion=known if result.status == "ok" else f"{known} Degraded: {result.warnings[0]}{more}",
        decided=result.status == "ok",
        blocks=(
            Table(history_rows(result), words=("history", "unit")),
            Texts((f"white noise of gyros {gyros} rad/s, of accelerometers {forces} m/s²",), bullets=False),
            Texts(result.warnings, "Warnings", warning=True),
            *reconstruction_charts(result),
            Texts(flight.notes, "Notes", shown="page"),
        ),
    )


def history_rows(result: Reconstruction) -> list[dict[str, str]]:
    """One row for each history: range, and the rms of its standard deviation, where the record has no gap."""
    motion, usable, known = result.motion, result.moments.usable, result.flight.measured()
    plane, error = result.plane_moments[usable], result.moments.sigma[usable]
    alpha, meridian = np.degrees(motion.alpha[known]), np.degrees(motion.windward_meridian[known])
    histories: list[tuple[str, str, FloatArray, FloatArray]] = [
        ("angle of attack", "deg", alpha, np.degrees(result.alpha_sigma[known])),
        ("windward meridian, unwrapped", "deg", meridian, np.degrees(result.phi_w_sigma[known])),
        ("in-plane moment C_m,in", "1", plane.real, error),
        ("side moment C_n,side", "1", plane.imag, error),
    ]
    return [
        {
            "history": name,
            "unit": unit,
            "least": number(float(values.min())),
            "greatest": number(float(values.max())),
            "sigma (rms)": number(float(np.sqrt(np.mean(sigma**2))), 2),
        }
        for name, unit, values, sigma in histories
    ]


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
