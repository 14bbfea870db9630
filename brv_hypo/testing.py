"""For plugin authors: the conformance kit, and flights on which a mechanism or an effect is planted and looked for.

    from brv_hypo.testing import check_mechanism, plant, recover

    def test_is_recovered():
        flown = plant("uneven_ablation", {"k": 0.01})
        assert recover(flown, "uneven_ablation").verdict.winner == "uneven_ablation"

    def test_keeps_the_contract():
        check_mechanism(UnevenAblation())

To be planted the plugin must be installed, or loaded with `brv_hypo.mechanisms.use_plugin_files`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np

from brv_hypo.comparison import CompareConfig, Comparison, compare
from brv_hypo.comparison.preparation import shared_problem
from brv_hypo.errors import UsageError
from brv_hypo.flight import Flight
from brv_hypo.inference.fit import HypothesisFit, fit_hypothesis
from brv_hypo.inference.problem import Problem
from brv_hypo.mechanisms import Mechanism, MomentProcess, RecordEffect, find_installed
from brv_hypo.mechanisms.conformance import EFFECT_CHECKS as EFFECT_CHECKS
from brv_hypo.mechanisms.conformance import MECHANISM_CHECKS as MECHANISM_CHECKS
from brv_hypo.mechanisms.conformance import Alias as Alias
from brv_hypo.mechanisms.conformance import Nonconformity as Nonconformity
from brv_hypo.mechanisms.conformance import checks_of, uniform_time
from brv_hypo.mechanisms.conformance import conformance as conformance
from brv_hypo.mechanisms.conformance import renamed as renamed
from brv_hypo.mechanisms.conformance import sample_flight as sample_flight
from brv_hypo.mechanisms.conformance import sample_motion as sample_motion
from brv_hypo.model.reconstruction import reconstruct
from brv_hypo.simulation import SimulatedFlight, load_config, simulate
from brv_hypo.tracing import Trace, TraceConfig, trace

VEHICLE = "research_cone"
DURATION, SAMPLE_RATE = 4.0, 100.0
"""s and Hz: short enough for a test, long enough to tell a mechanism that matters."""
OTHER_UNITS = {"s": ("ms", 1e-3), "rad": ("deg", np.pi / 180.0), "1/s": ("1/min", 1.0 / 60.0), "1": ("percent", 0.01)}
"""What `check_mechanism` measures parameters in, and one of it in their own units."""
NAMES_APART = 1e-9
"""What names and units may change of a fit, relatively: its last digits."""


def check_mechanism(mechanism: Mechanism, *, vehicle: str = VEHICLE) -> None:
    """Every check of the conformance kit, and a fit that its parameters' names and units do not change.

    The mechanism need not be installed. Raises Nonconformity with what was found and what is expected.
    """
    for check in checks_of(mechanism):
        check(mechanism)
    if isinstance(mechanism, MomentProcess):  # no parameters, and no fit of its own
        return
    aliases = {
        parameter.name: Alias(f"{parameter.name} elsewhere", *OTHER_UNITS.get(parameter.units, (parameter.units, 1.0)))
        for parameter in mechanism.parameters()
    }
    own, other = (_fitted(each, vehicle) for each in (mechanism, renamed(mechanism, aliases)))
    apart = float(np.max(np.abs(other.values - own.values) / np.max(np.abs(own.values))))
    apart = max(apart, abs(other.rss / own.rss - 1.0))
    if not apart <= NAMES_APART:
        raise Nonconformity(
            f"under other names and units of its parameters the fit differs by {apart:.1e} of itself, expected at most "
            f"{NAMES_APART:g}. Let `terms` depend on the values in theta alone, each in the units declared for it."
        )


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

    `terms` holds the coefficient of each of its terms, `theta` its nonlinear parameters.
    Raises UsageError for an unknown mechanism, term or parameter.
    """
    planted = {"mechanism": mechanism, "terms": dict(terms), "theta": dict(theta or {}), "start": start, "stop": stop}
    entry = {key: value for key, value in planted.items() if value is not None}
    return simulate({"base": vehicle, **_short(vehicle), "mechanisms": [entry]}, seed=seed)


def recover(flown: SimulatedFlight | Flight, mechanism: str, *rivals: str) -> Comparison:
    """The comparison of a mechanism with `none` and the rivals, by regression, which takes seconds."""
    return compare(flown, CompareConfig(mechanisms=(mechanism, *rivals), maximum_likelihood="none"))


def plant_effect(effect: str, component: str, value: float, *, vehicle: str = VEHICLE, seed: int = 1) -> Flight:
    """A short flight with nothing planted, whose record then has `value` (SI) of that component of the effect more.

    Raises UsageError where there is no such effect or component.
    """
    item = find_installed(effect)
    if not isinstance(item, RecordEffect):
        raise UsageError(f"'{effect}' is a mechanism, not an effect on the record: use plant().")
    flight = _unplanted(vehicle, seed)
    variant = item.variants(flight)[0]
    known = [each.name for each in variant.components(flight)]
    if component not in known:
        raise UsageError(f"'{effect}' has no component '{component}'; it has {', '.join(known)}.")
    return variant.perturb(flight, component, value)


def recover_effect(flight: Flight, effect: str, *rivals: str) -> Trace:
    """The trace of a flight that tries an effect and the rivals alone, and discovers nothing of its own."""
    settings = TraceConfig(effects=(effect, *rivals), discover=False, max_steps=2)
    return trace(flight, settings)


@lru_cache(maxsize=4)
def _unplanted(vehicle: str, seed: int) -> Flight:
    return simulate({"base": vehicle, **_short(vehicle), "mechanisms": []}, seed=seed).flight


def _fitted(mechanism: Mechanism, vehicle: str) -> HypothesisFit:
    theta = {parameter.name: parameter.grid[0] for parameter in mechanism.parameters()}
    terms = len(mechanism.terms(sample_motion(uniform_time(60)), theta))
    problem = replace(_problem(vehicle), max_terms=terms, exact_terms=terms)
    return fit_hypothesis(problem, mechanism.name, (mechanism,))


@lru_cache(maxsize=1)
def _problem(vehicle: str) -> Problem:
    """The least-squares problem of a flight with nothing planted."""
    return shared_problem([reconstruct(_unplanted(vehicle, 1))], CompareConfig(knot_count=2))[0]


def _short(vehicle: str) -> dict[str, float]:
    """Duration and rate for a test, never more than the vehicle's own."""
    own = load_config(vehicle)
    return {"duration": min(DURATION, own.duration), "sample_rate": min(SAMPLE_RATE, own.sample_rate)}
