"""A mechanism's nonlinear parameters may have any name, unit and kind: what is found is the same to the last digits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from brv_hypo.comparison.compare import criteria_of
from brv_hypo.comparison.verdict import OTHER, probabilities
from brv_hypo.inference.fit import HypothesisFit, fit_hypothesis, renewed, with_errors
from brv_hypo.inference.problem import Problem
from brv_hypo.inference.refinement import ROUGH
from brv_hypo.mechanisms import Mechanism, Parameter, Term, find
from brv_hypo.mechanisms.conformance import MECHANISM_CHECKS
from brv_hypo.motion.motion import Motion
from tests.chains import prepared
from tests.renamed import Alias, renamed
from tests.texts import CHARACTERS

pytestmark = pytest.mark.thorough

APART = 1e-9
"""What numbers may differ by, relatively, between names and units."""


class Tilted(Mechanism):
    """A body-fixed moment whose direction is an angle, negative ones and zero included."""

    name = "tilted"
    title = "a moment at an angle"
    claims = "a moment that keeps its direction in the body"
    source = "this test"

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("direction", "rad", (-1.0, 0.0, 1.0), (-1.6, 1.6), "direction in the body"),)

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One term: the moment."""
        angle = motion.windward_meridian - theta["direction"]
        return (Term("C_b", np.cos(angle), np.sin(angle)),)


class Swelling(Mechanism):
    """An out-of-plane moment about a time, of a rate and a power of alpha: three kinds of parameters."""

    name = "swelling"
    title = "a moment that swells"
    claims = "an out-of-plane moment that grows at a time"
    source = "this test"
    time_variation = ("constant",)

    def parameters(self) -> tuple[Parameter, ...]:
        return (
            Parameter("onset", "s", (2.0, 3.0), (1.0, 5.0), "when it grows"),
            Parameter("rate", "1/s", (2.0,), (0.5, 8.0), "how fast it grows"),
            Parameter("power", "1", (1.0, 2.0), (0.5, 3.0), "power of alpha"),
        )

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One term: the moment."""
        grown = 0.5 + 0.5 * np.tanh(theta["rate"] * (motion.time - theta["onset"]))
        size = grown * (motion.alpha / 0.05) ** theta["power"]
        return (Term("C", np.zeros_like(size), size),)


MECHANISMS = {mechanism.name: mechanism for mechanism in (find("sticking"), find("lag"), Tilted(), Swelling())}
QUICK = ("lag", "tilted")
UNITS = {
    "s": (("s", 1.0), ("ms", 1e-3), ("min", 60.0), ("us", 1e-6)),
    "rad": (("rad", 1.0), ("deg", np.pi / 180.0)),
    "1/s": (("1/s", 1.0), ("1/ms", 1e3), ("1/min", 1.0 / 60.0)),
    "1": (("1", 1.0), ("percent", 0.01)),
}
RESERVED = ("knot", "start", "stop")
NAMES = st.sampled_from(["tau", "x", "delay", "eps", "sticking", "none", "τ", "время", "a [b]", "C_m0", "theta"]) | (
    st.text(CHARACTERS, min_size=1, max_size=6).filter(
        lambda text: text.isprintable() and text.strip() == text and text not in RESERVED and not set("./") & set(text)
    )
)


@st.composite
def aliases(draw: st.DrawFn, parameters: tuple[Parameter, ...]) -> dict[str, Alias]:
    """Another name and other units for each of them."""
    names = draw(st.lists(NAMES, min_size=len(parameters), max_size=len(parameters), unique=True))
    return {
        parameter.name: Alias(name, *draw(st.sampled_from(UNITS[parameter.units])))
        for parameter, name in zip(parameters, names, strict=True)
    }


def problem() -> Problem:
    return replace(prepared("bodyfixed", knot_count=3), max_terms=1, exact_terms=1)


@cache
def null() -> HypothesisFit:
    return with_errors(problem(), renewed(problem(), fit_hypothesis(problem(), "none", ()), ROUGH))


def fitted(mechanism: Mechanism) -> HypothesisFit:
    return with_errors(problem(), renewed(problem(), fit_hypothesis(problem(), mechanism.name, (mechanism,)), ROUGH))


@cache
def own(name: str) -> HypothesisFit:
    return fitted(MECHANISMS[name])


def numbers(fit: HypothesisFit) -> list[float]:
    """C_p, BIC, F-ratio and the rest of the criteria, probabilities, coefficients and their errors, delays in s."""
    criteria = criteria_of(problem(), (null(), fit))[1]
    levels = {name: -0.5 * each.information for name, each in (("none", null()), (fit.name, fit))}
    chances = probabilities(levels, (levels["none"],))
    delays = [delay for column in fit.selected for delay in column.delays]
    chance = [chances[name] for name in ("none", fit.name, OTHER)]
    values = [*fit.values, *np.sqrt(np.diag(fit.covariance)), *delays, *chance]
    listed = ("rss", "cp", "bic", "f_ratio", "prediction_error", "press", "r2")
    return [*(getattr(criteria, name) for name in listed), fit.information, *map(float, values)]


@settings(max_examples=settings().max_examples // 7)  # a fit each
@given(data=st.data())
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in MECHANISMS]
)
def test_names_and_units_of_parameters_change_no_number(name: str, data: st.DataObject) -> None:
    mechanism = MECHANISMS[name]
    others = data.draw(aliases(mechanism.parameters()))
    other = fitted(renamed(mechanism, others))
    assert numbers(other) == pytest.approx(numbers(own(name)), rel=APART, abs=0.0)
    before = zip(own(name).nonlinear, own(name).nonlinear_errors, strict=True)
    after = zip(other.nonlinear, other.nonlinear_errors, strict=True)
    for (one, error), (same, its_error) in zip(before, after, strict=True):
        alias = others[one.name] if one.kind == "theta" else Alias(one.name, one.units)
        assert (same.name, same.units) == (alias.name, alias.units)
        assert same.value * alias.scale == pytest.approx(one.value, rel=APART)
        assert its_error * alias.scale == pytest.approx(error, rel=APART)


@given(data=st.data())
@pytest.mark.parametrize("name", MECHANISMS)
def test_under_other_names_and_units_it_conforms(name: str, data: st.DataObject) -> None:
    mechanism = MECHANISMS[name]
    other = renamed(mechanism, data.draw(aliases(mechanism.parameters())))
    checks = {check.__name__: check for check in MECHANISM_CHECKS}
    for check in ("has_sane_parameters", "flags_its_delays", "has_the_same_terms_for_every_theta"):
        checks[check](other)


def test_delays_and_angles_are_what_they_are_declared_to_be() -> None:
    assert all(column.delay is not None for column in own("lag").selected)
    assert all(column.delay is None for column in own("tilted").selected)
    direction = next(parameter for parameter in own("tilted").nonlinear if parameter.name == "direction")
    assert -1.6 <= direction.value <= 1.6
    assert len(own("tilted").nonlinear_errors) == len(own("tilted").nonlinear)
