"""What is planted is what is tested: the same definitions, at the running state and on the record."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from brv_hypo.errors import UsageError
from brv_hypo.mechanisms import Mechanism, MomentProcess, find, mechanisms
from brv_hypo.mechanisms.registry import moment_processes
from brv_hypo.model.term import TimeBasis
from brv_hypo.motion.interpolation import time_splines
from brv_hypo.motion.motion import Motion, recorded
from brv_hypo.simulation import SimulationConfig, load_config, simulate
from brv_hypo.simulation.simulator import flown
from brv_hypo.simulation.vehicle import system
from tests.flights import SAMPLE_RATE_HZ, STEP_S
from tests.varied import varied

pytestmark = pytest.mark.thorough

CONE = load_config("research_cone").model_copy(update={"sample_rate": SAMPLE_RATE_HZ, "step": STEP_S})
PLANTED: dict[str, dict[str, Any]] = {
    "damping": {"mechanism": "damping", "options": {"form": "complete"}, "terms": {"C_damping": 40.0}, "start": 0.5},
    "inplane": {"mechanism": "inplane", "terms": {"C_m0": 1e-4, "C_malpha": 0.01}, "kind": "ramp", "start": 0.3},
    "bodyfixed": {"mechanism": "bodyfixed", "terms": {"C_b cos(phi_b)": 2e-4, "C_b sin(phi_b)": 3e-4}},
    "lag": {"mechanism": "lag", "theta": {"delay": 0.02}, "terms": {"lag fraction": 0.7}, "start": 0.4, "stop": 1.1},
    "sticking": {
        "mechanism": "sticking",
        "options": {"form": "complete"},
        "theta": {"delay": 0.1},
        "terms": {"eps": 0.4},
    },
}

QUICK = "sticking"
"""What every run plants."""


def planting(*names: str, **changes: Any) -> SimulationConfig:
    data = CONE.model_dump(exclude={"plantable"})
    return load_config({**data, "mechanisms": [PLANTED[name] for name in names], "duration": 1.5, **changes})


@cache
def nominal() -> Motion:
    """A motion with nothing planted."""
    return true_motion(planting(duration=0.2))


def true_motion(config: SimulationConfig) -> Motion:
    """The motion that was flown, as a record would have it."""
    equations = system(config)
    trajectory = flown(equations)
    states = np.moveaxis(trajectory.states, 1, 0)
    time = trajectory.nodes[:, None]
    motion = equations.motion(time, states, equations.air_data(time, states), np.zeros_like(time), None)
    chosen = trajectory.samples
    values = {
        name: value[chosen, 0] if isinstance(value, np.ndarray) and value.ndim == 2 else value
        for name, value in vars(motion).items()
    }
    return recorded(
        Motion(
            **{
                **values,
                "windward_meridian": np.unwrap(values["windward_meridian"]),
                "reference_length": config.vehicle.reference_length,
            }
        )
    )


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name == QUICK else pytest.mark.slow) for name in PLANTED]
)
def test_planted_moment_is_the_mechanisms_own_definition(name: str) -> None:
    """Also before the first delay has passed: both pasts are steady before the start."""
    config = planting(name)
    truth = simulate(config, seed=1).truth
    motion = true_motion(config)
    entry = config.mechanisms[0]
    mechanism = find(entry.mechanism, entry.options)
    time_basis = TimeBasis(
        entry.kind, -np.inf if entry.start is None else entry.start, np.inf if entry.stop is None else entry.stop
    )(motion.time)
    terms = {term.name: term for term in mechanism.terms(motion, entry.theta)}
    in_plane = sum(value * time_basis * terms[key].in_plane for key, value in entry.terms.items())
    out_of_plane = sum(value * time_basis * terms[key].out_of_plane for key, value in entry.terms.items())
    size = np.sqrt(np.mean(truth.planted_in_plane**2 + truth.planted_out_of_plane**2))
    assert size > 1e-5
    # One sample beside an edge may lie on its other side by rounding.
    away = np.min(np.abs(motion.time[:, None] - [entry.start or -9.0, entry.stop or -9.0]), axis=1) > 1e-6
    np.testing.assert_allclose(truth.planted_in_plane[away], in_plane[away], atol=1e-3 * size)
    np.testing.assert_allclose(truth.planted_out_of_plane[away], out_of_plane[away], atol=1e-3 * size)


@pytest.mark.parametrize("mechanism", mechanisms("aerodynamic"), ids=lambda mechanism: mechanism.name)
def test_any_installed_effect_can_be_planted(mechanism: Mechanism) -> None:
    """Each term in turn, scaled to a tenth of the moment: what is planted is the mechanism's own column."""
    theta = {parameter.name: parameter.grid[0] for parameter in mechanism.parameters()}
    for term in mechanism.terms(nominal(), theta):
        column = np.max(np.hypot(term.in_plane, term.out_of_plane))
        coefficient = float(2e-4 / column)
        entry = {"mechanism": mechanism.name, "theta": theta, "terms": {term.name: coefficient}}
        data = planting(duration=0.2).model_dump(exclude={"plantable"})
        config = load_config({**data, "mechanisms": [entry]})
        truth, motion = simulate(config, seed=1).truth, true_motion(config)
        own = {found.name: found for found in mechanism.terms(motion, theta)}[term.name]
        np.testing.assert_allclose(truth.planted_in_plane, coefficient * own.in_plane, atol=1e-9)
        np.testing.assert_allclose(truth.planted_out_of_plane, coefficient * own.out_of_plane, atol=1e-9)


@pytest.mark.parametrize("process", moment_processes(), ids=lambda process: process.name)
def test_a_process_is_planted_with_its_splines_over_the_flight(process: MomentProcess) -> None:
    """A spline in the middle and the last: what is planted is the shape times them."""
    chosen = sorted({process.splines // 2, process.splines - 1})
    unit = float(np.max(np.abs(process.shapes(nominal())[0])))
    entry = {"mechanism": process.name, "terms": {f"{process.name} 0 {k}": 2e-4 / unit for k in chosen}}
    config = load_config({**planting(duration=0.3).model_dump(exclude={"plantable"}), "mechanisms": [entry]})
    truth, motion = simulate(config, seed=1).truth, true_motion(config)
    splines = time_splines(motion.time, motion.time[0], motion.time[-1], process.splines)
    expected = 2e-4 / unit * process.shapes(motion)[0] * splines[:, chosen].sum(axis=1)
    assert np.max(np.abs(expected)) > 5e-5
    np.testing.assert_allclose(truth.planted_in_plane + 1j * truth.planted_out_of_plane, expected, atol=1e-9)
    assert truth.planted == (process.name,)


def test_the_size_of_a_planted_process_and_its_span_can_be_set() -> None:
    entry = {"mechanism": "static_change", "terms": {"static_change 0 0": 0.0}, "options": {"start": 5.0, "stop": 6.0}}
    config = load_config({**planting(duration=0.2).model_dump(exclude={"plantable"}), "mechanisms": [entry]})
    path = "mechanisms.0.terms.static_change 0 0"
    none, some = (simulate(varied(config, {path: size}), seed=1) for size in (0.0, 0.01))
    assert np.max(np.abs(none.truth.planted_in_plane)) < 1e-15
    # Before its start the first spline is what it is there: a sixth.
    np.testing.assert_allclose(some.truth.planted_in_plane, 0.01 / 6.0 * some.truth.alpha, rtol=1e-6)


def test_wind_fixed_mechanisms_are_part_of_what_sticks() -> None:
    """C_mw of Eq. 5.1 holds the planted in-plane flow: the sticking moment grows with it."""
    alone = simulate(planting("sticking", duration=0.2), seed=1).truth
    stronger = dict(PLANTED["inplane"], kind="jump", start=None, terms={"C_malpha": -0.0883})
    config = load_config(
        {
            **planting("sticking", duration=0.2).model_dump(exclude={"plantable"}),
            "mechanisms": [PLANTED["sticking"], stronger],
        }
    )
    # At the first sample the motions agree and only C_mw differs: it is doubled.
    both = simulate(config, seed=1).truth
    assert both.planted_out_of_plane[0] == pytest.approx(2.0 * alone.planted_out_of_plane[0], rel=1e-9)


@pytest.mark.slow
def test_moments_add_up_over_several_mechanisms() -> None:
    truth = simulate(planting("bodyfixed", "sticking", "damping"), seed=1).truth
    assert truth.planted == ("bodyfixed", "sticking", "damping")
    body = (truth.C_N + 1j * truth.C_Z) * np.exp(-1j * truth.windward_meridian)
    np.testing.assert_allclose(body, truth.C_m + 1j * truth.C_n, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mechanism": "stickin"}, "did you mean sticking"),
        ({"terms": {"epsilon": 0.5}}, "its terms are eps"),
        ({"theta": {}}, r"expected \['delay'\]"),
        ({"options": {"form": "other"}}, "bad options"),
        ({"kind": "ramp", "start": None}, "a ramp needs a `start`"),
        ({"theta": {"delay": 0.001}}, "Reduce `step`"),
    ],
)
def test_refusals_say_what_to_write(change: dict[str, Any], message: str) -> None:
    data = planting("sticking").model_dump(exclude={"plantable"})
    with pytest.raises(UsageError, match=message):
        simulate(load_config({**data, "mechanisms": [PLANTED["sticking"] | change]}), seed=1)
