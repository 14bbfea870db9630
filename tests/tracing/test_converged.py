"""The converged model of a flight: it is judged where it is linearised, and knows how well its sizes are known."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.linearisation.channels import first_values
from brv_hypo.linearisation.linear import covariance_of
from brv_hypo.mechanisms import find
from brv_hypo.model.term import Regressor, TimeBasis, term_column
from brv_hypo.tracing import TraceConfig
from brv_hypo.tracing.additions import analyse_step
from brv_hypo.tracing.baseline import start_model
from brv_hypo.tracing.fit import Fit, Flights, converged, correct, fitted_about
from tests.chains import TRIM, traced_trim
from tests.comparison.pulse import fitted, pulse
from tests.flights import nominal
from tests.studies.independent.effects import sized

CONFIG = TraceConfig(discover=False)


@pytest.fixture(scope="module")
def state() -> Fit:
    """A moment that begins and ends, with the knots that a fit gave it."""
    source = Flights((pulse().flight,), CONFIG)
    model = start_model(source, [find("bodyfixed")])
    return converged(source, model.but(columns=(*model.columns, *fitted("bodyfixed").selected)))


@pytest.mark.thorough
def test_a_step_begins_from_the_converged_fit(state: Fit) -> None:
    again, _ = analyse_step(state, (), ())
    assert again.error == pytest.approx(state.error, rel=0.02)
    assert again.held_out == pytest.approx(state.held_out, rel=0.02)


@pytest.mark.thorough
def test_sizes_are_less_certain_than_they_would_be_at_known_knots(state: Fit) -> None:
    here = state.on_whole_record()
    covariance, problem = here.covariance, here.problem
    design = problem.whole_design(here.null.frame, here.null.columns)
    values = np.linalg.lstsq(design, problem.raw_response, rcond=None)[0]
    samples = problem.samples + design.shape[1] - len(here.null.columns)  # less constants and nuisances already
    known = covariance_of(design, problem.raw_response - design @ values, samples, 1.0)
    jumps = [k for k, column in enumerate(here.null.columns) if column.time_basis.kind == "jump"]
    assert jumps
    assert np.all(np.diag(covariance)[jumps] > 1.01 * np.diag(known)[jumps])


def test_a_trim_that_was_added_has_no_tolerance_beside_it() -> None:
    flight = nominal().flight
    model = start_model(Flights((flight,), CONFIG), [find("trim")])
    assert "trim" in [mechanism.name for mechanism in model.tolerated(flight)]
    fixed = model.but(columns=(Regressor("trim", "C_m0", (), TimeBasis("constant"), "1"),))
    assert "trim" not in [mechanism.name for mechanism in fixed.tolerated(flight)]
    result = traced_trim()
    found = {term.name: term for term in result.model.terms if term.mechanism == "trim"}
    for name, planted in zip(("C_m0", "C_n0"), TRIM, strict=True):
        assert found[name].std_error < 0.02 * abs(planted)
        assert abs(found[name].value - planted) < 4.0 * found[name].std_error


@pytest.mark.thorough
def test_a_reading_of_a_record_is_reconstructed_once_and_its_errors_are_linearised_once() -> None:
    source = Flights((nominal().flight,), CONFIG)
    model = start_model(source)
    data = correct(source, model)
    assert correct(source, model).records[0] is data.records[0]
    assert correct(source, model, [{("gyro_bias", "q"): 1e-4}]).records[0] is not data.records[0]
    linear = data.linearised(model, first_values(data.frame, data.fitted, model.columns))
    first, known = data.regression(model, linear), dict(linear[0].known)
    again = data.regression(model, linear)
    assert known
    assert all(linear[0].known[key] is history for key, history in known.items())
    assert [item.label for item in again.rows.nuisances.items] == [item.label for item in first.rows.nuisances.items]
    assert np.array_equal(again.raw_response, first.raw_response)


@pytest.mark.slow
def test_a_model_is_linearised_about_its_own_coefficients_until_it_fits_no_better() -> None:
    """Three powers of a Mach number that changes by 2 % are nearly one column.

    Once was not enough: a third of its residual was its own, and a moment that turns with the roll a finding.
    """
    source = Flights((sized(232010, "reynolds_stiffness").made.flight,), CONFIG)
    model = start_model(source, [find("mach_stiffness")])
    motion, always = correct(source, model).frame.motions[0], TimeBasis("constant")
    terms = find("mach_stiffness").terms(motion, {})
    powers = [term_column(find("mach_stiffness"), term, (), always) for term in terms]
    state = converged(source, model.but(columns=(*model.columns, *powers)))
    again = fitted_about(state.data, state.model, state.values)
    assert again.error > 0.98 * state.error
