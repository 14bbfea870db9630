"""Accelerometers that are not where the record states: found from the motion, and where they are."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from brv_hypo.flight.record import Flight
from brv_hypo.model.reconstruction import reconstruct
from tests.studies.independent.flights import make_flight
from tests.studies.independent.imperfect_study import drawn_flight

SAID = "the accelerometers are stated at"


@cache
def flown(seed: int) -> Flight:
    """A cone, or for a large seed a drawn vehicle, each with errors drawn at their tolerances."""
    if seed < 1000:
        return make_flight("cone", "bodyfixed", seed=seed, duration=4.0).flight
    made, _, _ = drawn_flight(seed, seed % 26, "tactical", "one", drawn=True)
    return made.flight


def implied(flight: Flight) -> tuple[float, ...]:
    """Where the accelerometers are by the warning, m; empty without one."""
    said = [text for text in reconstruct(flight).warnings if text.startswith(SAID)]
    assert len(said) < 2
    return tuple(float(each) for text in said for each in text.split("; at (")[1].split(")")[0].split(", "))


SEEDS = [11, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1331000, 1331005))]
TURNS_LITTLE = 1331000  # so that the place makes less than what tolerances allow


@pytest.mark.parametrize("seed", SEEDS)
def test_accelerometers_where_they_are_stated_are_not_doubted(seed: int) -> None:
    assert implied(flown(seed)) == ()


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("axis", ["y", "z"])
def test_a_wrong_place_is_found_with_the_true_one_where_the_vehicle_turns(seed: int, axis: str) -> None:
    """To a twentieth of the diameter across the axis; along it the normal force may make up for a place."""
    flight = flown(seed)
    place = np.array(flight.vehicle.accelerometer_position)
    stated = place.copy()
    stated["xyz".index(axis)] += 0.15 * flight.vehicle.reference_length
    wrong = replace(flight, vehicle=replace(flight.vehicle, accelerometer_position=tuple(stated.tolist())))
    found = implied(wrong)
    assert found or seed == TURNS_LITTLE
    if found:
        assert found[1:] == pytest.approx(place[1:].tolist(), abs=0.05 * flight.vehicle.reference_length)
