"""Effects that are not wanted beside others and processes are removed again."""

from __future__ import annotations

from dataclasses import replace

import pytest

from brv_hypo.inference.fit import fit_hypothesis
from brv_hypo.mechanisms import find
from brv_hypo.model.model import Model
from brv_hypo.model.term import Regressor, TimeBasis
from brv_hypo.tracing import TraceConfig
from brv_hypo.tracing.additions import generic_name
from brv_hypo.tracing.baseline import start_model
from brv_hypo.tracing.fit import Fit, Flights, converged, correct
from brv_hypo.tracing.result import Errors, Residual, Step, lasting_steps
from brv_hypo.tracing.trace import unwanted
from tests.comparison.pulse import fitted, pulse

CONFIG = TraceConfig()


def model_of(*names: str) -> Model:
    """Constant coefficients, the moment that was planted, and other effects."""
    source = Flights((pulse().flight,), CONFIG)
    model = start_model(source, [find(name) for name in ("bodyfixed", *names)])
    frame = correct(source, model).frame
    terms = {name: find(name).terms(frame.motions[0], {}) for name in names}
    others = tuple(
        Regressor(name, term.name, (), TimeBasis("constant"), term.units) for name in names for term in terms[name]
    )
    columns = (*model.columns, *fitted("bodyfixed").selected, *others)
    return model.but(columns=columns, added=("bodyfixed", *names))


@pytest.fixture(scope="module")
def state() -> Fit:
    return converged(Flights((pulse().flight,), CONFIG), model_of("magnus", "trim", "mach_stiffness"))


@pytest.mark.thorough
def test_what_the_flight_does_not_need_beside_what_acts_is_named(state: Fit) -> None:
    assert unwanted(state, ("bodyfixed", "magnus")) == ("magnus",)


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["trim", "mach_stiffness", "gyro_bias", "unheard_of"])
def test_terms_of_every_fit_a_schedule_and_errors_of_the_record_are_not_tested(state: Fit, name: str) -> None:
    assert unwanted(state, (name,)) == ()


@pytest.mark.thorough
def test_what_is_removed_costs_more_than_it_explains(state: Fit) -> None:
    less = state.model.without(["magnus"])
    assert all(column.mechanism != "magnus" for column in less.columns)
    assert "magnus" not in less.mechanisms
    assert less.added == ("bodyfixed", "trim", "mach_stiffness")
    own, other = (
        fit_hypothesis(replace(state.problem, baseline=m.columns), "none", ()).information for m in (state.model, less)
    )
    assert other < own


def test_a_description_has_a_name_that_the_model_has_not() -> None:
    known = {"discovered_2": find("magnus")}
    assert generic_name(Model(mechanisms=known, added=("discovered_2",))) == "discovered_3"
    assert generic_name(Model()) == "discovered_1"


def step(number: int, added: str | None, *next_corrections: str) -> Step:
    nothing = Errors(fit=1.0, held_out=1.0)
    return Step(
        step=number,
        residual=Residual.model_construct(),
        candidates=(),
        taken_out=next_corrections,
        added=added,
        error_before=nothing,
        error_after=None,
        error_ratio_held_out=None,
    )


@pytest.mark.parametrize(
    ("steps", "stay"),
    [
        ([step(1, "lag"), step(2, "sticking", "lag")], ["sticking"]),
        ([step(1, "lag"), step(2, "sticking", "lag"), step(3, "lag")], ["sticking", "lag"]),
        ([step(1, "lag"), step(2, None)], ["lag"]),
    ],
)
def test_what_was_removed_is_no_finding_unless_added_again(steps: list[Step], stay: list[str]) -> None:
    assert [each.added for each in lasting_steps(steps)] == stay
