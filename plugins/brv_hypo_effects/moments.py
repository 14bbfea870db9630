"""Aerodynamic moments beyond the linear static moment and constant damping, and those of a slight asymmetry."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms import Derived, Mechanism, Parameter, Term, hookimpl
from brv_hypo.motion.motion import Motion


class Aerodynamic(Mechanism):
    """A moment of any real vehicle, with constant coefficients: no hypothesis of its own, but one of the loop's."""

    kind = "aerodynamic"
    time_variation = ("constant",)


class Magnus(Aerodynamic):
    """C_Z' += C_npalpha (p d / 2V) alpha; nothing in plane."""

    name, title, stated_family = "magnus", "Magnus moment", "side"
    claims = "an out-of-plane moment proportional to roll rate and angle of attack"
    source = "Vaughn and Reis, AIAA J. 13:872, 1975; standard spinning-body aerodynamics"

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One term: C_npalpha."""
        nothing = np.zeros_like(motion.alpha)
        return (Term("C_npalpha", nothing, motion.p * motion.rate_factor * motion.alpha, "1/rad^2"),)


class CubicStiffness(Aerodynamic):
    """C_N' += C_malpha3 alpha^3: the first power after the linear one that symmetry allows."""

    name, title, stated_family = "cubic_stiffness", "cubic static moment", "stiffness"
    claims = "a static in-plane moment by the cube of alpha: stiffer, or softer"
    source = "Murphy, Free Flight Motion of Symmetric Missiles, BRL Report 1216, 1963"
    wind_fixed = True

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One term: C_malpha3."""
        return (Term("C_malpha3", motion.alpha**3, np.zeros_like(motion.alpha), "1/rad^3"),)


class AftbodyLag(Aerodynamic):
    """C_N' + i C_Z' += -c / Mach^2 (d / V) (f'(alpha) alpha_dot + i f(alpha) (p - phi_w_dot)), f = a tanh(alpha / a).

    The pressure on the aftbody follows the angle of attack a few flow times d / V late, as the wake needs them; its
    moment saturates at the angle a and falls with Mach number as a vacuum at the base does, 2 / (gamma Mach^2). This is
    what the delay changes, to first order: it is milliseconds, less than records resolve. c is the aftbody's slope at
    Mach 1 times the delay in flow times. Of a stable aftbody (c < 0) it feeds the oscillation below about the angle a:
    beside a stable C_mq the amplitude tends to a limit cycle, as that of capsules does at Mach 1.5 to 3.
    """

    name, title, stated_family = "aftbody_lag", "lagged aftbody moment", "rate"
    claims = "an aftbody moment that follows alpha late: damping that is lost at small angles"
    source = "Schoenenberger and Queen, RTO-MP-AVT-152, 2008; Kazemba, time-lagged aftbody moments, Georgia Tech 2012"

    angles: tuple[float, ...] = (1.0, 2.0, 4.0, 8.0)

    def parameters(self) -> tuple[Parameter, ...]:
        """The angle a, deg."""
        bounds = (0.5 * min(self.angles), 2.0 * max(self.angles))
        return (Parameter("angle", "deg", self.angles, bounds, "angle of attack at which the aftbody saturates"),)

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One term: c."""
        angle = np.radians(theta["angle"])
        late = -2.0 * motion.rate_factor / motion.mach**2
        moment = np.tanh(motion.alpha / angle)
        in_plane = late * (1.0 - moment**2) * motion.alpha_rate
        across = late * angle * moment * (motion.p - motion.windward_meridian_rate)
        return (Term("C_malpha aftbody lag", in_plane, across, "1/rad"),)


class Similar(Aerodynamic):
    """A coefficient that is a polynomial, without its constant, in a similarity parameter."""

    source = "standard similarity of aerodynamic coefficients"
    parameter: ClassVar[str]  # the similarity parameter, as terms are named by it

    degree: int = 1

    def powers(self, motion: Motion) -> dict[str, FloatArray]:
        """Powers of the parameter up to `degree`, by name; Mach number in tens, Reynolds number in decades."""
        scaled = motion.mach / 10.0 if "Mach" in self.parameter else np.log10(motion.reynolds / 1e6)
        return {f"{self.parameter}^{k}": np.asarray(scaled**k, dtype=float) for k in range(1, self.degree + 1)}


class SimilarStiffness(Similar):
    """C_N' += alpha sum_k c_k x^k."""

    wind_fixed = True

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One term for each power of the similarity parameter."""
        nothing = np.zeros_like(motion.alpha)
        powers = self.powers(motion).items()
        return tuple(Term(f"C_malpha * {name}", motion.alpha * x, nothing, "1/rad") for name, x in powers)


class SimilarDamping(Similar):
    """C_m + i C_n += c x (q + i r) d / 2V."""

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One term: the change of C_mq per unit of the similarity parameter."""
        (x,) = self.powers(motion).values()
        rate = x * motion.plane_rates
        return (Term(f"C_mq * {self.parameter}", rate.real, rate.imag, "1/rad"),)


class MachStiffness(SimilarStiffness):
    """C_N' += alpha sum_k c_k (Mach / 10)^k, k to `degree`."""

    name, title, stated_family = "mach_stiffness", "static moment that changes with Mach number", "stiffness"
    claims = "a slope of the in-plane moment that follows the Mach number"
    parameter, follows = "(Mach/10)", "mach"
    degree: int = 3


class ReynoldsStiffness(SimilarStiffness):
    """C_N' += alpha sum_k c_k log10(Re / 1e6)^k, k to `degree`."""

    name, title, stated_family = "reynolds_stiffness", "static moment that changes with Reynolds number", "stiffness"
    claims = "a slope of the in-plane moment that follows the log of the Reynolds number"
    parameter, follows = "log10(Re/1e6)", "reynolds"
    degree: int = 2


class MachDamping(SimilarDamping):
    """C_m + i C_n += c (Mach / 10) (q + i r) d / 2V."""

    name, title, stated_family = "mach_damping", "pitch damping that changes with Mach number", "rate"
    claims = "a moment against the transverse rates whose coefficient follows the Mach number"
    parameter = "Mach/10"


class ReynoldsDamping(SimilarDamping):
    """C_m + i C_n += c log10(Re / 1e6) (q + i r) d / 2V."""

    name, title, stated_family = "reynolds_damping", "pitch damping that changes with Reynolds number", "rate"
    claims = "a moment against the transverse rates that follows the log of the Reynolds number"
    parameter = "log10(Re/1e6)"


class StiffnessAsymmetry(Aerodynamic):
    """C_m += d alpha cos(phi_w), C_n += d alpha sin(phi_w): stiffer in pitch by d, softer in yaw by as much. In plane
    axes d alpha (cos 2 phi_w, sin 2 phi_w). The second term has its axes at 45 deg.
    """

    name, title, stated_family = "stiffness_asymmetry", "unequal pitch and yaw stiffness", "harmonic"
    claims = "a moment by alpha that turns in plane axes at twice the meridian"
    source = "Nicolaides, On the Free Flight Motion of Missiles Having Slight Asymmetries, BRL 858, 1953"
    terms_enter_together = True

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """Two terms: half the difference of the slopes, about the body's own axes and at 45 deg."""
        twice = 2.0 * motion.windward_meridian
        cosine, sine = motion.alpha * np.cos(twice), motion.alpha * np.sin(twice)
        return (Term("pitch-yaw", cosine, sine, "1/rad"), Term("diagonal", -sine, cosine, "1/rad"))


class Trim(Aerodynamic):
    """C_m += C_m0, C_n += C_n0: constant in the body. A c.g. off the axis gives it too. By that the axial force turns
    the vehicle: the moment follows its coefficient, where the motion tells it.
    """

    name, title, stated_family = "trim", "constant body-fixed moment", "body"
    claims = "a moment that is constant in body axes: asymmetry, or a c.g. off the axis"
    source = "Nicolaides, BRL Report 858, 1953"
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
        return Derived.polar("C_trim", "phi_trim", (values["C_m0"], values["C_n0"]), covariance, sense=-1.0)


class DynamicImbalance(Aerodynamic):
    """C_m += (J_y (p^2 - r^2) + J_z (pdot + q r)) / q_inf, C_n += (J_y (q r - pdot) + J_z (p^2 - q^2)) / q_inf.

    J_y = -I_xz / (S d), J_z = I_xy / (S d): Euler's equations with products of inertia, to first order in them. The
    normal force on a c.g. off the axis rolls the vehicle in time with its coning: pdot then looks like one by alpha.
    """

    name, title, stated_family = "dynamic_imbalance", "dynamic imbalance (product of inertia)", "body"
    claims = "a body-fixed torque by roll rate squared: its coefficient by p^2 / q_inf"
    source = "Euler's equations with products of inertia; Vaughn, SC-R-68-1803, 1968"
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
    by_similarity = [MachStiffness(), ReynoldsStiffness(), MachDamping(), ReynoldsDamping()]
    asymmetries = [StiffnessAsymmetry(), Trim(), DynamicImbalance()]
    return [Magnus(), CubicStiffness(), AftbodyLag(), *by_similarity, *asymmetries]
