"""Short flights through the whole chain, and how far apart two comparisons of them are.

Compared are the verdict, all probabilities, and the numbers of every hypothesis that is credible. One that
they refuse is where a search among many poor models ended, which a last digit may lead to a neighbour as poor.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from brv_hypo.comparison import CompareConfig, Comparison, compare
from brv_hypo.comparison.result import RankedHypothesis
from brv_hypo.flight.record import Flight
from brv_hypo.simulation import SimulationConfig, load_config, simulate

# Probability from which a hypothesis is credible.
CREDIBLE = 1e-3
PLANTS = ("none", "bodyfixed", "damping", "sticking")


@dataclass(frozen=True)
class Case:
    """A flight of 3 s to draw: start in rad and rad/s, what is planted, and what is compared."""

    seed: int = 1
    alpha: float = 0.05
    windward_meridian: float = 0.4
    roll_rate: float = 6.0
    planted: str = "bodyfixed"
    mechanism: str = "bodyfixed"


@cache
def flight(case: Case) -> Flight:
    data = load_config("research_cone").model_dump() | {"duration": 3.0, "sample_rate": 100.0}
    drawn = {key: getattr(case, key) for key in ("alpha", "windward_meridian", "roll_rate")}
    data["start"] = data["start"] | drawn
    plant = () if case.planted == "none" else (case.planted,)
    return simulate(SimulationConfig.model_validate(data), seed=case.seed, plant=plant).flight


def compared(flights: Sequence[Flight], case: Case) -> Comparison:
    return compare(flights, CompareConfig(mechanisms=(case.mechanism,), maximum_likelihood="none"))


@cache
def original(case: Case) -> Comparison:
    return compared([flight(case)], case)


class Change(NamedTuple):
    """What became of the coordinates: later by `shift` s, axes rolled by `roll` rad, y mirrored where `sign` is -1."""

    shift: float = 0.0
    roll: float = 0.0
    sign: float = 1.0


UNCHANGED = Change()


class Distance(NamedTuple):
    """How far apart two comparisons are: estimates in standard errors, criteria in units of log-likelihood."""

    estimates: float
    criteria: float

    def within(self, allowed: Distance) -> bool:
        """True where neither is more than allowed."""
        return self.estimates <= allowed.estimates and self.criteria <= allowed.criteria


def distance(before: Comparison, after: Comparison, change: Change = UNCHANGED) -> Distance:
    """The largest difference of any estimate and of any criterion; infinite where the verdicts are not the same."""
    if _verdict(before) != _verdict(after):
        return Distance(math.inf, math.inf)
    rows = {row.mechanism: row for row in _credible(after)}
    pairs = [(row, rows[row.mechanism]) for row in _credible(before)]
    estimates = [apart for one, other in pairs for apart in _estimates(one, other, change)]
    if "none" in rows:
        for one, other in zip(before.baseline.terms, after.baseline.terms, strict=True):
            estimates.append(abs(other.value - one.value) / one.std_error)
    criteria = [apart for one, other in pairs for apart in _criteria(one, other)]
    for name, probability in before.verdict.probability.items():
        criteria.append(abs(after.verdict.probability[name] - probability))
    return Distance(float(np.max(estimates, initial=0.0)), float(np.max(criteria)))


def _credible(comparison: Comparison) -> list[RankedHypothesis]:
    """Those that the data do not refuse, in their order."""
    return [row for row in comparison.ranking if comparison.verdict.probability[row.mechanism] >= CREDIBLE]


def _verdict(comparison: Comparison) -> tuple[object, ...]:
    verdict = comparison.verdict
    names = [row.mechanism for row in _credible(comparison)]
    return verdict.outcome, verdict.winner, verdict.equivalent, names


def _estimates(one: RankedHypothesis, other: RankedHypothesis, change: Change) -> Iterator[float]:
    """Differences of the estimates that do not turn with the axes, in standard errors."""
    assert one.n_terms == other.n_terms, f"{one.mechanism} has {one.n_terms} terms, then {other.n_terms}"
    for before, after in zip(one.derived, other.derived, strict=True):
        moved = after.value - _transformed(before.name, before.value, change)
        yield abs(math.remainder(moved, 2.0 * math.pi) if before.units == "rad" else moved) / before.std_error
    for term, again in zip(one.terms, other.terms, strict=True):
        if "phi_b" not in term.name:  # a component: length and angle are above
            yield abs(again.value - term.value) / term.std_error


def _criteria(one: RankedHypothesis, other: RankedHypothesis) -> Iterator[float]:
    """Differences of what the hypotheses are ranked by."""
    yield from (abs(getattr(other, name) - getattr(one, name)) for name in ("bic", "log_likelihood"))
    yield abs(math.log(other.prediction_error / one.prediction_error))


def _transformed(name: str, value: float, change: Change) -> float:
    if name == "phi_b":
        return change.sign * value + change.roll
    return value + change.shift if name.endswith("knot") else value
