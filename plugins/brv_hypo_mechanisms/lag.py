"""Total moment lag: the whole moment answers late to angle of attack and meridian (Table 2.1, d)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from brv_hypo.mechanisms import Delays, Mechanism, Parameter, Term, hookimpl
from brv_hypo.motion.motion import Motion


class Lag(Mechanism):
    """(C_N', C_Z') = C_m[t - tau] (cos phi_L, sin phi_L), phi_L = tau d(phi_w)/dt (Figure 2.4).

    The term is what the lag changes: the lagged moment less the moment that the baseline already holds. Its
    coefficient is the lagging fraction of the moment, 1 where all of it lags.
    """

    name, title = "lag", "total moment lag"
    claims = "the total moment follows alpha and meridian late; out of plane in step with the meridian rate"
    source = "report, Table 2.1 (d), Figure 2.4"
    bounds: ClassVar[Mapping[str, tuple[float, float]]] = {"lag fraction": (0.0, 1.0)}

    delays: Delays = (0.005, 0.01, 0.02, 0.04, 0.07, 0.11, 0.16, 0.22, 0.3)

    def parameters(self) -> tuple[Parameter, ...]:
        """The delay tau, s."""
        bounds = (0.3 * self.delays[0], 1.5 * self.delays[-1])
        return (Parameter("delay", "s", self.delays, bounds, "delay of the total moment", is_delay=True),)

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One term: the lagging fraction."""
        tau = theta["delay"]
        lagged = motion.delayed(tau).in_plane_moment
        phi_lag = tau * motion.windward_meridian_rate
        return (Term("lag fraction", lagged * np.cos(phi_lag) - motion.in_plane_moment, lagged * np.sin(phi_lag), "1"),)


@hookimpl
def brv_hypo_mechanisms() -> Sequence[Mechanism]:
    """The mechanisms of this module."""
    return [Lag()]
