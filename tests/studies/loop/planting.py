"""Another flight of a vehicle, and how much of a planted effect a record shows beside its baseline."""

from __future__ import annotations

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.inference.problem import Problem
from brv_hypo.linearisation.linear import lengths
from brv_hypo.simulation.config import SimulationConfig

# A coefficient is detected at this many of its standard errors in the whole regression.
DETECTED = 5.0
# Factors on roll rate and angle of attack of another flight.
_CHANGE = (0.8, 1.25)


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


def free_length(problem: Problem, column: FloatArray) -> float:
    """Length of a whitened column beyond what the baseline explains."""
    return float(np.linalg.norm(free_part(problem, column)))


def free_part(problem: Problem, column: FloatArray) -> FloatArray:
    """A whitened column (rows,) less what the baseline explains of it."""
    design = problem.design(problem.frame, problem.baseline)
    basis = np.linalg.qr(design / lengths(design))[0]
    return np.asarray(column - basis @ (basis.T @ column), dtype=float)
