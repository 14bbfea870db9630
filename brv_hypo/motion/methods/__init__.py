"""The reconstruction methods of Section 3.2, one file each, on one interface.

joint      method 3 with Section 3.2.3: gyros, accelerometers, initial conditions and gravity at once
velocity   method 1: Eq. 3.1 propagated from a start
rates      method 2: attitude alone, about a velocity that keeps its direction or turns by gravity
polar      Appendix A: the start from one instant, then method 1
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from brv_hypo.motion.config import Method, ReconstructionConfig
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.methods.joint import joint
from brv_hypo.motion.methods.polar import polar
from brv_hypo.motion.methods.rates import rates
from brv_hypo.motion.methods.velocity import velocity
from brv_hypo.motion.methods.wind_history import WindHistory
from brv_hypo.motion.perturbation import Perturbation

_Finder = Callable[[InertialRecord, ReconstructionConfig, Sequence[Perturbation]], WindHistory]

METHODS: dict[Method, _Finder] = {
    "joint": joint,
    "velocity": velocity,
    "rates": rates,
    "polar": polar,
}

__all__ = ["METHODS", "WindHistory", "joint"]
