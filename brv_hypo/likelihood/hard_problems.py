"""Model problems that mislead a fit: a model without the stall that was flown, inputs held between samples, gaps,
motion too fast for its samples.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.problems import ModelProblem, short_period
from brv_hypo.likelihood.segment import Segment

_MASS, _AREA, _CHORD, _INERTIA = 7500.0, 28.0, 2.3, 40000.0
"""kg, m2, m, kg m2: a small business jet."""
_DENSITY, _GRAVITY, _THRUST = 0.6, 9.81, 9000.0
"""kg/m3, m/s2, N."""
_SPEED = 120.0
"""About which lift, drag and moment change with speed, m/s."""
_STALL_ANGLE, _STALL_WIDTH = 0.17, 0.012
"""Angle of attack at which the flow separates, and over which, rad."""
_TRIM = -0.02
"""Elevator, rad."""
_FAST_SUBSTEPS = 64
"""Steps of the simulation between samples that are far apart."""

_AIRCRAFT = {
    "CL0": 0.12, "CLV": 0.1, "CLa": 5.3, "CD0": 0.03, "CDV": -0.05, "CDa": 0.1,
    "Cm0": 0.06, "CmV": 0.0, "Cma": -0.6, "Cmq": -18.0, "Cmde": -1.1,
}  # fmt: skip
"""Derivatives of the aircraft below its stall."""


def stalled_aircraft(severity: float) -> tuple[ModelProblem, ModelProblem]:
    """Longitudinal motion of an aircraft flown into stall: as it was flown, and the model without a stall.

    4 states (speed, angle of attack, pitch angle, pitch rate), 7 outputs (those, pitch acceleration, longitudinal and
    normal specific force), 11 parameters. At `severity` 4 the stall takes most of the lift that its angle would add.
    The truth of the second is that below the stall; what fits the record best is something else.
    """
    noise = np.array([0.3, 0.002, 0.002, 0.002, 0.01, 0.05, 0.2])
    start = np.array([_SPEED, 0.08, 0.08, 0.0])

    def forces(x: Any, u: Any, theta: Any, stall: float) -> tuple[Any, Any, Any, Any]:
        speed, alpha, _, q = x
        change = speed / _SPEED - 1.0
        lift = theta["CL0"] + theta["CLV"] * change + theta["CLa"] * alpha
        drag = theta["CD0"] + theta["CDV"] * change + theta["CDa"] * alpha
        moment = theta["Cm0"] + theta["CmV"] * change + theta["Cma"] * alpha + theta["Cmde"] * u[0]
        moment = moment + theta["Cmq"] * q * _CHORD / (2.0 * speed)
        if stall:
            beyond = alpha - _STALL_ANGLE
            separated = 0.5 * stall * (1.0 + np.tanh(beyond / _STALL_WIDTH))
            lift = lift - separated * (3.0 * beyond + 0.1)
            drag = drag + separated * (0.8 * beyond + 0.05) + 1.2 * alpha * alpha
            moment = moment - separated * (0.5 * beyond + 0.04)
        return lift, drag, moment, 0.5 * _DENSITY * _AREA * speed * speed

    def problem(stall: float) -> ModelProblem:
        def dynamics(x: Any, u: Any, theta: Any, t: Any) -> Any:
            speed, alpha, pitch, q = x
            lift, drag, moment, push = forces(x, u, theta, stall)
            along = (-push * drag + _THRUST * np.cos(alpha)) / _MASS + _GRAVITY * np.sin(alpha - pitch)
            across = (-push * lift - _THRUST * np.sin(alpha)) / _MASS + _GRAVITY * np.cos(alpha - pitch)
            return np.array([along, across / speed + q, q, push * _CHORD * moment / _INERTIA])

        def outputs(x: Any, u: Any, theta: Any, t: Any) -> Any:
            _, alpha, _, _ = x
            lift, drag, moment, push = forces(x, u, theta, stall)
            forward = (push * (lift * np.sin(alpha) - drag * np.cos(alpha)) + _THRUST) / _MASS
            normal = -push * (lift * np.cos(alpha) + drag * np.sin(alpha)) / _MASS
            return np.array([*x, push * _CHORD * moment / _INERTIA, forward, normal])

        return ModelProblem(dynamics, outputs, _AIRCRAFT, _pull_ups, start, noise, rate=20.0, guess=start)

    return problem(severity), problem(0.0)


def held_short_period() -> ModelProblem:
    """The short period under a digital controller, whose elevator steps at the samples, 25 a second."""
    smooth = short_period()

    def stepped(t: FloatArray) -> FloatArray:
        sample = np.floor(np.asarray(t) * smooth.rate + 1e-6)
        return np.asarray(0.06 * np.sign(np.sin(0.37 * sample)) * np.cos(0.05 * sample))[None]

    return replace(smooth, inputs=stepped, hold="zero")


def oscillator(frequency: float) -> ModelProblem:
    """A damped oscillator, rad/s, its angle measured at 20 Hz: fast for its samples beyond about 10 rad/s."""

    def dynamics(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return np.array([x[1], -theta["stiffness"] * x[0] - theta["damping"] * x[1]])

    def outputs(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return x[:1]

    truth = {"stiffness": frequency**2, "damping": 0.3}
    return ModelProblem(
        dynamics,
        outputs,
        truth,
        _nothing,
        np.array([1.0, 0.0]),
        np.array([0.01]),
        rate=20.0,
        guess=np.array([1.0, 0.0]),
        substeps=_FAST_SUBSTEPS,
    )


def kinetics(speed: float) -> ModelProblem:
    """A reaction whose first steps are `speed` times as fast as its last, all states measured at 20 Hz."""

    def dynamics(x: Any, u: Any, theta: Any, t: Any) -> Any:
        forward, back = theta["k1"] * x[0], theta["k3"] * x[1] * x[2]
        return np.array([back - forward, forward - back - theta["k2"] * x[1], theta["k2"] * x[1]])

    def outputs(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return x

    truth = {"k1": speed, "k2": 1.0, "k3": 2.0 * speed}
    start = np.array([1.0, 0.0, 0.0])
    return ModelProblem(
        dynamics,
        outputs,
        truth,
        _nothing,
        start,
        np.full(3, 0.005),
        rate=20.0,
        guess=start,
        substeps=_FAST_SUBSTEPS,
    )


def with_gap(segment: Segment, first: float, seconds: float) -> Segment:
    """Nothing measured for so long, from a fraction of the record on."""
    t = np.asarray(segment.t)
    start = t[0] + first * (t[-1] - t[0])
    return replace(segment, y=np.where((t >= start) & (t < start + seconds), np.nan, segment.y))


def thinned(segment: Segment, share: float, rng: np.random.Generator) -> Segment:
    """That share of the samples, drawn anew, not measured."""
    y = np.array(segment.y)
    y[:, rng.random(y.shape[1]) < share] = np.nan
    return replace(segment, y=y)


def scattered(truth: Mapping[str, float], spread: float, rng: np.random.Generator) -> dict[str, float]:
    """Start values up to that fraction off the truth, either way."""
    return {name: value * (1.0 + spread * rng.uniform(-1.0, 1.0)) for name, value in truth.items()}


def _pull_ups(t: FloatArray) -> FloatArray:
    """Elevator, (1, n): two pull-ups into the stall, their recoveries, and a small motion after."""
    steps = ((2.0, 5.0, -0.12), (5.0, 7.0, 0.05), (12.0, 15.5, -0.14), (15.5, 18.0, 0.04))
    moved = sum(size * ((t > start) & (t < stop)) for start, stop, size in steps)
    return np.asarray(_TRIM + 1.2 * (moved - 0.03 * np.sin(1.1 * t) * (t > 18.0)))[None]


def _nothing(t: FloatArray) -> FloatArray:
    return np.zeros((0, np.size(t)))
