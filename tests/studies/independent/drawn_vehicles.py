"""Vehicles that no one has designed: everything about them is drawn, from a slender cone to a blunt capsule.

What is kept within bounds is what makes a record fit to be analysed at all: statically stable, some oscillations long,
sampled well above them, at a dynamic pressure that changes less than fivefold. The moments and forces bend with alpha.
"""

from __future__ import annotations

import math

import numpy as np

from brv_hypo.flight.record import Vehicle
from tests.studies.independent.air import atmosphere
from tests.studies.independent.vehicles import Craft

FEWEST_CYCLES = 5.0  # of the oscillation
LONGEST = 25.0  # s: a fall of more than 3 km besides the dive
SCALE_HEIGHT = 7000.0  # m, over which the air grows e times as dense
LARGEST_CHANGE = 1.5  # e-folds of density over the record
BENT = math.radians(12.0)  # angle of attack at which moments and forces have bent by the shares drawn
LARGEST_DECAY = 1.5  # e-folds of the oscillation that its own damping takes


def draw_craft(rng: np.random.Generator) -> Craft:
    """A vehicle, its aerodynamics and its flight."""
    while True:
        craft, cycles = _drawn(rng)
        if cycles >= FEWEST_CYCLES:
            return craft


def _drawn(rng: np.random.Generator) -> tuple[Craft, float]:
    """Any vehicle, and the cycles of its oscillation."""

    def between(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    diameter = between(0.2, 3.0)
    area = 0.25 * math.pi * diameter**2
    mass = between(60.0, 1500.0) * area
    slender = rng.uniform()  # 0 a blunt capsule, 1 a slender rocket
    iyy = mass * diameter**2 * 0.06 * 60.0**slender
    normal_slope = 0.3 + 2.7 * slender
    static_slope = -normal_slope * between(0.03, 0.2) * (1.0 + 3.0 * slender)
    speed = between(1200.0, 10000.0)
    altitude = _altitude_of(between(800.0, 60000.0), speed)
    pressure = 0.5 * atmosphere(altitude)[0] * speed**2
    frequency = math.sqrt(pressure * area * diameter * abs(static_slope) / iyy)
    duration = min(between(6.0, 20.0) * 2.0 * math.pi / frequency, LONGEST)
    dive = min(0.5, LARGEST_CHANGE * SCALE_HEIGHT / (speed * duration))
    spin = between(0.2, 3.0) * frequency
    decay = pressure * area * diameter**2 / (4.0 * speed * iyy) * duration
    fastest = max(spin, frequency) + frequency
    alpha = math.radians(between(1.0, 12.0))
    bent = (alpha / BENT) ** 2
    offset = diameter * rng.uniform(-0.2, 0.2, 3)
    craft = Craft(
        "drawn",
        Vehicle(mass, iyy * (1.1 - 1.05 * slender**0.5), iyy, diameter, area, tuple(offset.tolist())),
        axial=1.5 - 1.4 * slender,
        normal_slope=normal_slope,
        static_slope=static_slope,
        damping=-min(between(0.1, 2.0) * (1.0 + 30.0 * slender), LARGEST_DECAY / decay),
        roll_damping=-0.02,
        speed=speed,
        altitude=altitude,
        flight_path=-dive * rng.uniform(0.2, 1.0),
        alpha=alpha,
        roll_rate=spin,
        duration=duration,
        sample_rate=between(20.0, 80.0) * fastest / (2.0 * math.pi),
        stiffness_drift=rng.uniform(-0.5, 0.5),
        static_bend=bent * rng.uniform(-0.3, 0.6),
        normal_bend=bent * rng.uniform(-0.3, 0.6),
        axial_bend=bent * rng.uniform(-0.1, 0.1),
    )
    return craft, frequency * duration / (2.0 * math.pi)


def _altitude_of(pressure: float, speed: float) -> float:
    """Altitude (m) of a dynamic pressure (Pa) at a speed (m/s): density falls all the way up."""
    low, high = 0.0, 84000.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        denser = 0.5 * atmosphere(middle)[0] * speed**2 > pressure
        low, high = (middle, high) if denser else (low, middle)
    return low
