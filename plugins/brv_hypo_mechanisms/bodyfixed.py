"""Body-fixed moment at phi_b: body irregularities hold a moment in one meridian (Table 2.1, c)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.mechanisms import Derived, Mechanism, Term, hookimpl
from brv_hypo.motion.motion import Motion


class BodyFixed(Mechanism):
    """C_N' += C_b cos(phi_b - phi_w); C_Z' += C_b sin(phi_w - phi_b) (Section 5.3.2, erratum E7).

    Linear in (C_b cos phi_b, C_b sin phi_b): the cotangent elimination of the report is not needed.
    `per_cycle` is Chrusciel's variant: magnitude and location hold over one cycle of the meridian only.
    """

    name, title = "bodyfixed", "body-fixed moment at phi_b"
    claims = "a moment that keeps its direction in the body while the wind turns around it, in and out of plane"
    source = "report, Table 2.1 (c), Section 5.3.2; Chrusciel (1973) per cycle"
    stated_family = "body"
    terms_enter_together = True

    variant: Literal["regions", "per_cycle"] = "regions"

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """Two terms: the components of the moment at phi_b = 0 and at phi_b = pi / 2."""
        cosine, sine = np.cos(motion.windward_meridian), np.sin(motion.windward_meridian)
        return (Term("C_b cos(phi_b)", cosine, sine, "1"), Term("C_b sin(phi_b)", sine, -cosine, "1"))

    def knots(self, motion: Motion) -> FloatArray | None:
        """Per cycle: the times at which the meridian has turned by another whole turn."""
        if self.variant == "regions":
            return None
        turns = np.floor(np.abs(motion.windward_meridian - motion.windward_meridian[0]) / (2.0 * np.pi))
        return np.asarray(motion.time[1:][np.diff(np.maximum.accumulate(turns)) > 0], dtype=float)

    def derived(self, values: Mapping[str, float], covariance: FloatArray) -> tuple[Derived, ...]:
        """C_b and phi_b with standard errors, to first order in the covariance (2, 2); nothing where both are 0."""
        pair = values["C_b cos(phi_b)"], values["C_b sin(phi_b)"]
        return Derived.polar("C_b", "phi_b", pair, covariance)


@hookimpl
def brv_hypo_mechanisms() -> Sequence[Mechanism]:
    """The mechanisms of this module."""
    return [BodyFixed()]
