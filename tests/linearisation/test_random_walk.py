"""The walk of the attitude is the integral of the very noise that the rates show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from brv_hypo.linearisation.response import linearisation_point, walk_sines
from brv_hypo.motion import ReconstructionConfig
from brv_hypo.motion.inertial import NominalMotion
from brv_hypo.motion.responses import perturbed
from tests.chains import prepared, reconstructed


@pytest.mark.parametrize("order", [0, 1, 2])
def test_noise_of_the_gyros_makes_the_walk_of_its_unknown(order: int):
    """Noise of -i w in the rates across the velocity is read as a walk of w less, so that its correction is w."""
    record, point = linearisation_point(reconstructed(), ReconstructionConfig())
    nominal = NominalMotion(record, point.start)
    walk, noise = (each[:, order] for each in walk_sines(record, order + 1))
    noise = 1j * nominal.turn * noise
    (noisy,) = perturbed(
        record, [replace(record.flight, q=record.flight.q + noise.real, r=record.flight.r + noise.imag)]
    )
    shift = NominalMotion(noisy, point.start).crossflow - nominal.crossflow
    found = np.vdot(walk, shift * np.conj(nominal.turn)) / np.vdot(walk, walk)
    assert found == pytest.approx(-1.0, abs=0.1)


def test_the_noise_of_each_unknown_is_about_one_row_of_noise():
    problem = prepared(knot_count=3)
    rows = problem.rows
    (own,), (untied,) = rows.of_flights, problem.untied().rows.of_flights
    lengths = np.linalg.norm(own.own_noise, axis=0)
    assert np.all((lengths > 0.1) & (lengths < 1.3))  # the noise's level is found twice, its colour once
    assert rows.nuisances.flights[0].walks.size == own.own_noise.shape[1] > 0
    assert untied.own_noise.shape[1] == 0


@pytest.mark.thorough
def test_coefficients_with_the_measurement_model_are_known_better():
    """The same coefficients with a walk beside the noise are less certain."""
    problem = prepared(knot_count=3)
    frame, columns = problem.frame, problem.baseline
    smoothed, untied = (each.whole_design(frame, columns) for each in (problem, problem.untied()))
    place = [column.term for column in columns].index("C_malpha")

    def sigma(design: np.ndarray) -> float:
        return float(np.sqrt(np.linalg.pinv(design.T @ design)[place, place]))

    assert sigma(smoothed) < sigma(untied)
