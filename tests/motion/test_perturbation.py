"""Errors of a record that are corrected together, in any order and axes."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from brv_hypo.flight.record import CHANNELS, Flight, Vehicle
from brv_hypo.mechanisms.registry import nuisance_effects, perturbations, without
from brv_hypo.motion.responses import superposed
from tests.flights import nominal
from tests.harness.invariance.changes import rolled

FLIGHT = nominal().flight
EVERY = [each.apply(FLIGHT, each.size) for each in perturbations(FLIGHT)]


def _numbers(flight: Flight) -> np.ndarray:
    wind = np.zeros((flight.samples, 3)) if flight.wind is None else flight.wind
    vehicle = [np.ravel(getattr(flight.vehicle, field.name)) for field in fields(Vehicle)]
    return np.concatenate([*(getattr(flight, name) for name in CHANNELS), wind.ravel(), *vehicle])


@given(order=st.permutations(range(len(EVERY))))
def test_the_order_of_changes_is_nothing(order: list[int]) -> None:
    one, other = superposed(FLIGHT, EVERY), superposed(FLIGHT, [EVERY[k] for k in order])
    np.testing.assert_allclose(_numbers(one), _numbers(other), rtol=1e-12, atol=1e-12)


def test_each_change_is_there_once() -> None:
    together = _numbers(superposed(FLIGHT, EVERY)) - _numbers(FLIGHT)
    one_by_one = sum(_numbers(each) - _numbers(FLIGHT) for each in EVERY)
    np.testing.assert_allclose(together, one_by_one, rtol=1e-9, atol=1e-9)


def test_a_variant_that_is_the_flight_changes_nothing() -> None:
    assert superposed(FLIGHT, [FLIGHT, replace(FLIGHT)]) == FLIGHT


@pytest.mark.parametrize("effect", [effect.name for effect in nuisance_effects() if effect.kind == "instrument"])
def test_one_error_is_removed_by_its_effect_with_the_opposite_sign(effect: str) -> None:
    for each in perturbations(FLIGHT):
        if each.effect == effect:
            found = without(FLIGHT, {(each.effect, each.component): 3.0 * each.size})
            assert _numbers(found) == pytest.approx(_numbers(each.apply(FLIGHT, -3.0 * each.size)), rel=1e-14)


@given(st.lists(st.floats(-20.0, 20.0), min_size=9, max_size=9), st.floats(-3.0, 3.0))
def test_gyro_errors_of_many_tolerances_turn_with_the_axes(sigmas: list[float], angle: float) -> None:
    # A matrix M of scales, rotations and shears is corrected as (1 - M) w, so in axes that are rolled by R as
    # (1 - R M R') R w. One error after the other would leave products of theirs, which are of no such matrix.
    matrix = 5e-4 * np.reshape(sigmas, (3, 3))
    turn = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(angle), np.sin(angle)], [0.0, -np.sin(angle), np.cos(angle)]])
    here = rolled(without(FLIGHT, _as_errors(matrix)), angle)
    there = without(rolled(FLIGHT, angle), _as_errors(turn @ matrix @ turn.T))
    for name in ("p", "q", "r"):
        np.testing.assert_allclose(getattr(here, name), getattr(there, name), rtol=0.0, atol=1e-11)


def _as_errors(matrix: np.ndarray) -> dict[tuple[str, str], float]:
    """What the effects call a matrix that readings (p, q, r) have of the rates too much."""
    scale = {("gyro_scale", name): matrix[k, k] for k, name in enumerate("pqr")}
    odd, even = 0.5 * (matrix - matrix.T), 0.5 * (matrix + matrix.T)
    # A rotation m makes a reading gain omega x m.
    rotation = {"x": odd[1, 2], "y": odd[2, 0], "z": odd[0, 1]}
    shear = {"yz": even[1, 2], "xz": even[0, 2], "xy": even[0, 1]}
    return scale | {("gyro_misalignment", name): value for name, value in (rotation | shear).items()}
