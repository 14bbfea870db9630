"""Undeclared effects for the loop's study: each at 3 to 10 times its detection limit on its own flight."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.mechanisms.registry import find, record_effects
from brv_hypo.mechanisms.yaml_mechanism import Factor, MechanismFile, Turn, YamlTerm, mechanism_text
from brv_hypo.model.term import Regressor, TimeBasis
from brv_hypo.regression.linear import lengths
from brv_hypo.regression.problem import Problem, given_column
from brv_hypo.residuals.baseline import is_bend, start_model, starting_columns, with_priors, without_bend
from brv_hypo.residuals.candidates_at_step import Look, look
from brv_hypo.residuals.config import Baseline, TraceConfig
from brv_hypo.residuals.dictionary import WAVES
from brv_hypo.residuals.linearisation import see
from brv_hypo.residuals.problem import linearised_at
from brv_hypo.simulation import load_config, simulate
from brv_hypo.simulation.config import SimulationConfig

MECHANISMS = ("damping", "inplane", "bodyfixed", "lag", "sticking")
AERODYNAMIC = (
    "magnus",
    "cubic_stiffness",
    "stiffness_asymmetry",
    "trim",
    "dynamic_imbalance",
    "mach_stiffness",
    "reynolds_stiffness",
    "mach_damping",
    "reynolds_damping",
)
RECORD = ("gyro_bias", "gyro_scale", "accel_bias", "accel_scale", "accel_position", "time_skew", "wind_step")
UNNAMED = ("turning_moment", "third_harmonic", "mach_step")
EFFECTS = (*MECHANISMS, *AERODYNAMIC, *RECORD)
# What a baseline with a schedule of the stiffness holds already: it is looked for from constant coefficients.
SCHEDULED = ("mach_stiffness", "reynolds_stiffness")

# A coefficient is detected at this many of its standard errors in the whole regression.
DETECTED = 5.0
_TIMES = (3.0, 10.0)  # detection limits between which a planted effect's size is drawn
_MOST = 15.0  # tolerances that an instrument is planted to err by at most
# Factors on roll rate and angle of attack of another flight.
_CHANGE = (0.8, 1.25)


@dataclass(frozen=True)
class Case:
    """One flight of the study: what is planted, on which vehicle, from which seed."""

    effects: tuple[str, ...]
    vehicle: str
    seed: int

    @property
    def key(self) -> str:
        """Its name in the results file."""
        return f"{'+'.join(self.effects) or 'none'}/{self.vehicle}/{self.seed}"

    @property
    def baseline(self) -> Baseline:
        """Where a trace of it starts from."""
        return "constant" if set(self.effects) & set(SCHEDULED) else "scheduled"


@dataclass(frozen=True)
class Size:
    """How large an effect is planted, in words and in detection limits.

    Fewer than were drawn where an instrument or a vehicle has no more.
    """

    words: str
    times: float


def planted(case: Case) -> tuple[SimulationConfig, tuple[Size, ...]]:
    """The configuration of a case, its effects at 3 to 10 times their detection limits, and their sizes."""
    draw = np.random.default_rng([case.seed, *(ord(letter) for letter in case.key)])
    config = load_config(case.vehicle)
    data = config.model_dump()
    data["start"]["windward_meridian"] = float(draw.uniform(0.0, 2.0 * np.pi))
    clean = SimulationConfig.model_validate(data)
    if not case.effects:
        return clean, ()
    here = _clean_look(clean, case)
    sizes = []
    for effect in case.effects:
        times = float(np.exp(draw.uniform(*np.log(_TIMES))))
        sizes.append(_plant(data, effect, here, times, draw))
    return SimulationConfig.model_validate(data), tuple(sizes)


def another_flight(config: SimulationConfig, seed: int) -> SimulationConfig:
    """The same vehicle with the same effects, started from another attitude and at another roll rate."""
    draw = np.random.default_rng([seed, *(ord(letter) for letter in "another flight")])
    start = config.start
    changed = {
        "windward_meridian": float(draw.uniform(0.0, 2.0 * np.pi)),
        "roll_rate": start.roll_rate * float(draw.uniform(*_CHANGE)),
        "alpha": start.alpha * float(draw.uniform(*_CHANGE)),
    }
    return config.model_copy(update={"start": start.model_copy(update=changed)})


def _clean_look(config: SimulationConfig, case: Case) -> Look:
    """The regression of the same flight with nothing planted: it tells how well a coefficient can be known.

    Where a bend of the static moment is planted, it is asked for as the loop asks: of a model without one.
    """
    flight = simulate(config, seed=case.seed + 10_000).flight
    settings = TraceConfig(discover=False, baseline=case.baseline)
    model = start_model((flight,), (), case.baseline)
    seen = see((flight,), model, settings)
    model = replace(model, columns=starting_columns(model, seen.frame))
    model = with_priors(model, seen)
    if any(is_bend(find(effect), seen.frame.motions[0]) for effect in case.effects if effect in AERODYNAMIC):
        model = without_bend(model)
    linear = linearised_at(seen, model, seen.values(seen.fitted, model.columns))
    return look(seen, model, linear, (), record_effects(), settings)


def _plant(data: dict[str, Any], effect: str, here: Look, times: float, draw: np.random.Generator) -> Size:
    """Plant an effect in the configuration's data; its size."""
    if effect in MECHANISMS:
        entries = [dict(entry) for entry in data["plantable"][effect]]
        limit = _limit_of(here, [_planted_columns(entry) for entry in entries])
        scale = min(times * limit, 1.0)
        for entry in entries:
            entry["terms"] = {name: float(value) * scale for name, value in entry["terms"].items()}
        data["mechanisms"] = (*data["mechanisms"], *entries)
        return Size(f"{effect} x {scale:.3g}", scale / limit)
    if effect in RECORD:
        return _plant_record(data, effect, here, times, draw)
    entry = _aerodynamic(effect, draw, here)
    scale = times * _limit_of(here, [_planted_columns(entry)])
    entry["terms"] = {name: float(value) * scale for name, value in entry["terms"].items()}
    if effect == "dynamic_imbalance":
        area = data["vehicle"]["reference_area"] * data["vehicle"]["reference_length"]
        data["vehicle"]["ixz"] = -entry["terms"]["-I_xz/(S d)"] * area
        data["vehicle"]["ixy"] = entry["terms"]["I_xy/(S d)"] * area
    else:
        data["mechanisms"] = (*data["mechanisms"], entry)
    return Size(f"{effect} {entry['terms']}", times)


def _aerodynamic(effect: str, draw: np.random.Generator, here: Look) -> dict[str, Any]:
    """An aerodynamic effect of unit size: one direction of its terms, at random; the first power of a
    course.
    """
    if effect in UNNAMED:
        return {"mechanism": _unnamed_file(effect, here), "terms": {"a": 1.0, "b": 0.7}, "kind": "constant"}
    mechanism = find(effect)
    names = [term.name for term in mechanism.terms(here.seen.reconstructions[0].motion, {})]
    if not mechanism.terms_enter_together:
        return {"mechanism": effect, "terms": {names[0]: float(draw.choice([-1.0, 1.0]))}, "kind": "constant"}
    angle = float(draw.uniform(0.0, 2.0 * np.pi))
    return {"mechanism": effect, "terms": {names[0]: np.cos(angle), names[1]: np.sin(angle)}, "kind": "constant"}


def _unnamed_file(effect: str, here: Look) -> str:
    """A mechanism file of an effect that no plugin describes; its path."""
    motion = here.seen.reconstructions[0].motion
    alpha = Factor(of="alpha")
    terms = {
        "turning_moment": (
            YamlTerm(name="a", axis="body_y", turn=Turn(of="time", rate=5.0)),
            YamlTerm(name="b", axis="body_z", turn=Turn(of="time", rate=5.0)),
        ),
        "third_harmonic": tuple(
            YamlTerm(name=name, axis="in_plane", factors=(Factor(of="windward_meridian", function=wave, rate=3.0),))
            for name, wave in zip(("a", "b"), WAVES, strict=True)
        ),
        "mach_step": tuple(
            YamlTerm(
                name=name,
                axis="in_plane",
                units="1/rad",
                factors=(alpha, Factor(of="mach", function="step", at=float(np.quantile(motion.mach, at)))),
            )
            for name, at in (("a", 0.5), ("b", 1.0))
        ),
    }[effect]
    file = MechanismFile(name=effect, title=effect, claims=effect, source="the study", terms=terms)
    path = Path(tempfile.gettempdir()) / f"brv_hypo_study_{effect}.yaml"
    path.write_text(mechanism_text(file), encoding="utf-8")
    return str(path)


def _planted_columns(entry: Mapping[str, Any]) -> tuple[str, list[tuple[Regressor, float]]]:
    time_basis = TimeBasis(
        "constant" if entry.get("kind") == "constant" else "jump",
        -np.inf if entry.get("start") is None else entry["start"],
        np.inf if entry.get("stop") is None else entry["stop"],
    )
    theta = tuple(entry.get("theta", {}).items())
    name = find(entry["mechanism"]).name
    return entry["mechanism"], [
        (Regressor(name, term, theta, time_basis, "1"), float(value)) for term, value in entry["terms"].items()
    ]


def _limit_of(here: Look, entries: Sequence[tuple[str, list[tuple[Regressor, float]]]]) -> float:
    """Detection limit of a planted combination, as a multiple of it."""
    problem = here.problem
    total: FloatArray | None = None
    for source, columns in entries:
        frame = problem.frame.with_mechanisms([find(source)])
        weights = np.array([value for _, value in columns])
        own = problem.design(frame, [column for column, _ in columns]) @ weights
        total = own if total is None else total + own
    assert total is not None
    return DETECTED / free_length(problem, total)


def free_length(problem: Problem, column: FloatArray) -> float:
    """Length of a whitened column beyond what the baseline takes over."""
    return float(np.linalg.norm(free_part(problem, column)))


def free_part(problem: Problem, column: FloatArray) -> FloatArray:
    """A whitened column (rows,) less what the baseline takes over of it."""
    design = problem.design(problem.frame, problem.baseline)
    basis = np.linalg.qr(design / lengths(design))[0]
    return np.asarray(column - basis @ (basis.T @ column), dtype=float)


def _plant_record(data: dict[str, Any], effect: str, here: Look, times: float, draw: np.random.Generator) -> Size:
    """Plant an error of one component of an instrument, or a step of the wind."""
    limits = {}
    for name, (_, planted) in here.components.items():
        if name.split(" ")[0] == effect:
            column = here.problem.design(here.problem.frame, [given_column(name)])[:, 0]
            limits[name] = (planted.name, DETECTED / max(free_length(here.problem, column), 1e-12))
    flight = here.seen.flights[0]
    sizes = {c.name: c.size for e in record_effects() if e.name == effect for c in e.components(flight)}
    fit = [name for name, (component, limit) in limits.items() if times * limit < _MOST * sizes[component]]
    name = str(draw.choice(fit or [min(limits, key=lambda n: limits[n][1] / sizes[limits[n][0]])]))
    component, limit = limits[name]
    size = min(times * limit, _MOST * sizes[component])
    value = float(size * draw.choice([-1.0, 1.0]))
    if effect == "wind_step":
        at = float(draw.uniform(0.25, 0.7) * data["duration"])
        across = value * np.array([0.0, np.cos(draw.uniform(0.0, 6.3)), np.sin(draw.uniform(0.0, 6.3))])
        data["environment"]["wind_step"] = {"time": at, "velocity": tuple(across.tolist())}
    else:
        data["instruments"]["errors"].setdefault(effect, {})[component] = value
    return Size(f"{effect} {component} {value:.3g}", size / limit)
