"""`Reconstruction`: motion, moments and how well each is known; `write_motion` writes it as one HDF5 file.

`WindHistory` is what a method of reconstruction returns.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.io.binary import Dataset, Tree, write_tree
from brv_hypo.motion.inertial import InertialRecord, WindStart
from brv_hypo.motion.interpolation import Quadrature
from brv_hypo.motion.methods import Method
from brv_hypo.motion.motion import Motion, angle_of_attack, at_nodes, crossflow, quadrature
from brv_hypo.motion.responses import EffectFit
from brv_hypo.motion.signals import InputError, rms
from brv_hypo.results import HasCharts, Histories

UNKNOWN_ANGLE = float(np.pi / np.sqrt(3.0))  # rad, standard deviation of an angle of which nothing is known
FORMAT = "brv-motion"
FORMAT_VERSION = 1  # of the motion file; raised when what it holds changes its meaning


@dataclass(frozen=True)
class WindHistory:
    """The wind relative to the vehicle over a record of n samples, and how well it is known."""

    # what it was found in: the flight's inertial record, corrected by the errors that were estimated
    record: InertialRecord
    crossflow: ComplexArray  # (v + i w) / V (n,) in body axes
    radial_sigma: FloatArray  # standard deviation (n,) of the crossflow along itself
    tangential_sigma: FloatArray  # standard deviation (n,) across it
    gravity: FloatArray  # (3,) m/s^2 in body axes at the first sample
    normal_force_slope: FloatArray  # (n,) 1/rad at alpha = 0, NaN where the method does not estimate it
    accel_sigma: float  # white noise of the accelerometers as estimated by the fit, m/s^2
    effects: EffectFit  # the estimated errors of the record
    warnings: tuple[str, ...] = ()  # what limits the result
    wander: float = 0.0  # what both err by besides: gusts, where the force has more than its noise
    converged: bool = True  # whether the search for the motion ended
    normal_force_bend: float = 0.0  # what the slope gains with the square of alpha, 1/rad^3

    @property
    def alpha_sigma(self) -> FloatArray:
        """Standard deviation of alpha (n,), rad."""
        return np.asarray(np.hypot(self.radial_sigma, self.wander) / np.cos(angle_of_attack(self.crossflow)))

    @property
    def phi_w_sigma(self) -> FloatArray:
        """Standard deviation of the windward meridian (n,), rad; that of an unknown angle near alpha = 0."""
        size = np.maximum(np.abs(self.crossflow), 1e-12)
        return np.asarray(np.minimum(np.hypot(self.tangential_sigma, self.wander) / size, UNKNOWN_ANGLE))


@dataclass(frozen=True)
class MomentEstimate:
    """Moment coefficients from differentiated gyros, with their noise. The noise is so correlated in the axes that turn
    with (1 - Ix/I) of the roll: exp(i spin_angle) times the pressure makes it stationary.
    """

    body: ComplexArray  # C_m + i C_n (n,), corrected by the estimated errors of the record
    # standard deviation (n,) of each component by noise and by what is not known of those errors; not white
    sigma: FloatArray
    noise_sigma: FloatArray  # the same by the gyros' noise alone
    usable: BoolArray  # False (n,) where no estimate is made
    noise_correlation: FloatArray  # correlation of the noise at lags of 0, 1, ... samples (2 half_width + 1,)
    spin_angle: FloatArray  # (n,) rad

    def __repr__(self) -> str:
        return f"<MomentEstimate: {self.body.size} samples, {np.count_nonzero(self.usable)} usable>"


@dataclass(frozen=True)
class EffectEstimate:
    """What the reconstruction says of one component of an error of the record."""

    effect: str  # its name
    component: str  # which of its components
    units: str  # of the three sizes below
    size: float  # the tolerance to which it was known before
    value: float  # the estimate
    std_error: float  # its standard deviation


def angle_known(sigma: float) -> str:
    """A standard deviation of an angle (rad) in words; beyond a right angle its size says nothing."""
    degrees = float(np.degrees(sigma))
    return f"{degrees:.2g} deg" if degrees < 90.0 else "no better than 90 deg"


@dataclass(frozen=True, eq=False, repr=False)
class Reconstruction(HasCharts, Histories):
    """Wind-relative motion and moments of one flight of n samples, on the gyros' clock, within tolerance of time."""

    flight: Flight  # the record as it was reconstructed
    method: Method  # that of the reconstruction
    motion: Motion  # the most likely motion
    moments: MomentEstimate  # moments on it
    alpha_sigma: FloatArray  # standard deviation (n,) of alpha, rad, that by the clock included
    alpha_sigma_on_clock: FloatArray  # the same without that by the clock, and by wander of the velocity
    phi_w_sigma: FloatArray  # standard deviation (n,) of the windward meridian, rad, that by the clock included
    gravity_body: FloatArray  # (3,) m/s^2 in body axes at the first sample
    # C_Nalpha (n,) of the force at alpha = 0, 1/rad; NaN where the method does not estimate it
    normal_force_slope: FloatArray
    gyro_sigma: float  # white noise of the gyros, estimated from the record, rad/s
    accel_sigma: float  # white noise of the accelerometers, m/s^2
    effects: tuple[EffectEstimate, ...]  # the errors that the record was allowed to have
    corrected: Flight  # the flight corrected by the estimates of those errors
    status: Literal["ok", "degraded"]  # degraded where there are warnings
    warnings: tuple[str, ...]  # what limits the result and what would help
    # what smoothing left of the noise of inputs, where `flight` holds them smoothed
    input_errors: tuple[InputError, ...] = ()
    normal_force_bend: float = 0.0  # what the slope gains with the square of alpha, 1/rad^3
    own_warnings: tuple[str, ...] = ()  # those of the errors of this motion, of which an analysis has its own
    converged: bool = True  # whether the search for the motion ended; else the errors are no bound

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

    @cached_property
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
        return rms(self.alpha_sigma[self.flight.measured()])

    @property
    def phi_w_rms_sigma(self) -> float:
        """Root mean square of the standard deviation of the windward meridian, rad, where there is no gap."""
        return rms(self.phi_w_sigma[self.flight.measured()])


def write_motion(reconstruction: Reconstruction, path: str | Path, *, overwrite: bool = False) -> None:
    """Write the columns of a result, rates, air data and body moments (n,), whole or not at all. `time` is the
    dimension scale of all root datasets; root attributes hold method, status and warnings. Raises UsageError where the
    file exists and `overwrite` is false, or where it cannot be written.
    """
    motion, flight = reconstruction.motion, reconstruction.flight
    known = np.where(reconstruction.moments.usable, 1.0, np.nan)
    body, columns = reconstruction.moments.body * known, dict(reconstruction.columns())
    histories = {
        "s": {"time": columns.pop("time")},
        "rad": {name: columns.pop(name) for name, unit in reconstruction.units().items() if unit == "rad"},
        "rad/s": {
            **{"alpha_rate": motion.alpha_rate, "windward_meridian_rate": motion.windward_meridian_rate},
            **{"p": motion.p, "q": motion.q, "r": motion.r},
        },
        "m/s": {"velocity": motion.velocity},
        "Pa": {"dynamic_pressure": motion.dynamic_pressure},
        "1/rad": {"normal_force_slope": reconstruction.normal_force_slope},
        "dimensionless": {
            **{"mach": motion.mach, "reynolds": motion.reynolds},
            **{"C_m": body.real, "C_n": body.imag, "moment_sigma": columns.pop("C_sigma"), **columns},
            "moment_noise_sigma": reconstruction.moments.noise_sigma * known,
        },
    }
    attributes = {
        **{"format": FORMAT, "format_version": FORMAT_VERSION, "title": flight.title, "source": flight.source},
        **{"method": reconstruction.method, "status": reconstruction.status},
        "warnings": "\n".join(reconstruction.warnings),
    }
    single = {
        "gravity_body": Dataset(reconstruction.gravity_body, "m/s^2"),
        "gyro_sigma": Dataset(np.asarray(reconstruction.gyro_sigma), "rad/s"),
        "accel_sigma": Dataset(np.asarray(reconstruction.accel_sigma), "m/s^2"),
        "noise_correlation": Dataset(reconstruction.moments.noise_correlation, "dimensionless"),
    }
    datasets = {name: Dataset(values, units) for units, each in histories.items() for name, values in each.items()}
    write_tree(path, Tree(attributes, datasets, {"estimate": Tree(datasets=single)}), overwrite=overwrite)
