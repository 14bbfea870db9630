"""Wind-fixed flow that sticks to the body for a short time: discrete delays (Section 5.3.1, Eq. 5.1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

import numpy as np

from brv_hypo.mechanisms import Delays, Mechanism, Parameter, Term, hookimpl
from brv_hypo.motion.motion import Motion


class Sticking(Mechanism):
    """C_Z' += eps C_mw(t - tau) sin(phi_w(t) - phi_w(t - tau)), for one delay of Eq. 5.1: near ones are alike.

    `complete` adds the in-plane part that Eq. 5.1 leaves out, eps (C_mw(t - tau) cos(dphi) - C_mw(t)).
    """

    name, title = "sticking", "flow sticking for a discrete delay"
    claims = "a fraction of the wind-fixed flow stays at the meridian of a fixed time ago"
    source = "report, Eq. 5.1, Tables 5.7 and 5.8"
    bounds: ClassVar[Mapping[str, tuple[float, float]]] = {"eps": (0.0, 1.0)}

    form: Literal["printed", "complete"] = "printed"
    delays: Delays = (0.02, 0.04, 0.08, 0.125, 0.2, 0.3, 0.5)

    def parameters(self) -> tuple[Parameter, ...]:
        """The delay tau, s."""
        bounds = (0.3 * self.delays[0], 1.5 * self.delays[-1])
        return (Parameter("delay", "s", self.delays, bounds, "time that the flow sticks", is_delay=True),)

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One term: the sticking fraction eps."""
        past = motion.delayed(theta["delay"])
        turned = motion.windward_meridian - past.windward_meridian
        in_plane = np.zeros_like(turned)
        if self.form == "complete":
            in_plane = past.in_plane_moment * np.cos(turned) - motion.in_plane_moment
        return (Term("eps", in_plane, past.in_plane_moment * np.sin(turned), "1"),)


@hookimpl
def brv_hypo_mechanisms() -> Sequence[Mechanism]:
    """The mechanisms of this module."""
    return [Sticking()]
