"""Asymmetric in-plane flow: jumps and ramps in C_m0 and C_malpha, nothing out of plane (Table 2.1, b)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from brv_hypo.mechanisms import Mechanism, Term, hookimpl
from brv_hypo.model.baseline import static_terms
from brv_hypo.motion.motion import Motion


class InPlane(Mechanism):
    """C_N' += jump or ramp in C_m0 and in C_malpha at the knots of Eq. 3.6."""

    name, title = "inplane", "asymmetric in-plane flow"
    claims = "sudden or ramping changes of the in-plane moment, at alpha = 0 and per alpha; nothing out of plane"
    source = "report, Table 2.1 (b) and Table 5.5"
    stated_family = "stiffness"
    time_variation = ("jump", "ramp")
    characteristic = ("C_m0",)
    wind_fixed = True

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """Two terms: C_m0 and C_malpha."""
        return static_terms(motion)


@hookimpl
def brv_hypo_mechanisms() -> Sequence[Mechanism]:
    """The mechanisms of this module."""
    return [InPlane()]
