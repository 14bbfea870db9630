"""Moments of a slight asymmetry of shape or mass, which keep their direction in the body.

unequal stiffness     d alpha (cos 2 phi_w, sin 2 phi_w) in plane axes
trim                  C_m0, C_n0 constant in the body; a c.g. off the axis
dynamic imbalance     products of inertia: a torque proportional to p^2
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms import Derived, Mechanism, Term, hookimpl
from brv_hypo.motion.motion import Motion


class StiffnessAsymmetry(Mechanism):
    """C_m += d alpha cos(phi_w), C_n += d alpha sin(phi_w): stiffer in pitch by d, softer in yaw by as much.

    In plane axes d alpha (cos 2 phi_w, sin 2 phi_w). The second term has its axes at 45 deg.
    """

    name = "stiffness_asymmetry"
    title = "unequal pitch and yaw stiffness"
    claims = "a moment proportional to alpha that turns in plane axes at twice the windward meridian"
    source = "Nicolaides, On the Free Flight Motion of Missiles Having Slight Asymmetries, BRL 858, 1953"
    kind = "aerodynamic"
    time_variation = ("constant",)
    terms_enter_together = True

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """Two terms: half the difference of the slopes, about the body's own axes and at 45 deg."""
        twice = 2.0 * motion.windward_meridian
        cosine, sine = motion.alpha * np.cos(twice), motion.alpha * np.sin(twice)
        return (Term("pitch-yaw", cosine, sine, "1/rad"), Term("diagonal", -sine, cosine, "1/rad"))


# ---- Moments of a slight asymmetry of mass or shape that keep their place in the body ----


class Trim(Mechanism):
    """C_m += C_m0, C_n += C_n0: constant in the body. A c.g. off the axis gives it too.

    By that the axial force turns the vehicle: the moment follows its coefficient, where the motion tells it.
    """

    name = "trim"
    title = "constant body-fixed moment"
    claims = "a moment coefficient that is constant in body axes: trim asymmetry, or a c.g. off the axis"
    source = "Nicolaides, BRL Report 858, 1953"
    kind = "aerodynamic"
    time_variation = ("constant",)
    terms_enter_together = True

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """Two terms: C_m0 and C_n0, at the median of the axial force's coefficient."""
        one = np.ones_like(motion.alpha) if motion.axial_share is None else motion.axial_share
        nothing = np.zeros_like(motion.alpha)
        return _body_axes(motion, one, nothing, "C_m0", "1"), _body_axes(motion, nothing, one, "C_n0", "1")

    def tolerance(self, flight: Flight) -> tuple[float, ...]:
        """A c.g. that lies off the axis within its tolerance: offset times axial force coefficient over d."""
        vehicle = flight.vehicle
        axial = float(np.median(np.abs(flight.ax) / flight.dynamic_pressure)) * vehicle.mass / vehicle.reference_area
        _, y, z = flight.instruments.cg_offset
        return axial * z / vehicle.reference_length, axial * y / vehicle.reference_length

    def derived(self, values: Mapping[str, float], covariance: FloatArray) -> tuple[Derived, ...]:
        """Size and meridian of the moment, to first order in the covariance (2, 2)."""
        pair = values["C_m0"], values["C_n0"]
        return Derived.polar("C_trim", "phi_trim", pair, covariance, sense=-1.0)


class DynamicImbalance(Mechanism):
    """C_m += (J_y (p^2 - r^2) + J_z (pdot + q r)) / q_inf, C_n += (J_y (q r - pdot) + J_z (p^2 - q^2)) / q_inf.

    J_y = -I_xz / (S d), J_z = I_xy / (S d): Euler's equations with products of inertia, to first order in them. The
    normal force on a c.g. off the axis rolls the vehicle in time with its coning: pdot then looks like a moment that
    goes with alpha.
    """

    name = "dynamic_imbalance"
    title = "dynamic imbalance (product of inertia)"
    claims = "a body-fixed torque proportional to roll rate squared: so the coefficient to p^2 / q_inf"
    source = "Euler's equations with products of inertia; Vaughn, SC-R-68-1803, 1968"
    kind = "aerodynamic"
    time_variation = ("constant",)
    terms_enter_together = True

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """Two terms: the products of inertia over S d, -I_xz and I_xy."""
        p, q, r = motion.p, motion.q, motion.r
        change = np.zeros_like(p) if motion.roll_acceleration is None else motion.roll_acceleration
        pressure, units = motion.dynamic_pressure, "Pa s^2/rad^2"
        return (
            _body_axes(motion, (p**2 - r**2) / pressure, (q * r - change) / pressure, "-I_xz/(S d)", units),
            _body_axes(motion, (change + q * r) / pressure, (p**2 - q**2) / pressure, "I_xy/(S d)", units),
        )

    def tolerance(self, flight: Flight) -> tuple[float, ...]:
        """A principal axis that is tilted within its tolerance: tilt times I - Ix, over S d."""
        vehicle = flight.vehicle
        size = abs(vehicle.iyy - vehicle.ixx) / (vehicle.reference_area * vehicle.reference_length)
        _, y, z = flight.instruments.principal_axis
        return size * y, size * z


def _body_axes(motion: Motion, about_y: FloatArray, about_z: FloatArray, name: str, units: str) -> Term:
    """A term from its moments about body y and z."""
    plane = motion.to_plane(np.asarray(about_y + 1j * about_z, dtype=complex))
    return Term(name, plane.real, plane.imag, units)


@hookimpl
def brv_hypo_mechanisms() -> Sequence[Mechanism]:
    """The effects of this module."""
    return [StiffnessAsymmetry(), Trim(), DynamicImbalance()]
