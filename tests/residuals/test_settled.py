"""The model as it settled on a flight: it is judged where it is linearised, and knows how well its sizes are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from brv_hypo.mechanisms import find
from brv_hypo.model.term import Regressor, TimeBasis, term_column
from brv_hypo.regression.linear import covariance_of
from brv_hypo.residuals import TraceConfig
from brv_hypo.residuals.baseline import start_model, starting_columns, tolerated, with_priors
from brv_hypo.residuals.candidates_at_step import analyse_step, baseline_analysis
from brv_hypo.residuals.fitted_model import State, converged_state, state_of
from brv_hypo.residuals.linearisation import correct
from brv_hypo.residuals.problem import linearised_at, problem_of
from brv_hypo.residuals.static_slope import whole_fit
from tests.chains import TRIM, traced_trim
from tests.flights import nominal
from tests.ranking.pulse import fitted, pulse
from tests.studies.independent.effects import sized

CONFIG = TraceConfig(maximum_likelihood=False, discover=False)


@pytest.fixture(scope="module")
def state() -> State:
    """A moment that begins and ends, with the knots that a fit gave it."""
    flights = (pulse().flight,)
    model = start_model(flights, [find("bodyfixed")])
    columns = starting_columns(model, correct(flights, model, CONFIG).frame)
    model = replace(model, columns=(*columns, *fitted("bodyfixed").selected))
    return converged_state(flights, model, CONFIG)


@pytest.mark.thorough
def test_a_step_begins_from_the_state_as_it_settled(state: State) -> None:
    here = analyse_step(state.data, state.model, state.linear, (), (), CONFIG)
    again = state_of(state.model, state.data, here.problem, state.linear)
    assert again.errors.mean_square == pytest.approx(state.errors.mean_square, rel=0.02)
    assert again.held_out.mean_square == pytest.approx(state.held_out.mean_square, rel=0.02)


@pytest.mark.thorough
def test_sizes_are_less_certain_than_they_would_be_at_known_knots(state: State) -> None:
    here = baseline_analysis(state.data, state.model, state.linear, CONFIG, state.problem.rows.noise)
    _, covariance = whole_fit(here)
    problem = here.problem.on(state.data.whole)
    design = problem.whole_design(here.null.frame, here.null.columns)
    values = np.linalg.lstsq(design, problem.raw_response, rcond=None)[0]
    known = covariance_of(design, problem.raw_response - design @ values, problem.samples, 1.0)
    jumps = [k for k, column in enumerate(here.null.columns) if column.time_basis.kind == "jump"]
    assert jumps
    assert np.all(np.diag(covariance)[jumps] > 1.01 * np.diag(known)[jumps])


def test_a_trim_that_was_added_has_no_tolerance_beside_it() -> None:
    flight = nominal().flight
    model = start_model((flight,), [find("trim")])
    assert "trim" in [mechanism.name for mechanism in tolerated(model, flight)]
    held = replace(model, columns=(Regressor("trim", "C_m0", (), TimeBasis("constant"), "1"),))
    assert "trim" not in [mechanism.name for mechanism in tolerated(held, flight)]
    result = traced_trim()
    found = {term.name: term for term in result.model.terms if term.mechanism == "trim"}
    for name, planted in zip(("C_m0", "C_n0"), TRIM, strict=True):
        assert found[name].std_error < 0.02 * abs(planted)
        assert abs(found[name].value - planted) < 4.0 * found[name].std_error


@pytest.mark.slow
def test_a_model_is_linearised_about_its_own_coefficients_until_it_fits_no_better() -> None:
    """Three powers of a Mach number that changes by 2 % are nearly one column.

    Once was not enough: a third of what it left was its own, and a moment that turns with the roll a finding.
    """
    flights = (sized(232010, "reynolds_stiffness").made.flight,)
    config = CONFIG.model_copy(update={"baseline": "constant"})
    model = start_model(flights, [find("mach_stiffness")], "constant")
    data = correct(flights, model, config)
    motion, always = data.reconstructions[0].motion, TimeBasis("constant")
    terms = find("mach_stiffness").terms(motion, {})
    powers = [term_column(find("mach_stiffness"), term, (), always) for term in terms]
    model = with_priors(replace(model, columns=(*starting_columns(model, data.frame), *powers)), data)
    state = converged_state(flights, model, config)
    linear = linearised_at(state.data, state.model, state.values)
    again = state_of(state.model, state.data, problem_of(state.data, state.model, linear, config), linear)
    assert again.errors.mean_square > 0.98 * state.errors.mean_square
