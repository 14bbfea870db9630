"""From configurations, one per flight, to the equations of motion of a batch and its first state."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.simulation import rotation
from brv_hypo.simulation.config import AerodynamicsConfig, SimulationConfig
from brv_hypo.simulation.dynamics import ATTITUDE, RATES, STATES, VELOCITY, SlopeCourse, System
from brv_hypo.simulation.planting import planted
from brv_hypo.simulation.variation import per_flight
from brv_hypo.simulation.wind import WindStep


def system(configs: Sequence[SimulationConfig]) -> System:
    """The equations of motion of a batch; what is planted is looked up among the installed mechanisms."""
    first = configs[0]
    inertia = np.stack([_inertia(config) for config in configs], axis=-1).astype(float)
    names = [name for name in AerodynamicsConfig.model_fields if name != "slope_variations"]
    tabulated = first.environment.constant_density is None
    return System(
        mass=per_flight(configs, "vehicle", "mass"),
        inertia=inertia,
        inertia_inverse=np.moveaxis(np.linalg.inv(np.moveaxis(inertia, -1, 0)), 0, -1),
        reference_length=per_flight(configs, "vehicle", "reference_length"),
        reference_area=per_flight(configs, "vehicle", "reference_area"),
        coefficients={name: per_flight(configs, "aerodynamics", name) for name in names},
        slope_courses=tuple(
            _slope_course(configs, i) for i in range(len(first.aerodynamics.slope_variations))
        ),
        gravity=per_flight(configs, "environment", "gravity"),
        spherical=first.environment.planet_shape == "spherical",
        density=None if tabulated else per_flight(configs, "environment", "constant_density"),
        wind_step=None if first.environment.wind_step is None else _wind_step(configs),
        planted=(*planted(configs, "asymmetries"), *planted(configs, "mechanisms")),
    )


def initial_state(configs: Sequence[SimulationConfig], equations: System) -> FloatArray:
    """State (13, flights) at the start; alpha lies in the vertical plane of the track."""
    path = per_flight(configs, "start", "flight_path_angle")
    meridian = per_flight(configs, "start", "windward_meridian")
    along = np.array([np.cos(path), np.zeros_like(path), -np.sin(path)])
    transverse = np.array([_transverse_rate(config) for config in configs])
    state = np.zeros((STATES, len(configs)))
    state[2] = -per_flight(configs, "start", "altitude")
    state[VELOCITY] = per_flight(configs, "start", "velocity") * along
    state[VELOCITY] += equations.wind(per_flight(configs, "start", "time"))[0]
    state[ATTITUDE] = rotation.from_pitch_roll(path + per_flight(configs, "start", "alpha"), meridian)
    state[RATES] = np.array([per_flight(configs, "start", "roll_rate"), transverse.real, transverse.imag])
    return state


def _transverse_rate(config: SimulationConfig) -> complex:
    """q + i r: as given, or such that alpha and its plane turn as asked on a straight path."""
    start = config.start
    if start.q is not None and start.r is not None:
        return complex(start.q, start.r)
    turned = complex(start.alpha_rate, start.coning_rate * np.tan(start.alpha))
    return complex(turned * np.exp(-1j * start.windward_meridian))


def _inertia(config: SimulationConfig) -> FloatArray:
    body = config.vehicle
    return np.array(
        [
            [body.ixx, -body.ixy, -body.ixz],
            [-body.ixy, body.iyy, 0.0],
            [-body.ixz, 0.0, body.iyy],
        ]
    )


def _slope_course(configs: Sequence[SimulationConfig], index: int) -> SlopeCourse:
    first = configs[0].aerodynamics.slope_variations[index]
    change, at, width = (
        per_flight(configs, "aerodynamics", "slope_variations", index, name)
        for name in ("change", "at", "width")
    )
    return SlopeCourse(first.variable, first.kind, change, at, width)


def _wind_step(configs: Sequence[SimulationConfig]) -> WindStep:
    time = per_flight(configs, "environment", "wind_step", "time", missing=np.inf)
    velocity = [per_flight(configs, "environment", "wind_step", "velocity", i, missing=0.0) for i in range(3)]
    return WindStep(time, np.array(velocity))
