"""Damping that changes in plane: more, or less, which may feed the oscillation (Table 2.1, a: unstable damping)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from brv_hypo.mechanisms import Mechanism, Term, hookimpl
from brv_hypo.motion.motion import Motion


class Damping(Mechanism):
    """C_N' += c (alpha_dot d / 2V); `complete` adds out of plane c alpha (p - phi_w_dot) d / 2V, of the precession."""

    name, title = "damping", "unstable damping"
    claims = "more damping, or less, in the plane of alpha; nothing out of plane"
    source = "report, Table 2.1 (a)"
    stated_family = "rate"

    form: Literal["in_plane", "complete"] = "in_plane"

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One term: the damping coefficient, per unit of rate times d / 2V."""
        in_plane = motion.alpha_rate * motion.rate_factor
        out_of_plane = np.zeros_like(in_plane)
        if self.form == "complete":
            out_of_plane = motion.alpha * (motion.p - motion.windward_meridian_rate) * motion.rate_factor
        return (Term("C_damping", in_plane, out_of_plane, "1/rad"),)


@hookimpl
def brv_hypo_mechanisms() -> Sequence[Mechanism]:
    """The mechanisms of this module."""
    return [Damping()]
