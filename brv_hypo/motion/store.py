"""A reconstruction on disk: one HDF5 file, every dataset with its units."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.flight.hdf5 import Dataset, Tree, write_tree
from brv_hypo.motion.reconstruction import Reconstruction

FORMAT = "brv-motion"
FORMAT_VERSION = 1  # of the motion file; raised when what it holds changes its meaning


def write_motion(reconstruction: Reconstruction, path: str | Path, *, overwrite: bool = False) -> None:
    """Write the motion, the moments and their standard deviations (n,), whole or not at all.

    `time` is the dimension scale of all root datasets; root attributes hold method, status and warnings.
    Raises UsageError where the file exists and `overwrite` is false, or where it cannot be written.
    """
    motion, flight = reconstruction.motion, reconstruction.flight
    histories = {
        "time": (motion.time, "s"),
        "alpha": (motion.alpha, "rad"),
        "alpha_sigma": (reconstruction.alpha_sigma, "rad"),
        "alpha_rate": (motion.alpha_rate, "rad/s"),
        "windward_meridian": (motion.windward_meridian, "rad"),
        "windward_meridian_sigma": (reconstruction.phi_w_sigma, "rad"),
        "windward_meridian_rate": (motion.windward_meridian_rate, "rad/s"),
        "p": (motion.p, "rad/s"),
        "q": (motion.q, "rad/s"),
        "r": (motion.r, "rad/s"),
        "velocity": (motion.velocity, "m/s"),
        "dynamic_pressure": (motion.dynamic_pressure, "Pa"),
        "mach": (motion.mach, "dimensionless"),
        "reynolds": (motion.reynolds, "dimensionless"),
        "normal_force_slope": (reconstruction.normal_force_slope, "1/rad"),
        **_moments(reconstruction),
    }
    attributes = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "title": flight.title,
        "source": flight.source,
        "method": reconstruction.method,
        "status": reconstruction.status,
        "warnings": "\n".join(reconstruction.warnings),
    }
    single = {
        "gravity_body": Dataset(reconstruction.gravity_body, "m/s^2"),
        "gyro_sigma": Dataset(np.asarray(reconstruction.gyro_sigma), "rad/s"),
        "accel_sigma": Dataset(np.asarray(reconstruction.accel_sigma), "m/s^2"),
        "noise_correlation": Dataset(reconstruction.moments.noise_correlation, "dimensionless"),
    }
    datasets = {name: Dataset(values, units) for name, (values, units) in histories.items()}
    write_tree(path, Tree(attributes, datasets, {"estimate": Tree(datasets=single)}), overwrite=overwrite)


def _moments(reconstruction: Reconstruction) -> dict[str, tuple[FloatArray, str]]:
    """Moment coefficients, NaN where there is no estimate."""
    moments = reconstruction.moments
    known = np.where(moments.usable, 1.0, np.nan)
    body, plane = moments.body * known, reconstruction.plane_moments * known
    return {
        "C_m": (body.real, "dimensionless"),
        "C_n": (body.imag, "dimensionless"),
        "C_N_prime": (plane.real, "dimensionless"),
        "C_Z_prime": (plane.imag, "dimensionless"),
        "moment_sigma": (moments.sigma * known, "dimensionless"),
        "moment_noise_sigma": (moments.noise_sigma * known, "dimensionless"),
    }
