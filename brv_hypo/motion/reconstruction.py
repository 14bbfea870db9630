"""`Reconstruction`: motion, moments and how well each is known; `write_motion` writes it as one HDF5 file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.io.hdf5 import Dataset, Tree, write_tree
from brv_hypo.motion.config import Method
from brv_hypo.motion.inertial import WindStart
from brv_hypo.motion.kinematics import crossflow
from brv_hypo.motion.motion import Motion, Quadrature, at_nodes, quadrature
from brv_hypo.motion.signals import InputError
from brv_hypo.results import HasCharts, Histories

# ---- The result of a reconstruction: motion, moments and how well each is known ----


@dataclass(frozen=True)
class MomentEstimate:
    """Moment coefficients from differentiated gyros, with the noise that differentiation gives them.

    `body` (n,) is C_m + i C_n, less what was found of the record's errors; `noise_sigma` (n,) the standard
    deviation of each of its two components by the gyros' noise; `sigma` (n,) the same by noise and by all
    that is not known of the record's errors, which is anything but white. `filter_half_width` samples and
    `noise_correlation` (2 half_width + 1,) describe the noise's colour: its correlation at lag 0, 1, ...
    samples. `usable` (n,) is False where no estimate is made. The noise is so correlated in the axes that
    turn with (1 - Ix/I) of the roll: multiply `body` by exp(i spin_angle), `spin_angle` (n,) rad, and by the
    dynamic pressure, to have it stationary.
    """

    body: ComplexArray
    sigma: FloatArray
    noise_sigma: FloatArray
    usable: BoolArray
    filter_half_width: int
    noise_correlation: FloatArray
    spin_angle: FloatArray

    def __repr__(self) -> str:
        """Short: the arrays are long."""
        return f"<MomentEstimate: {self.body.size} samples, {np.count_nonzero(self.usable)} usable>"


@dataclass(frozen=True)
class EffectEstimate:
    """What the reconstruction says of one component of an error of the record, in `units`.

    `size` is the tolerance to which it was known before; `value` and `std_error` what is known after.
    """

    effect: str
    component: str
    units: str
    size: float
    value: float
    std_error: float


def angle_known(sigma: float) -> str:
    """A standard deviation of an angle (rad) in words; beyond a right angle its size says nothing."""
    degrees = float(np.degrees(sigma))
    return f"{degrees:.2g} deg" if degrees < 90.0 else "no better than 90 deg"


@dataclass(frozen=True)
class Reconstruction(HasCharts, Histories):
    """Wind-relative motion and moments of one flight.

    Standard deviations (n,): `alpha_sigma`, `phi_w_sigma` rad. `gravity_body` (3,) m/s^2 is gravity in body
    axes at the first sample; `normal_force_slope` (n,) 1/rad is C_Nalpha of the force at alpha = 0, a spline in
    time of `normal_force_terms` coefficients (0 where it was not found), to which `normal_force_bend` (1/rad^3) adds
    with the square of alpha; `gyro_sigma` rad/s and `accel_sigma` m/s^2
    are the white-noise levels estimated from the record. `status` is "ok" or "degraded"; `warnings` say what
    limits the result and what would help. `effects` are the errors that the record was allowed to have;
    `corrected` is the flight with what was found of them taken out. `input_errors` are what smoothing left of
    the noise of inputs, where `flight` holds them smoothed. The motion is on the gyros' clock, which may be late
    against time by `clock_sigma` s: both standard deviations hold what it moves meanwhile, `alpha_sigma_on_clock` (n,)
    does not.
    """

    flight: Flight
    method: Method
    motion: Motion
    moments: MomentEstimate
    alpha_sigma: FloatArray
    alpha_sigma_on_clock: FloatArray
    phi_w_sigma: FloatArray
    gravity_body: FloatArray
    normal_force_slope: FloatArray
    gyro_sigma: float
    accel_sigma: float
    effects: tuple[EffectEstimate, ...]
    corrected: Flight
    status: Literal["ok", "degraded"]
    warnings: tuple[str, ...]
    input_errors: tuple[InputError, ...] = ()
    normal_force_terms: int = 0
    normal_force_bend: float = 0.0
    clock_sigma: float = 0.0

    __repr__ = Histories.__repr__
    __eq__ = Histories.__eq__

    @property
    def normal_force_ratio(self) -> FloatArray:
        """The normal force's C_N / alpha (n,), 1/rad, at the motion as it is."""
        return np.asarray(self.normal_force_slope + self.normal_force_bend * self.motion.alpha**2)

    def headline(self) -> str:
        """The flight, the method, and how well the motion is known."""
        return (
            f"{self.flight.title or self.flight.path or 'flight'}: {self.method} method, {self.status}; alpha known to "
            f"{angle_known(self.alpha_rms_sigma)}, meridian to {angle_known(self.phi_w_rms_sigma)} (rms)"
        )

    def columns(self) -> Mapping[str, Any]:
        """Time (s), angles and their standard deviations (rad), moments C_N', C_Z' with theirs; NaN where unusable."""
        usable = self.moments.usable
        plane = np.where(usable, self.plane_moments, np.nan)
        return {
            "time": self.motion.time,
            "alpha": self.motion.alpha,
            "alpha_sigma": self.alpha_sigma,
            "windward_meridian": self.motion.windward_meridian,
            "windward_meridian_sigma": self.phi_w_sigma,
            "C_N_prime": plane.real,
            "C_Z_prime": np.where(usable, plane.imag, np.nan),
            "C_sigma": np.where(usable, self.moments.sigma, np.nan),
        }

    def units(self) -> Mapping[str, str]:
        """Units of the columns."""
        return {name: "s" if name == "time" else "1" if name.startswith("C_") else "rad" for name in self.columns()}

    @property
    def crossflow(self) -> ComplexArray:
        """(v + i w) / V (n,) in body axes."""
        return crossflow(self.motion.alpha, self.motion.windward_meridian)

    @cached_property
    def nodes(self) -> Quadrature:
        """Where its moments are evaluated to be integrated."""
        return quadrature(self.motion, self.flight.segments)

    @cached_property
    def motion_at_nodes(self) -> Motion:
        """The motion there."""
        return at_nodes(self.motion, self.nodes)

    @property
    def start(self) -> WindStart:
        """Direction of the velocity and gravity at the first sample, in its body axes."""
        first = crossflow(self.motion.alpha[:1], self.motion.windward_meridian[:1])[0]
        return WindStart(np.array([np.cos(self.motion.alpha[0]), first.real, first.imag]), self.gravity_body)

    @property
    def plane_moments(self) -> ComplexArray:
        """C_N' + i C_Z' (n,)."""
        return self.motion.to_plane(self.moments.body)

    @property
    def alpha_rms_sigma(self) -> float:
        """Root mean square of the standard deviation of alpha, rad, where the record has no gap."""
        return float(np.sqrt(np.mean(self.alpha_sigma[self._measured] ** 2)))

    @property
    def phi_w_rms_sigma(self) -> float:
        """Root mean square of the standard deviation of the windward meridian, rad, where there is no gap."""
        return float(np.sqrt(np.mean(self.phi_w_sigma[self._measured] ** 2)))

    @property
    def _measured(self) -> BoolArray:
        inside = np.zeros(self.flight.samples, dtype=bool)
        for start, stop in self.flight.segments:
            inside[start:stop] = True
        return inside


# ---- A reconstruction on disk: one HDF5 file, every dataset with its units ----


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
