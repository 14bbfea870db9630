"""Hypothesis testing for spinning entry bodies: which mechanism explains the moments that were flown?

load_flight(path)              flight record -> Flight                     brv_hypo.flight
reconstruct(flight)            wind-relative motion and moments            brv_hypo.motion
compare(flights, config)       competing mechanisms, ranked, with verdict  brv_hypo.ranking
trace(flight, config)          what is left over, traced to its effect     brv_hypo.trace
simulate(config)               6-DOF flights with planted mechanisms       brv_hypo.simulate
best_subsets, fit              the kernels, on bare arrays                 brv_hypo.subset, .likelihood
Mechanism, hookimpl            how to write a mechanism of your own        brv_hypo.mechanisms
brv-hypo --help                the command line                            brv_hypo.cli
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from brv_hypo.flight import load_flight as load_flight
    from brv_hypo.motion import reconstruct as reconstruct
    from brv_hypo.ranking import compare as compare
    from brv_hypo.simulate import simulate as simulate
    from brv_hypo.trace import trace as trace

__all__ = ["compare", "load_flight", "reconstruct", "simulate", "trace"]

_HOME = {
    "load_flight": "brv_hypo.flight",
    "reconstruct": "brv_hypo.motion",
    "compare": "brv_hypo.ranking",
    "trace": "brv_hypo.trace",
    "simulate": "brv_hypo.simulate",
}


class _Package(ModuleType):
    """Keeps `brv_hypo.simulate` and `brv_hypo.trace` the functions.

    The import system would put the subpackages of these names in their place when it first imports them.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if name not in _HOME or not isinstance(value, ModuleType):
            super().__setattr__(name, value)

    def __getattr__(self, name: str) -> Any:
        """The public functions, imported at first use: the package itself costs nothing to import."""
        if name not in _HOME:
            raise AttributeError(f"module 'brv_hypo' has no attribute {name!r}")
        return getattr(import_module(_HOME[name]), name)

    def __dir__(self) -> list[str]:
        return [*__all__]


sys.modules[__name__].__class__ = _Package
