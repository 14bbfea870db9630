"""Aerodynamic moments beyond the linear static moment and constant damping, of a body of revolution.

Magnus                C_npalpha (p d / 2V) alpha, out of plane
cubic static moment   C_malpha3 alpha^3, in plane
Mach, Reynolds        static moment and pitch damping whose coefficients follow Mach or Reynolds number
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.mechanisms import Mechanism, Term, hookimpl
from brv_hypo.motion.motion import Motion


class Magnus(Mechanism):
    """C_Z' += C_npalpha (p d / 2V) alpha; nothing in plane."""

    name = "magnus"
    title = "Magnus moment"
    claims = "an out-of-plane moment proportional to roll rate and angle of attack"
    source = "Vaughn and Reis, AIAA J. 13:872, 1975; standard spinning-body aerodynamics"
    kind = "aerodynamic"
    time_variation = ("constant",)

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One term: C_npalpha."""
        nothing = np.zeros_like(motion.alpha)
        return (Term("C_npalpha", nothing, motion.p * motion.rate_factor * motion.alpha, "1/rad^2"),)


class CubicStiffness(Mechanism):
    """C_N' += C_malpha3 alpha^3: the first power after the linear one that symmetry allows."""

    name = "cubic_stiffness"
    title = "cubic static moment"
    claims = "a static in-plane moment that stiffens or softens with the cube of the angle of attack"
    source = "Murphy, Free Flight Motion of Symmetric Missiles, BRL Report 1216, 1963"
    kind = "aerodynamic"
    time_variation = ("constant",)
    wind_fixed = True

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One term: C_malpha3."""
        return (Term("C_malpha3", motion.alpha**3, np.zeros_like(motion.alpha), "1/rad^3"),)


# ---- Static and damping moments that change with Mach or Reynolds number along the flight ----


class Similar(Mechanism):
    """A coefficient that is a polynomial, without its constant, in a similarity parameter."""

    source = "standard similarity of aerodynamic coefficients"
    kind = "aerodynamic"
    time_variation = ("constant",)
    parameter: ClassVar[str]
    """The similarity parameter, as terms are named by it."""

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
        rate = motion.to_plane(np.asarray((motion.q + 1j * motion.r) * motion.rate_factor * x, dtype=complex))
        return (Term(f"C_mq * {self.parameter}", rate.real, rate.imag, "1/rad"),)


class MachStiffness(SimilarStiffness):
    """C_N' += alpha sum_k c_k (Mach / 10)^k, k to `degree`."""

    name = "mach_stiffness"
    title = "static moment that changes with Mach number"
    claims = "a slope of the in-plane moment that follows the Mach number"
    parameter = "(Mach/10)"
    follows = "mach"

    degree: int = 3


class ReynoldsStiffness(SimilarStiffness):
    """C_N' += alpha sum_k c_k log10(Re / 1e6)^k, k to `degree`."""

    name = "reynolds_stiffness"
    title = "static moment that changes with Reynolds number"
    claims = "a slope of the in-plane moment that follows the logarithm of the Reynolds number"
    parameter = "log10(Re/1e6)"
    follows = "reynolds"

    degree: int = 2


class MachDamping(SimilarDamping):
    """C_m + i C_n += c (Mach / 10) (q + i r) d / 2V."""

    name = "mach_damping"
    title = "pitch damping that changes with Mach number"
    claims = "a moment against the transverse rates whose coefficient follows the Mach number"
    parameter = "Mach/10"


class ReynoldsDamping(SimilarDamping):
    """C_m + i C_n += c log10(Re / 1e6) (q + i r) d / 2V."""

    name = "reynolds_damping"
    title = "pitch damping that changes with Reynolds number"
    claims = "a moment against the transverse rates whose coefficient follows the log of the Reynolds number"
    parameter = "log10(Re/1e6)"


@hookimpl
def brv_hypo_mechanisms() -> Sequence[Mechanism]:
    """The effects of this module."""
    stiffness = [CubicStiffness(), MachStiffness(), ReynoldsStiffness()]
    return [Magnus(), *stiffness, MachDamping(), ReynoldsDamping()]
