"""A mechanism's nonlinear parameters may have any name, unit and kind."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
import pytest

from brv_hypo.mechanisms import Mechanism, Parameter, Term, find
from brv_hypo.motion.motion import Motion
from brv_hypo.regression.fit import HypothesisFit, fit_hypothesis, refit
from brv_hypo.regression.problem import Problem
from tests.chains import prepared

DELAYS = (0.04, 0.08, 0.16)


class Late(Mechanism):
    """The in-plane moment, turned by a delay whose name is `delay`."""

    name = "late"
    title = "a late moment"
    claims = "the moment follows late"
    source = "this test"
    several_parameters_at_once = True

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("delay", "s", DELAYS, (0.01, 0.4), "delay", is_delay=True),)

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        past = motion.delayed(theta[self.parameters()[0].name])
        turned = motion.windward_meridian - past.windward_meridian
        return (Term("eps", np.zeros_like(turned), past.in_plane_moment * np.sin(turned)),)


class LateByTau(Late):
    """The same under another name of the delay."""

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("tau", "s", DELAYS, (0.01, 0.4), "delay", is_delay=True),)


class Tilted(Mechanism):
    """A body-fixed moment whose direction is an angle, negative ones and zero included."""

    name = "tilted"
    title = "a moment at an angle"
    claims = "a moment that keeps its direction in the body"
    source = "this test"

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("direction", "rad", (-1.0, 0.0, 1.0), (-1.6, 1.6), "direction in the body"),)

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        angle = motion.windward_meridian - theta["direction"]
        return (Term("C_b", np.cos(angle), np.sin(angle)),)


def problem(plant: str) -> Problem:
    return prepared(plant, max_terms=2, exact_terms=2, knot_count=3)


@cache
def fitted(mechanism: Mechanism, plant: str) -> HypothesisFit:
    return refit(problem(plant), fit_hypothesis(problem(plant), mechanism.name, (mechanism,)))


@pytest.mark.thorough
def test_a_delay_of_any_name_is_a_delay() -> None:
    one, other = fitted(Late(), "sticking"), fitted(LateByTau(), "sticking")
    assert other.information == pytest.approx(one.information, rel=1e-12)
    assert [column.delay for column in other.selected] == [column.delay for column in one.selected]
    assert all(column.delay is not None for column in other.selected)
    assert "tau" in {parameter.name for parameter in other.nonlinear}
    assert {parameter.units for parameter in other.nonlinear} == {"s"}


@pytest.mark.thorough
def test_an_angle_keeps_its_units_and_is_no_delay() -> None:
    fit = fitted(Tilted(), "bodyfixed")
    direction = next(parameter for parameter in fit.nonlinear if parameter.name == "direction")
    assert direction.units == "rad"
    assert -1.6 <= direction.value <= 1.6
    assert all(column.delay is None for column in fit.selected)
    assert len(fit.nonlinear_errors) == len(fit.nonlinear)


@pytest.mark.thorough
def test_what_the_installed_lag_fits_is_a_delay() -> None:
    assert all(column.delay is not None for column in fitted(find("lag"), "sticking").selected)
