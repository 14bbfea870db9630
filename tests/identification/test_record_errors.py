"""Errors of the record as the equations know them, against the record effects themselves."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.identification.parameters import (
    ACCELEROMETERS,
    CROSSFLOW,
    GYROS,
    MOMENT_SCALE_ERROR,
    MOMENTS,
    PRESSURE_ERROR,
    RATIO_ERROR,
    ROLL_RATE_ERROR,
    RecordErrors,
    error_histories,
    lever_force,
    noise_free_flights,
    of_flight,
    record_errors,
)
from brv_hypo.motion.inputs import smooth_inputs


@pytest.fixture(scope="module")
def linearised(bodyfixed):
    """The noise-free flight, its inputs and its errors."""
    _, work, _ = bodyfixed
    frame = work.frame
    inputs = tuple(smooth_inputs(r) for r in frame.reconstructions)
    predicted, moments = (f(work.columns) @ work.values for f in (frame.columns, frame.moments))
    flights = noise_free_flights(frame, predicted, moments, inputs)
    return flights[0], inputs[0], record_errors(frame, flights, inputs, frozenset({"bodyfixed"}))[0]


def histories(errors: RecordErrors, name: str) -> tuple[float, dict[str, np.ndarray]]:
    return next((value.size, dict(rows)) for value, rows in errors.items() if value.name == name)


@pytest.mark.parametrize(
    ("name", "touched"),
    [
        ("gyro_bias q", {GYROS[0], *CROSSFLOW}),
        ("gyro_bias p", {ROLL_RATE_ERROR, *CROSSFLOW}),
        ("gyro_misalignment y", {GYROS[1], ROLL_RATE_ERROR, *CROSSFLOW}),
        ("accel_scale z", {ACCELEROMETERS[1]}),
        ("accel_position x", {*ACCELEROMETERS}),
        ("dynamic_pressure_scale scale", {PRESSURE_ERROR}),
        ("inertia_ratio ratio", {RATIO_ERROR}),
        ("inertia scale", {MOMENT_SCALE_ERROR}),
        ("wind y 2", {*CROSSFLOW}),
        ("trim C_m0", {*MOMENTS}),
    ],
)
def test_an_error_touches_what_it_should(linearised, name, touched):
    assert set(histories(linearised[2], name)[1]) == touched


def test_errors_without_effect_on_the_equations_are_left_out(linearised):
    names = {value.name for value in linearised[2]}
    assert not names & {"accel_bias x", "accel_scale x"}


def test_scale_and_misalignment_are_those_of_the_noise_free_rates(linearised):
    flight, _, errors = linearised
    size, scale = histories(errors, "gyro_scale r")
    np.testing.assert_allclose(scale[GYROS[1]], size * flight.r, rtol=1e-9)
    size, turned = histories(errors, "gyro_misalignment z")
    np.testing.assert_allclose(turned[GYROS[0]], -size * flight.p, rtol=1e-9)
    np.testing.assert_allclose(turned[ROLL_RATE_ERROR], size * flight.q, atol=1e-12)


def test_a_wrong_place_adds_what_the_accelerometers_sense_there(linearised):
    flight, _, errors = linearised
    size, place = histories(errors, "accel_position y")
    omega = flight.q + 1j * flight.r
    rate, rolling = np.gradient(omega, flight.step), np.gradient(flight.p, flight.step)
    expected = lever_force((0.0, size, 0.0), omega, rate, flight.p, rolling)[5:-5]
    found = (place[ACCELEROMETERS[0]] + 1j * place[ACCELEROMETERS[1]])[5:-5]
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())


def test_gravity_follows_an_attitude_computed_from_a_rate_that_is_too_large(linearised, bodyfixed):
    """A bias of the roll gyro e turns the computed axes by e t about the nose: gravity across it by i g e t."""
    flight, inputs, errors = linearised
    size, bias = histories(errors, "gyro_bias p")
    gravity = inputs.gravity_axes @ bodyfixed[1].frame.reconstructions[0].gravity_body
    expected = 1j * size * (flight.time - flight.time[0]) * (gravity[:, 1] + 1j * gravity[:, 2])
    found = bias[CROSSFLOW[0]] + 1j * bias[CROSSFLOW[1]]
    # The nose itself moves, by a degree or two.
    np.testing.assert_allclose(found, expected, atol=0.1 * np.abs(expected).max())


def test_a_moment_of_the_hypothesis_is_no_error_of_the_record_too(bodyfixed, linearised):
    frame = bodyfixed[1].frame
    (errors,) = record_errors(frame, (linearised[0],), (linearised[1],), frozenset({"trim"}))
    names = {value.name.split()[0] for value in errors}
    assert "trim" not in names
    assert "dynamic_imbalance" in names


def test_time_varying_errors_are_the_histories_at_the_nodes(linearised):
    flight, inputs, errors = linearised
    local = np.arange(300).reshape(100, 3)
    turn = np.exp(1j * inputs.roll[:300])
    time_varying = {c.name: c for c in error_histories(errors, 0, flight.time[:300], slice(0, 300), turn, local)}
    time_varying_error = time_varying[of_flight(GYROS[0], 0)]
    size, scale = histories(errors, "gyro_scale q")
    row = time_varying_error.weights.index(of_flight("gyro_scale q", 0))
    nodes = flight.time[:300][local[:, 1]]
    # Averaged over three samples in axes that the body turns in by a few hundredths of a radian.
    np.testing.assert_allclose(time_varying_error.shapes(nodes)[row], scale[GYROS[0]][local[:, 1]], atol=2e-3 * size)
