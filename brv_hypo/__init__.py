"""Hypothesis testing for spinning entry bodies: which mechanism explains the moments that were flown?

load_flight(path)              flight record -> Flight                     brv_hypo.flight
reconstruct(flight)            wind-relative motion and moments            brv_hypo.model
compare(flights, config)       competing mechanisms, ranked, with verdict  brv_hypo.comparison
trace(flight, config)          the residual, traced to its effect          brv_hypo.tracing
predict(flight, model, refit)  a model of other flights on this one        brv_hypo.prediction
simulate(config)               6-DOF flights with planted mechanisms       brv_hypo.simulation
run_study(study, folder)       many simulated flights, each compared       brv_hypo.study
best_subsets, fit              the kernels, on bare arrays                 brv_hypo.subset, .likelihood
plot_compare(comparison)       also write_report, write_figures: pages     brv_hypo.report.write
Mechanism, hookimpl            how to write a mechanism of your own        brv_hypo.mechanisms

Where things are: the command line in cli; mechanisms, effects, processes in `plugins`; methods of reconstruction in
motion/methods; formats in importing/formats; tolerances of instrument grades in flight/tolerances.py; what decides a
fault, a verdict or a finding in thresholds.py; errors with their exit codes in errors.py.
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from brv_hypo.comparison.compare import compare as compare
    from brv_hypo.flight import load_flight as load_flight
    from brv_hypo.model.reconstruction import reconstruct as reconstruct
    from brv_hypo.prediction.predict import predict as predict
    from brv_hypo.report.write import plot_compare as plot_compare
    from brv_hypo.simulation import simulate as simulate
    from brv_hypo.study import run_study as run_study
    from brv_hypo.tracing.trace import trace as trace

_HOME = {
    "load_flight": "brv_hypo.flight",
    "reconstruct": "brv_hypo.model.reconstruction",
    "compare": "brv_hypo.comparison",
    "plot_compare": "brv_hypo.report.write",
    "trace": "brv_hypo.tracing",
    "predict": "brv_hypo.prediction",
    "simulate": "brv_hypo.simulation",
    "run_study": "brv_hypo.study",
}
__all__ = ["compare", "load_flight", "plot_compare", "predict", "reconstruct", "run_study", "simulate", "trace"]


def __getattr__(name: str) -> Any:
    """The public functions, imported at first use: the package itself costs nothing to import."""
    if name == "__version__":
        from importlib.metadata import PackageNotFoundError, version

        try:
            return version("brv-hypo")
        except PackageNotFoundError:  # the package runs without having been installed
            return "unknown"
    if not name.startswith("_") and find_spec(f"{__name__}.{name}") is not None:
        return import_module(f"{__name__}.{name}")
    if name not in _HOME:
        raise AttributeError(f"module 'brv_hypo' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return [*__all__]
