"""Instrument errors of Appendix B (errata E10, E11) as parameters: what each does to a reading.

Misalignment (m1, m2, m3) is the small rotation from the body's axes to the instrument's: a reading gains v x
m. `time_skew` is how late the accelerometers are against the gyros.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray

Theta = Mapping[str, float]


@dataclass(frozen=True)
class InstrumentError:
    """One parameter: `group` is chosen or left out as a whole; `size` is its prior standard deviation, in
    `units`.
    """

    name: str
    group: str
    units: str
    size: float

    @property
    def affine(self) -> bool:
        """Whether it enters a reading alone, and as it is."""
        return self.group in ("gyro_bias", "accel_bias")


INSTRUMENT_ERRORS = (
    InstrumentError("gyro_bias q", "gyro_bias", "rad/s", 5e-3),
    InstrumentError("gyro_bias r", "gyro_bias", "rad/s", 5e-3),
    InstrumentError("gyro_bias p", "gyro_bias p", "rad/s", 5e-3),
    InstrumentError("gyro_scale q", "gyro_scale", "1", 0.02),
    InstrumentError("gyro_scale r", "gyro_scale", "1", 0.02),
    InstrumentError("gyro_scale p", "gyro_scale p", "1", 0.02),
    InstrumentError("gyro_misalignment x", "gyro_misalignment", "rad", 0.01),
    InstrumentError("gyro_misalignment y", "gyro_misalignment", "rad", 0.01),
    InstrumentError("gyro_misalignment z", "gyro_misalignment", "rad", 0.01),
    InstrumentError("accel_bias y", "accel_bias", "m/s^2", 0.5),
    InstrumentError("accel_bias z", "accel_bias", "m/s^2", 0.5),
    InstrumentError("accel_scale y", "accel_scale", "1", 0.02),
    InstrumentError("accel_scale z", "accel_scale", "1", 0.02),
    InstrumentError("accel_misalignment x", "accel_misalignment", "rad", 0.01),
    InstrumentError("accel_misalignment y", "accel_misalignment", "rad", 0.01),
    InstrumentError("accel_misalignment z", "accel_misalignment", "rad", 0.01),
    InstrumentError("accel_position x", "accel_position", "m", 0.1),
    InstrumentError("accel_position y", "accel_position", "m", 0.1),
    InstrumentError("accel_position z", "accel_position", "m", 0.1),
    InstrumentError("time_skew", "time_skew", "s", 0.02),
)
GROUPS = tuple(dict.fromkeys(error.group for error in INSTRUMENT_ERRORS))
TIME_SKEW = "time_skew"
ROLL_RATE_ERRORS = ("gyro_bias p", "gyro_scale p")


def of_flight(name: str, flight: int) -> str:
    """The parameter's name for one flight: each flight has its own instruments."""
    return f"{name} [flight {flight}]"


@dataclass(frozen=True)
class InstrumentReadings:
    """What one flight's instruments make of the truth, at the values in `theta`; errors not in it are
    zero.
    """

    theta: Theta
    flight: int

    def value(self, name: str) -> float:
        """Value of one error of this flight."""
        return self.theta.get(of_flight(name, self.flight), 0.0)

    def roll_rate_error(self, p: FloatArray) -> FloatArray:
        """Measured less true roll rate, rad/s, at the measured one."""
        return np.asarray(self.value("gyro_bias p") + self.value("gyro_scale p") * p)

    def gyros(self, omega: ComplexArray, p: FloatArray) -> ComplexArray:
        """What the transverse gyros read of q + i r (rad/s) at roll rate p."""
        return self._triad("gyro", omega, p)

    def accelerometers(self, force: ComplexArray, axial: FloatArray) -> ComplexArray:
        """What the transverse accelerometers read of f_y + i f_z (m/s^2) at axial specific force `axial`."""
        return self._triad("accel", force, axial)

    def arm(self, declared: tuple[float, float, float]) -> tuple[float, float, float]:
        """Position of the accelerometers from the c.g. (3,), m."""
        x, y, z = (d + self.value(f"accel_position {axis}") for d, axis in zip(declared, "xyz", strict=True))
        return x, y, z

    def _triad(self, kind: str, transverse: ComplexArray, axial: FloatArray) -> ComplexArray:
        first, second = ("q", "r") if kind == "gyro" else ("y", "z")
        turn = [self.value(f"{kind}_misalignment {axis}") for axis in "xyz"]
        y, z = transverse.real, transverse.imag
        y, z = y + z * turn[0] - axial * turn[2], z + axial * turn[1] - y * turn[0]
        y = (1.0 + self.value(f"{kind}_scale {first}")) * y + self.value(f"{kind}_bias {first}")
        z = (1.0 + self.value(f"{kind}_scale {second}")) * z + self.value(f"{kind}_bias {second}")
        return np.asarray(y + 1j * z)


def lever_force(
    arm: tuple[float, float, float],
    omega: ComplexArray,
    omega_rate: ComplexArray,
    p: FloatArray,
    p_rate: FloatArray,
) -> ComplexArray:
    """omega_dot x r + omega x (omega x r) across the body, f_y + i f_z in m/s^2 (Appendix B, errata E10,
    E11).
    """
    x, transverse = arm[0], complex(arm[1], arm[2])
    crossed = (omega * np.conj(transverse)).imag
    return np.asarray(
        x * (p * omega - 1j * omega_rate) + (1j * p_rate - p**2) * transverse + 1j * omega * crossed
    )
