"""A reconstruction in words and as data."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from brv_hypo.arrays import FloatArray
from brv_hypo.motion import Reconstruction
from brv_hypo.report.style import interval, number, plain_table, warning_list

# Name, what it is (the values and their standard deviations), factor to the unit shown, unit.
_QUANTITIES = (
    ("angle of attack", "alpha", "alpha_sigma", np.degrees(1.0), "deg"),
    ("windward meridian", "windward_meridian", "phi_w_sigma", np.degrees(1.0), "deg"),
)


def reconstruction_line(result: Reconstruction) -> str:
    """The outcome in one line."""
    alpha = number(float(np.degrees(result.alpha_rms_sigma)), 2)
    return (
        f"motion by the {result.method} method ({result.status}): known to {alpha} deg in alpha and "
        f"{number(result.phi_w_rms_sigma, 2)} rad in meridian (rms)"
    )


def reconstruction_view(result: Reconstruction) -> RenderableType:
    """Ranges and standard deviations of the histories, noise levels and warnings."""
    flight = result.flight
    span = interval((float(flight.time[0]), float(flight.time[-1])))
    gravity = ", ".join(number(float(value)) for value in result.gravity_body)
    return Group(
        Text(flight.title or flight.path, "bold"),
        Text(f"{flight.samples} samples, {span} s, {flight.sample_rate:.4g} Hz"),
        Text(reconstruction_line(result)),
        Text(),
        history_table(result),
        Text(),
        Text(f"gravity in body axes at the start ({gravity}) m/s²"),
        Text(f"white noise of gyros {number(result.gyro_sigma, 2)} rad/s, of accelerometers "
             f"{number(result.accel_sigma, 2)} m/s²"),
        warning_list(result.warnings),
    )  # fmt: skip


def history_table(result: Reconstruction) -> Table:
    """One row for each history: range, rms, and the rms of its standard deviation."""
    table = plain_table()
    table.add_column("history", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    for heading in ("least", "greatest", "sigma (rms)"):
        table.add_column(heading, justify="right", no_wrap=True)
    for name, values, sigma, factor, unit in _QUANTITIES:
        history, error = getattr(result.motion, values), getattr(result, sigma)
        table.add_row(name, unit, *_row(factor * history, factor * error))
    usable = result.moments.usable
    plane = result.plane_moments[usable]
    error = result.moments.sigma[usable]
    table.add_row("in-plane moment C_N'", "1", *_row(plane.real, error))
    table.add_row("out-of-plane moment C_Z'", "1", *_row(plane.imag, error))
    return table


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
