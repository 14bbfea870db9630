"""Identification on simulated flights of the research cone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from brv_hypo.identification import (
    IdentificationConfig,
    coefficient_histories,
    coefficients_without,
    identify,
    predicted_moments,
)
from brv_hypo.identification.study import errors, flights, regress, trial

NO_EVIDENCE = IdentificationConfig(candidates=())
BIASES = IdentificationConfig(candidates=(), instruments=("gyro_bias", "accel_bias"))


def test_a_body_fixed_moment_comes_back_within_its_errors(bodyfixed):
    _, work, found = bodyfixed
    assert found.status == "converged"
    for name, (error, estimate) in errors(work, found).items():
        assert abs(error) < 4.0 * estimate.std_error, name


def test_innovations_are_white_noise_of_the_instruments_size(bodyfixed):
    simulated, _, found = bodyfixed
    instruments = simulated.config.instruments
    spread = np.concatenate(found.innovations, axis=1).std(axis=1)
    np.testing.assert_allclose(spread[:2], instruments.gyro.noise, rtol=0.1)
    np.testing.assert_allclose(spread[2:], instruments.accelerometer.noise, rtol=0.1)
    assert found.whiteness[0].p_value > 1e-3


def test_nothing_is_added_where_nothing_is_planted(bodyfixed):
    assert not any(item.added for item in bodyfixed[2].evidence)
    assert bodyfixed[2].instruments == ()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("path", "value", "name"),
    [
        ("errors.gyro_bias.q", 2e-4, "gyro_bias q"),
        ("errors.accel_bias.z", 0.05, "accel_bias z"),
        ("errors.time_skew.accelerometers", 2e-3, "time_skew"),
    ],
)
def test_a_planted_instrument_error_is_found_and_measured(path, value, name):
    ((simulated, flight),) = flights("none", 1, seed=11, instruments={path: value})
    work = trial(simulated, flight)
    found = identify(work.frame, work.columns, work.values)
    estimates = {estimate.name: estimate for estimate in found.instruments}
    assert name in estimates
    assert estimates[name].value == pytest.approx(value, abs=4.0 * estimates[name].std_error)


@pytest.mark.slow
def test_table_4_3_in_kind_maximum_likelihood_is_closer_to_the_truth_than_regression():
    """Root mean square error over flights, regression over maximum likelihood: at least 2 for each coefficient.

    Eight noisy flights gave ratios of 3 to 8.
    """
    squares = []
    for simulated, flight in flights("none", 8, seed=100):
        work = trial(simulated, flight)
        found = identify(work.frame, work.columns, work.values, NO_EVIDENCE)
        squares.append([(work.values - work.coefficients) ** 2, (found.values - work.coefficients) ** 2])
    regression, likelihood = np.sqrt(np.mean(squares, axis=0))
    assert np.all(regression > 2.0 * likelihood), regression / likelihood


@pytest.mark.slow
def test_a_delay_of_0_2_s_comes_back_from_a_start_0_1_s_off():
    ((simulated, flight),) = flights("sticking", 1, seed=5, delay=0.2)
    work = trial(simulated, flight, delay_error=0.1)
    found = identify(work.frame, work.columns, work.values, NO_EVIDENCE)
    error, estimate = errors(work, found)["delay"]
    assert found.converged
    assert abs(error) < 2.0 * estimate.std_error


@pytest.mark.slow
def test_flights_share_coefficients_and_keep_their_own_gravity():
    from brv_hypo.regression.frame import build_frame

    pair = [trial(*one) for one in flights("none", 2, seed=21)]
    frame = build_frame(
        [work.frame.reconstructions[0] for work in pair], list(pair[0].frame.mechanisms.values())
    )
    columns = pair[0].columns
    both = identify(frame, columns, regress(frame, columns), BIASES)
    alone = identify(pair[0].frame, columns, pair[0].values, BIASES)
    assert both.converged
    assert len(both.terms) == len(columns)
    assert len(both.environment) == 2 * len(alone.environment)
    assert len(both.instruments) == 2 * len(alone.instruments)
    for together, single, true in zip(both.terms, alone.terms, pair[0].coefficients, strict=True):
        assert together.std_error < single.std_error
        assert abs(together.value - true) < 4.0 * together.std_error


def test_histories_have_bands_that_hold_the_moment(bodyfixed):
    simulated, _, found = bodyfixed
    histories = {history.name: history for history in coefficient_histories(found)}
    assert set(histories) == {"C_N'", "C_Z'", "C_N' by alpha", "C_Z' by alpha", "C_Nalpha_force"}
    moment, truth = histories["C_N'"], simulated.truth
    expected = np.interp(moment.time, truth.time, truth.C_N)
    inside = np.abs(moment.value - expected) < 1e-3 * np.std(expected)
    assert np.mean(inside) > 0.98
    force = histories["C_Nalpha_force"]
    low, high = force.band
    assert np.all(low < 1.9 + 2.0 * force.std_error)
    assert np.all(high > 1.9 - 2.0 * force.std_error)
    slope = histories["C_N' by alpha"]
    np.testing.assert_allclose(slope.value, -0.0883, rtol=2e-3)


def test_held_out_coefficients_predict_what_they_did_not_see(bodyfixed):
    simulated, _, found = bodyfixed
    block = (500, 650)
    values = coefficients_without(found, [block])
    truth = (simulated.truth.C_m + 1j * simulated.truth.C_n)[slice(*block)]
    predicted = predicted_moments(found, values)[slice(*block)]
    assert not np.array_equal(values, found.values)
    assert np.sqrt(np.mean(np.abs(predicted - truth) ** 2)) < 1e-2 * np.sqrt(np.mean(np.abs(truth) ** 2))


def test_a_record_too_short_is_a_status_not_an_exception(bodyfixed):
    _, work, _ = bodyfixed
    short = tuple(
        replace(
            segment,
            time=segment.time[:8],
            observed=segment.observed[:8],
            factor=segment.factor[:8],
            rows=slice(0, 8),
        )
        for segment in work.frame.segments
    )
    frame = replace(work.frame, segments=short)
    found = identify(frame, work.columns, work.values)
    assert found.status == "failed"
    assert "widen the window" in found.message
    np.testing.assert_array_equal(found.values, work.values)
