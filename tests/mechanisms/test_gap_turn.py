"""What a gap hides, as an error of the record: what it does to attitude and velocity, and to a comparison."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from brv_hypo import compare
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.conformance import sample_flight
from brv_hypo.motion import ReconstructionConfig
from brv_hypo.motion.inertial import InertialRecord, inertial_record
from plugins.brv_hypo_effects.record import GapTurn
from tests.studies.independent.flights import make_flight
from tests.studies.independent.imperfect_study import with_gap

LOST = slice(150, 162)
EARLIER = LOST.start - 4  # samples before any that integrals across the gap's ends use
EFFECT = GapTurn()


def with_a_gap() -> Flight:
    flight = sample_flight()
    return replace(flight, segments=((0, LOST.start), (LOST.stop, flight.samples)))


def record(flight: Flight) -> InertialRecord:
    return inertial_record(flight, ReconstructionConfig())


def turn_between(one: InertialRecord, other: InertialRecord, sample: int) -> np.ndarray:
    """The rotation vector (3,) of small angles, in axes that do not roll, from one record's attitude to another's."""
    small = one.attitude[sample].T @ other.attitude[sample]
    vector = np.array([small[2, 1], small[0, 2], small[1, 0]])
    across = (vector[1] + 1j * vector[2]) * np.exp(1j * (one.roll[sample] - one.roll[LOST.start - 1]))
    return np.array([vector[0], across.real, across.imag])


@pytest.mark.parametrize(("axis", "place"), [("x", 0), ("y", 1), ("z", 2)])
def test_the_attitude_after_the_gap_is_turned_by_that_much(axis: str, place: int) -> None:
    flight = with_a_gap()
    before, after = record(flight), record(EFFECT.perturb(flight, f"{axis} 1", 1e-4))
    np.testing.assert_allclose(after.attitude[:EARLIER], before.attitude[:EARLIER], atol=1e-8)
    turned = turn_between(before, after, LOST.stop + 1)
    np.testing.assert_allclose(turned, 1e-4 * np.eye(3)[place], atol=4e-6)


@pytest.mark.parametrize("axis", ["vy", "vz"])
def test_the_velocity_after_the_gap_is_changed_by_that_much(axis: str) -> None:
    flight = with_a_gap()
    before, after = record(flight), record(EFFECT.perturb(flight, f"{axis} 1", 0.5))
    gained = np.linalg.norm(after.force_impulse - before.force_impulse, axis=1)
    np.testing.assert_allclose(gained[:EARLIER], 0.0, atol=1e-4)
    np.testing.assert_allclose(gained[LOST.stop :], 0.5, rtol=0.02)


def test_a_record_without_gaps_has_no_such_error() -> None:
    assert EFFECT.components(sample_flight()) == ()
    names = [each.name for each in EFFECT.components(with_a_gap())]
    assert names == ["x 1", "y 1", "z 1", "vy 1", "vz 1"]


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("truth", "vehicle", "seed"), [("inplane", "biconic", 7), pytest.param("none", "cone", 8, marks=pytest.mark.slow)]
)
def test_a_gap_of_half_a_cycle_hides_no_name(truth: str, vehicle: str, seed: int) -> None:
    """Without that error, processes of wind were a hundred times their ordinary size, and no name came about."""
    made = with_gap(make_flight(vehicle, truth, 0.8, seed, "tactical"), seed, 0.03)
    found = compare(made.flight, mechanisms=["lag", "inplane", "damping"], maximum_likelihood="none")
    assert len(made.flight.segments) == 2
    assert found.verdict.winner == truth
    assert found.verdict.adequacy is not None
    assert found.verdict.adequacy.ratio < 1.2
    assert not any(each.is_far for each in found.verdict.processes)
    turned = [each for each in found.record_errors if each.name.startswith("gap_turn")]
    assert turned
    assert all(abs(each.value) < 4.0 * each.tolerance for each in turned)
