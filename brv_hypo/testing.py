"""For plugin authors: the conformance kit, and flights on which a mechanism or an effect is planted and looked for.

`brv-hypo docs mechanism` and `docs effect` have examples. To be planted the plugin must be installed, or loaded with
`brv_hypo.mechanisms.use_plugin_files`.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

from brv_hypo.comparison import CompareConfig, Comparison, compare
from brv_hypo.flight import Flight
from brv_hypo.mechanisms import Mechanism, RecordEffect
from brv_hypo.mechanisms.conformance import EFFECT_CHECKS as EFFECT_CHECKS
from brv_hypo.mechanisms.conformance import MECHANISM_CHECKS as MECHANISM_CHECKS
from brv_hypo.mechanisms.conformance import Nonconformity as Nonconformity
from brv_hypo.mechanisms.conformance import checks_of
from brv_hypo.mechanisms.conformance import conformance as conformance
from brv_hypo.mechanisms.conformance import sample_flight as sample_flight
from brv_hypo.mechanisms.conformance import sample_motion as sample_motion
from brv_hypo.simulation import SimulatedFlight, load_config, simulate
from brv_hypo.simulation.instruments import with_errors
from brv_hypo.tracing import Trace, TraceConfig, trace

VEHICLE = "research_cone"
DURATION, SAMPLE_RATE = 4.0, 100.0  # s and Hz: short enough for a test, long enough to show a mechanism that matters


def check_mechanism(mechanism: Mechanism | RecordEffect) -> None:
    """Every check of the conformance kit on a mechanism, installed or not; raises Nonconformity with what was found."""
    for check in checks_of(mechanism):
        check(mechanism)


def plant(
    mechanism: str,
    terms: Mapping[str, float],
    theta: Mapping[str, float] | None = None,
    *,
    start: float | None = None,
    stop: float | None = None,
    vehicle: str = VEHICLE,
    seed: int = 1,
) -> SimulatedFlight:
    """A short 6-DOF flight with instrument errors on which a mechanism acts from `start` to `stop` (s).

    `terms` holds the coefficient of each term, `theta` its nonlinear parameters; UsageError for unknown ones. What acts
    throughout may be taken for a process of its shape: state times.
    """
    planted = {"mechanism": mechanism, "terms": dict(terms), "theta": dict(theta or {}), "start": start, "stop": stop}
    entry = {key: value for key, value in planted.items() if value is not None}
    return simulate({"base": vehicle, **_short(vehicle), "mechanisms": [entry]}, seed=seed)


def recover(flown: SimulatedFlight | Flight, mechanism: str, *rivals: str) -> Comparison:
    """The comparison of a mechanism with `none` and the rivals, by regression, which takes seconds."""
    return compare(flown, CompareConfig(mechanisms=(mechanism, *rivals), maximum_likelihood="none"))


def plant_effect(effect: str, component: str, value: float, *, vehicle: str = VEHICLE, seed: int = 1) -> Flight:
    """A short flight with nothing planted, whose record has `value` (SI) of that component more, or UsageError."""
    return with_errors(_unplanted(vehicle, seed), {effect: {component: value}})


def recover_effect(flight: Flight, effect: str, *rivals: str) -> Trace:
    """The trace of a flight that tries an effect and the rivals alone, and discovers nothing of its own."""
    return trace(flight, TraceConfig(effects=(effect, *rivals), discover=False, max_steps=2))


@lru_cache(maxsize=4)
def _unplanted(vehicle: str, seed: int) -> Flight:
    return simulate({"base": vehicle, **_short(vehicle), "mechanisms": []}, seed=seed).flight


def _short(vehicle: str) -> dict[str, float]:
    """Duration and rate for a test, never more than the vehicle's own."""
    own = load_config(vehicle)
    return {"duration": min(DURATION, own.duration), "sample_rate": min(SAMPLE_RATE, own.sample_rate)}
