"""The research cone with a body-fixed moment from 2 to 4 s, as a problem with its fits."""

from __future__ import annotations

from functools import cache

from brv_hypo.inference.fit import HypothesisFit, fit_hypothesis, renewed, with_errors
from brv_hypo.inference.problem import Problem
from brv_hypo.inference.refinement import ROUGH
from brv_hypo.mechanisms import find
from brv_hypo.simulation import SimulatedFlight
from tests.chains import prepared
from tests.flights import flown


def pulse() -> SimulatedFlight:
    """The flight."""
    return flown("research_cone", "bodyfixed")


def problem() -> Problem:
    """Its least-squares problem, for models of few terms."""
    return prepared("bodyfixed", max_terms=4, exact_terms=4)


@cache
def fitted(name: str) -> HypothesisFit:
    """The fit of one mechanism, or of `none`."""
    mechanisms = () if name == "none" else (find(name),)
    return with_errors(problem(), renewed(problem(), fit_hypothesis(problem(), name, mechanisms), ROUGH))
