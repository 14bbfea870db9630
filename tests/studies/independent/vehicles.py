"""Four vehicles and the start of a flight; SI, angles in rad."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from brv_hypo.flight.record import Vehicle


@dataclass(frozen=True)
class Craft:
    """A vehicle, its aerodynamics (CONVENTIONS) and the middle of its start conditions.

    `stiffness_drift`: relative change of the static slope by the relative change of speed. `static_bend`, `normal_bend`
    and `axial_bend`: relative changes of static moment over alpha, of normal force over alpha and of axial force from
    alpha = 0 to `alpha`, as its square.
    """

    name: str
    vehicle: Vehicle
    axial: float
    normal_slope: float
    static_slope: float
    damping: float
    roll_damping: float
    speed: float
    altitude: float
    flight_path: float
    alpha: float
    roll_rate: float
    duration: float
    sample_rate: float
    stiffness_drift: float = 0.3
    static_bend: float = 0.0
    normal_bend: float = 0.0
    axial_bend: float = 0.0

    def bent(self, bend: float, alpha: Any) -> Any:
        """1 at alpha = 0, 1 + `bend` at the craft's own alpha; of any shape."""
        return 1.0 + bend * (alpha / self.alpha) ** 2


CONE = Craft(
    "cone",
    Vehicle(350.0, 14.0, 140.0, 0.6, 0.2827, (0.12, 0.03, -0.02)),
    axial=0.08,
    normal_slope=1.9,
    static_slope=-0.088,
    damping=-1.0,
    roll_damping=-0.02,
    speed=7000.0,
    altitude=31000.0,
    flight_path=-0.15,
    alpha=np.radians(2.5),
    roll_rate=8.0,
    duration=5.4,
    sample_rate=200.0,
)
CAPSULE = Craft(
    "capsule",
    Vehicle(210.0, 48.0, 42.0, 1.5, 1.767, (-0.05, 0.1, 0.04)),
    axial=1.5,
    normal_slope=0.35,
    static_slope=-0.04,
    damping=-0.3,
    roll_damping=-0.01,
    speed=9000.0,
    altitude=66000.0,
    flight_path=-0.1,
    alpha=np.radians(4.0),
    roll_rate=1.6,
    duration=9.0,
    sample_rate=120.0,
)
SLENDER = Craft(
    "slender",
    Vehicle(180.0, 4.0, 160.0, 0.438, 0.15, (0.3, 0.0, 0.05)),
    axial=0.5,
    normal_slope=4.0,
    static_slope=-3.0,
    damping=-60.0,
    roll_damping=-0.1,
    speed=1350.0,
    altitude=28000.0,
    flight_path=-0.4,
    alpha=np.radians(3.0),
    roll_rate=8.0,
    duration=7.2,
    sample_rate=150.0,
)
BICONIC = Craft(
    "biconic",
    Vehicle(12.0, 0.09, 0.55, 0.25, 0.0491, (0.03, -0.02, 0.02)),
    axial=0.12,
    normal_slope=1.7,
    static_slope=-0.06,
    damping=-0.5,
    roll_damping=-0.02,
    speed=5000.0,
    altitude=38000.0,
    flight_path=-0.2,
    alpha=np.radians(5.0),
    roll_rate=10.0,
    duration=5.4,
    sample_rate=200.0,
)
CRAFTS = {craft.name: craft for craft in (CONE, CAPSULE, SLENDER, BICONIC)}


@dataclass(frozen=True)
class Start:
    """How a flight begins: rates in rad/s, `coning` and `nutation` in shares of the natural frequency."""

    alpha: float
    meridian: float
    roll_rate: float
    roll_acceleration: float
    coning: float
    nutation: float


def draw_start(craft: Craft, rng: np.random.Generator) -> Start:
    return Start(
        alpha=craft.alpha * rng.uniform(0.6, 1.5),
        meridian=rng.uniform(-np.pi, np.pi),
        roll_rate=craft.roll_rate * rng.uniform(0.7, 1.4),
        roll_acceleration=0.02 * craft.roll_rate * rng.standard_normal(),
        coning=rng.uniform(-0.9, 0.9),
        nutation=rng.uniform(-0.5, 0.5),
    )
