"""Aerodynamic moments beyond the linear static moment and constant damping, of a body of revolution.

    Magnus                C_npalpha (p d / 2V) alpha, out of plane
    cubic static moment   C_malpha3 alpha^3, in plane
    Mach, Reynolds        static moment and pitch damping whose coefficients follow Mach or Reynolds number
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.mechanisms import Mechanism, Term, hookimpl
from brv_hypo.motion.motion import Motion

# ---- Magnus moment: spin turns the crossflow's moment out of plane ----


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


# ---- Static moment that is not linear in the angle of attack ----


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


_SOURCE = "standard similarity of aerodynamic coefficients"


def _mach(motion: Motion) -> FloatArray:
    """Mach number in tens."""
    return np.asarray(motion.mach / 10.0, dtype=float)


def _reynolds(motion: Motion) -> FloatArray:
    """Decades of Reynolds number above a million."""
    return np.asarray(np.log10(motion.reynolds / 1e6), dtype=float)


def _stiffness(motion: Motion, quantity: FloatArray, name: str) -> Term:
    return Term(f"C_malpha * {name}", motion.alpha * quantity, np.zeros_like(motion.alpha), "1/rad")


def _damping(motion: Motion, quantity: FloatArray, name: str) -> Term:
    body = np.asarray((motion.q + 1j * motion.r) * motion.rate_factor * quantity, dtype=complex)
    rate = motion.to_plane(body)
    return Term(f"C_mq * {name}", rate.real, rate.imag, "1/rad")


class MachStiffness(Mechanism):
    """C_N' += alpha sum_k c_k (Mach / 10)^k, k to `degree`."""

    name = "mach_stiffness"
    title = "static moment that changes with Mach number"
    claims = "a slope of the in-plane moment that follows the Mach number"
    source = _SOURCE
    kind = "aerodynamic"
    time_variation = ("constant",)
    wind_fixed = True
    follows = "mach"

    degree: int = 3

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One term for each power of the Mach number."""
        return tuple(
            _stiffness(motion, _mach(motion) ** k, f"(Mach/10)^{k}") for k in range(1, self.degree + 1)
        )


class ReynoldsStiffness(Mechanism):
    """C_N' += alpha sum_k c_k log10(Re / 1e6)^k, k to `degree`."""

    name = "reynolds_stiffness"
    title = "static moment that changes with Reynolds number"
    claims = "a slope of the in-plane moment that follows the logarithm of the Reynolds number"
    source = _SOURCE
    kind = "aerodynamic"
    time_variation = ("constant",)
    wind_fixed = True
    follows = "reynolds"

    degree: int = 2

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One term for each power of the decades of Reynolds number."""
        return tuple(
            _stiffness(motion, _reynolds(motion) ** k, f"log10(Re/1e6)^{k}")
            for k in range(1, self.degree + 1)
        )


class MachDamping(Mechanism):
    """C_m + i C_n += c (Mach / 10) (q + i r) d / 2V."""

    name = "mach_damping"
    title = "pitch damping that changes with Mach number"
    claims = "a moment against the transverse rates whose coefficient follows the Mach number"
    source = _SOURCE
    kind = "aerodynamic"
    time_variation = ("constant",)

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One term: the change of C_mq per ten Mach numbers."""
        return (_damping(motion, _mach(motion), "Mach/10"),)


class ReynoldsDamping(Mechanism):
    """C_m + i C_n += c log10(Re / 1e6) (q + i r) d / 2V."""

    name = "reynolds_damping"
    title = "pitch damping that changes with Reynolds number"
    claims = "a moment against the transverse rates whose coefficient follows the log of the Reynolds number"
    source = _SOURCE
    kind = "aerodynamic"
    time_variation = ("constant",)

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One term: the change of C_mq per decade of Reynolds number."""
        return (_damping(motion, _reynolds(motion), "log10(Re/1e6)"),)


@hookimpl
def brv_hypo_mechanisms() -> Sequence[Mechanism]:
    """The effects of this module."""
    return [
        Magnus(),
        CubicStiffness(),
        MachStiffness(),
        ReynoldsStiffness(),
        MachDamping(),
        ReynoldsDamping(),
    ]
