"""How well moments are integrated where alpha comes near zero: on the samples alone, and on the regression's nodes.

By hand: python -m tests.studies.independent.integrals --seed 126000 --flights 40

On true motions of drawn vehicles, a damping, a constant moment in the plane of alpha and a late one, each as large as
the whole moment: rms error of the integrated rates, in the gyros' noise, against samples 256 times as dense.
"""

from __future__ import annotations

import argparse
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.integrate import cumulative_simpson
from scipy.interpolate import CubicSpline

from brv_hypo.motion.interpolation import Quadrature, running_integral
from brv_hypo.motion.motion import angle_of_attack, angle_rates, crossflow, quadrature, windward_meridian
from tests.studies.independent.flights import Made
from tests.studies.independent.study import MIXED, drawn_flight

SHAPES = ("damping", "constant", "late")
LATE = 0.5  # of its size, that the crossflow moves meanwhile
DENSER = 256


def shapes(xi: np.ndarray, xi_rate: np.ndarray, delay: float) -> np.ndarray:
    """C_m + i C_n (n, shapes) of unit size."""
    alpha_rate, meridian_rate = angle_rates(xi, xi_rate)
    late = angle_of_attack(xi) * np.exp(1j * delay * meridian_rate)
    plane = np.column_stack([alpha_rate, np.ones(xi.size), late])
    return np.asarray(plane * np.exp(-1j * windward_meridian(xi))[:, np.newaxis])


def errors(made: Made) -> tuple[Quadrature, np.ndarray, np.ndarray]:
    """The nodes of a flight, and the errors (shapes,) on its samples alone and on the nodes."""
    flight, true = made.flight, made.true
    time, xi = flight.time, crossflow(true.alpha, true.meridian)
    motion: Any = SimpleNamespace(time=time, alpha=true.alpha, windward_meridian=true.meridian)
    nodes = quadrature(motion, flight.segments)
    spline = CubicSpline(time, xi)
    spin = (1.0 - flight.vehicle.inertia_ratio) * running_integral(time, flight.p)
    factor = np.exp(1j * spin) * flight.dynamic_pressure * flight.vehicle.moment_scale
    dense = np.linspace(time[0], time[-1], (time.size - 1) * DENSER + 1)
    delay = LATE * float(np.linalg.norm(xi) / np.linalg.norm(spline(time, 1)))
    integrand = CubicSpline(time, factor)(dense)[:, np.newaxis] * shapes(spline(dense), spline(dense, 1), delay)
    exact = np.asarray(cumulative_simpson(integrand, x=dense, axis=0, initial=0.0))[::DENSER]
    here = shapes(xi, spline(time, 1), delay)
    scale = np.sqrt(np.mean(np.abs(true.moment) ** 2) / np.mean(np.abs(here) ** 2, axis=0)) / true.noise.gyro
    alone = running_integral(time, factor[:, np.newaxis] * here)
    there = nodes.of(factor)[:, np.newaxis] * shapes(nodes.of(xi), nodes.of(spline(time, 1)), delay)
    finer = running_integral(nodes.time, there)[nodes.samples]
    return nodes, scale * np.std(alone - exact, axis=0), scale * np.std(finer - exact, axis=0)


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--flights", type=int, default=40)
    given = parser.parse_args()
    found = []
    for number in range(given.flights):
        try:
            made = drawn_flight(given.seed + number, number, MIXED, 1.0, 5, coloured=True, drawn=True)
        except (RuntimeError, ValueError) as error:
            print(f"{given.seed + number}: not flown: {error}")
            continue
        nodes, alone, finer = errors(made)
        size = made.flight.samples
        print(f"{made.seed}: {size} samples, {nodes.time.size - size} between; {alone.round(3)} -> {finer.round(3)}")
        if nodes.spread is not None:
            found.append((alone, finer))
    before, after = np.array(found).transpose(1, 2, 0)
    print(f"nodes between the samples on {len(found)} flights; errors in the gyros' noise, largest and median:")
    for name, one, other in zip(SHAPES, before, after, strict=True):
        print(f"{name}: {one.max():.3g}, {np.median(one):.3g} -> {other.max():.3g}, {np.median(other):.3g}")


if __name__ == "__main__":
    main()
