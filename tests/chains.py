"""Traces and comparisons that many tests share: each is made once, of one settings, and never changed."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.comparison import CompareConfig, Comparison, compare
from brv_hypo.comparison.judgement import Judged, searched
from brv_hypo.comparison.preparation import shared_problem
from brv_hypo.comparison.result import MotionHistories
from brv_hypo.inference.problem import Problem
from brv_hypo.mechanisms import find
from brv_hypo.motion import Reconstruction, reconstruct
from brv_hypo.simulation import SimulatedFlight, SimulationConfig, load_config, simulate
from brv_hypo.tracing import Trace, TraceConfig, trace
from tests.flights import SAMPLE_RATE_HZ, STEP_S, flown, nominal

# Well beyond what tactical tolerances allow: 0.5 mm of c.g. offset make 7e-5.
TRIM = (1e-3, -5e-4)
ONE_EFFECT = TraceConfig(effects=("trim",), discover=False, max_steps=1)
"""One turn of the loop, for what does not depend on what there is to find."""


def trimmed_cone(trim: tuple[float, float]) -> SimulationConfig:
    """The research cone with a trim (C_m0, C_n0)."""
    terms = dict(zip(("C_m0", "C_n0"), trim, strict=True))
    data = load_config("research_cone").model_dump() | {"sample_rate": SAMPLE_RATE_HZ, "step": STEP_S}
    data["mechanisms"] = ({"mechanism": "trim", "terms": terms, "kind": "constant"},)
    return SimulationConfig.model_validate(data)


@cache
def trimmed() -> SimulatedFlight:
    """A flight with `TRIM`."""
    return simulate(trimmed_cone(TRIM), seed=3)


@cache
def traced_trim() -> Trace:
    """The trace that adds the trim of `trimmed`."""
    return trace(trimmed().flight, ONE_EFFECT)


@cache
def reconstructed(*plant: str) -> Reconstruction:
    """The motion of the research cone's flight with that planted."""
    return reconstruct(flown("research_cone", *plant).flight)


@cache
def prepared(*plant: str, **settings: int) -> Problem:
    """Its least-squares problem, with those settings of a comparison.

    How many terms a model may have is a limit of the problem alone: one is made for all such limits.
    """
    limits = {name: settings[name] for name in ("max_terms", "exact_terms") if name in settings}
    if not limits:
        return shared_problem([reconstructed(*plant)], CompareConfig(**settings))[0]
    return replace(prepared(*plant, **{name: settings[name] for name in settings if name not in limits}), **limits)


@cache
def compared_sticking() -> Comparison:
    """Three seconds with planted sticking, which is named."""
    planted = {"mechanism": "sticking", "theta": {"delay": 0.12}, "terms": {"eps": 0.6}, "start": 1.0, "stop": 2.5}
    short = {"base": "research_cone", "duration": 3.0, "sample_rate": 100.0, "mechanisms": [planted]}
    return compare(simulate(short, seed=4), CompareConfig(mechanisms=("sticking",), maximum_likelihood="none"))


@cache
def compared_nominal() -> Comparison:
    """A flight on which nothing is to be found, with `damping` alone, few knots, and likelihood."""
    return compare([nominal().flight], CompareConfig(mechanisms=("damping",), knot_count=5))


@cache
def judged_cone(*plant: str) -> Judged:
    """The research cone with that planted, and the planted mechanisms and `damping` judged beside processes."""
    names = tuple(dict.fromkeys(["none", *plant, "damping"]))
    hypotheses = {name: () if name == "none" else (find(name),) for name in names}
    return searched([reconstructed(*plant)], CompareConfig(mechanisms=names[1:]), hypotheses, lambda _: None).judged()


def histories(time: FloatArray, alpha: FloatArray, meridian: FloatArray, sigma: float = 0.01) -> MotionHistories:
    """Those of a flight without roll, with this angle of attack and windward meridian (n,) rad, known to `sigma`."""
    zero, known = np.zeros(time.size), np.full(time.size, sigma)
    return MotionHistories(
        time_s=time,
        alpha_rad=alpha,
        windward_meridian_rad=meridian,
        alpha_sigma_rad=known,
        windward_meridian_sigma_rad=known,
        roll_rate_rad_s=zero,
        windward_meridian_rate_rad_s=zero,
        mach=zero + 5.0,
        dynamic_pressure_pa=zero + 1e3,
    )
