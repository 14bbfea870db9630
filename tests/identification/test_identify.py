"""Identification on simulated flights of the research cone."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from brv_hypo.identification import identify
from brv_hypo.mechanisms import record_effects
from brv_hypo.mechanisms.registry import nuisance_mechanisms
from tests.studies.identification.study import errors, flights, regress, trial


@pytest.mark.thorough
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


def test_errors_of_a_perfect_record_stay_within_their_tolerances(bodyfixed):
    _, work, found = bodyfixed
    sizes = {value.name: value.size for value, _ in found.problem.tolerated}
    carried = [effect for effect in record_effects() if effect.carried]
    flight = work.frame.reconstructions[0].flight
    components = {f"{effect.name} {c.name}" for effect in carried for c in effect.components(flight)}
    assert set(sizes) - components == {
        f"{mechanism.name} {term.name}"
        for mechanism in nuisance_mechanisms(flight)
        for term in mechanism.terms(work.frame.motions[0], {})
    }
    for estimate in found.instruments:
        assert abs(estimate.value) < sizes[estimate.name], estimate.name
        assert 0.0 < estimate.std_error < 1.05 * sizes[estimate.name], estimate.name
    assert "tolerance" not in found.message


@pytest.mark.slow
@pytest.mark.parametrize(
    ("path", "name"),
    [
        ("errors.gyro_misalignment.y", "gyro_misalignment y"),
        ("errors.time_skew.accelerometers", "time_skew accelerometers"),
        ("errors.accel_scale.z", "accel_scale z"),
    ],
)
def test_an_error_of_the_record_far_beyond_its_tolerance_is_measured_and_said(path, name):
    """Ten tolerances, planted by the simulator; what two values share is reported for both."""
    ((_, quiet),) = flights("none", 1, seed=11)
    effect, component = name.split()
    sizes = {c.name: c.size for e in record_effects() if e.name == effect for c in e.components(quiet)}
    value = 10.0 * sizes[component]
    ((simulated, flight),) = flights("none", 1, seed=11, instruments={path: value})
    work = trial(simulated, flight)
    found = identify(work.frame, work.columns, work.values)
    assert found.status == "converged"
    estimates = {estimate.name: estimate for estimate in found.instruments}
    assert abs(estimates[name].value - value) < 10.0 * estimates[name].std_error
    assert estimates[name].value > 3.0 * sizes[component]
    assert f"{name} is" in found.message


@pytest.mark.slow
def test_with_errors_within_tolerance_estimates_are_within_theirs():
    for simulated, flight in flights("bodyfixed", 2, seed=40, tolerances=1.0):
        work = trial(simulated, flight)
        found = identify(work.frame, work.columns, work.values)
        assert found.status == "converged"
        for name, (error, estimate) in errors(work, found).items():
            assert abs(error) < 4.0 * estimate.std_error, name


@pytest.mark.thorough
def test_a_known_wind_enters_the_motion():
    """A step of 100 m/s that the record has, and that did not blow, does not fit."""
    ((simulated, flight),) = flights("none", 1, seed=13)
    wind = np.zeros((flight.samples, 3))
    work = trial(simulated, flight)
    found = identify(work.frame, work.columns, work.values)
    wind[flight.samples // 2 :, 1] = 100.0
    record = work.frame.reconstructions[0]
    frame = replace(work.frame, reconstructions=(replace(record, flight=replace(flight, wind=wind)),))
    false = identify(frame, work.columns, work.values)
    assert found.log_likelihood > false.log_likelihood + 10.0


@pytest.mark.slow
def test_table_4_3_in_kind_maximum_likelihood_is_closer_to_the_truth_than_regression():
    """Root mean square error over flights, regression over maximum likelihood: at least 2 for each coefficient.

    Eight noisy flights gave ratios of 3 to 8.
    """
    squares = []
    for simulated, flight in flights("none", 8, seed=100):
        work = trial(simulated, flight)
        found = identify(work.frame, work.columns, work.values)
        squares.append([(work.values - work.coefficients) ** 2, (found.values - work.coefficients) ** 2])
    regression, likelihood = np.sqrt(np.mean(squares, axis=0))
    assert np.all(regression > 2.0 * likelihood), regression / likelihood


@pytest.mark.slow
def test_a_delay_of_0_2_s_comes_back_from_a_start_0_1_s_off():
    ((simulated, flight),) = flights("sticking", 1, seed=5, delay=0.2)
    work = trial(simulated, flight, delay_error=0.1)
    found = identify(work.frame, work.columns, work.values)
    error, estimate = errors(work, found)["delay"]
    assert found.status == "converged"
    assert abs(error) < 2.0 * estimate.std_error


@pytest.mark.slow
def test_flights_share_coefficients_and_keep_their_own_gravity():
    from brv_hypo.linearisation.frame import build_frame

    pair = [trial(*one) for one in flights("none", 2, seed=21)]
    frame = build_frame([work.frame.reconstructions[0] for work in pair], list(pair[0].frame.mechanisms.values()))
    columns = pair[0].columns
    both = identify(frame, columns, regress(frame, columns))
    alone = identify(pair[0].frame, columns, pair[0].values)
    assert both.status == "converged"
    assert len(both.terms) == len(columns)
    assert both.problem.flights == (0, 1)
    assert "gravity 1 [flight 1]" in both.problem.theta
    assert len(both.instruments) == 2 * len(alone.instruments)
    for together, single, true in zip(both.terms, alone.terms, pair[0].coefficients, strict=True):
        assert together.std_error < single.std_error
        assert abs(together.value - true) < 4.0 * together.std_error


def test_a_search_that_ends_early_names_remedies_that_a_command_has(bodyfixed):
    _, work, _ = bodyfixed
    found = identify(work.frame, work.columns, work.values, max_iterations=1, begin_anew=False)
    assert found.status == "iteration limit"
    assert "`--start`, `--stop`" in found.message
    assert "max_iterations" not in found.message
    assert not re.search(r"\d+ iterations", found.message)  # of the last search: `iterations` counts all


def test_a_record_too_short_is_a_status_not_an_exception(bodyfixed):
    _, work, _ = bodyfixed
    short = tuple(
        replace(
            segment,
            time=segment.time[:8],
            observed=segment.observed[:8],
            factor=segment.factor[:8],
            rows=slice(0, 8),
            finer=None,
        )
        for segment in work.frame.segments
    )
    frame = replace(work.frame, segments=short)
    found = identify(frame, work.columns, work.values)
    assert found.status == "failed"
    assert "widen the window" in found.message
    np.testing.assert_array_equal(found.values, work.values)
