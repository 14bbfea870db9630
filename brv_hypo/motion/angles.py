"""A motion's angles and rates from its crossflow, and back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.motion.frames import angle_of_attack, angle_rates, windward_meridian
from brv_hypo.motion.motion import Motion


def with_crossflow(motion: Motion, xi: ComplexArray, xi_rate: ComplexArray) -> Motion:
    """The motion with the angles of a crossflow (n,) and of its rate (n,) 1/s; the meridian in the nearest turn."""
    alpha_rate, meridian_rate = angle_rates(xi, xi_rate)
    return replace(
        motion,
        alpha=angle_of_attack(xi),
        windward_meridian=nearest_turn(windward_meridian(xi), motion.windward_meridian),
        alpha_rate=alpha_rate,
        windward_meridian_rate=meridian_rate,
    )


def crossflow_rate(motion: Motion, xi: ComplexArray) -> ComplexArray:
    """Rate of a motion's crossflow xi (n,) 1/s, from the rates of its angles."""
    growth = motion.alpha_rate * np.cos(motion.alpha) / np.maximum(np.sin(motion.alpha), 1e-9)
    return np.asarray(xi * (growth - 1j * motion.windward_meridian_rate), dtype=complex)


def nearest_turn(angle: FloatArray, reference: FloatArray) -> FloatArray:
    """`angle` moved by whole turns next to `reference`, sample by sample."""
    return np.asarray(angle + 2.0 * np.pi * np.round((reference - angle) / (2.0 * np.pi)), dtype=float)
