"""Planted parameters and what the planted mechanism's own fit makes of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Protocol, TypeVar

import numpy as np

from brv_hypo.mechanisms import find
from brv_hypo.ranking.result import DerivedEstimate, Interval, RankedHypothesis, TermEstimate
from brv_hypo.simulation.config import PlantedConfig
from brv_hypo.study.outcome import Estimate, EstimateKind


class _Regional(Protocol):
    @property
    def region_s(self) -> Interval | None: ...


Item = TypeVar("Item", bound=_Regional)


def estimates(planted: Sequence[PlantedConfig], fitted: RankedHypothesis) -> tuple[Estimate, ...]:
    """Each planted parameter beside its estimate, which may be missing."""
    return tuple(estimate for entry in planted for estimate in _of_entry(entry, fitted))


def _of_entry(entry: PlantedConfig, fitted: RankedHypothesis) -> Iterator[Estimate]:
    terms = [term for term in fitted.terms if term.mechanism == entry.mechanism]
    leading = max(terms, key=lambda term: term.f_ratio, default=None)
    yield from _thetas(entry, fitted, leading)
    yield from _knots(entry, fitted)
    alike = [term for term in terms if leading is not None and term.delay_s == leading.delay_s]
    yield from _coefficients(entry, alike)
    yield from _derived(entry, fitted)


def _thetas(
    entry: PlantedConfig, fitted: RankedHypothesis, leading: TermEstimate | None
) -> Iterator[Estimate]:
    """The delay of the term with the greatest F; another parameter's first value."""
    declared = {parameter.name: parameter for parameter in find(entry.mechanism, entry.options).parameters()}
    for name, truth in entry.theta.items():
        found = [item for item in fitted.derived if item.name == f"{entry.mechanism} {name}"]
        if declared[name].is_delay and leading is not None and leading.delay_s is not None:
            delay = leading.delay_s / declared[name].seconds
            found.sort(key=lambda item: abs(item.value - delay))
        yield _estimate(name, "theta", declared[name].units, truth, found[0] if found else None)


def _knots(entry: PlantedConfig, fitted: RankedHypothesis) -> Iterator[Estimate]:
    """Onset and end, each with the nearest knot of the fit, no knot serving for both."""
    knots = [item for item in fitted.derived if item.name == f"{entry.mechanism} knot"]
    for name, truth in (("onset", entry.start), ("end", entry.stop)):
        if truth is None:
            continue
        item = min(knots, key=lambda knot: abs(knot.value - truth), default=None)
        knots = [knot for knot in knots if knot is not item]
        yield _estimate(name, "knot", "s", truth, item)


def _coefficients(entry: PlantedConfig, terms: Sequence[TermEstimate]) -> Iterator[Estimate]:
    """The change of each coefficient at the onset."""
    for name, truth in entry.terms.items():
        label = name if entry.start is None else f"{entry.kind} in {name}"
        item = _nearest(entry, (term for term in terms if term.name == label))
        yield _estimate(name, "coefficient", "" if item is None else item.units, truth, item)


def _derived(entry: PlantedConfig, fitted: RankedHypothesis) -> Iterator[Estimate]:
    """What the mechanism derives from its coefficients; an angle is taken on the branch next to the truth."""
    unknown = np.zeros((len(entry.terms), len(entry.terms)))
    for truth in find(entry.mechanism, entry.options).derived(entry.terms, unknown):
        item = _nearest(entry, (item for item in fitted.derived if item.name == truth.name))
        found = _estimate(truth.name, "derived", truth.units, truth.value, item)
        if found.value is not None and truth.units == "rad":
            turned = truth.value + float(np.angle(np.exp(1j * (found.value - truth.value))))
            found = found.model_copy(update={"value": turned})
        yield found


def _estimate(
    name: str, kind: EstimateKind, units: str, truth: float, item: TermEstimate | DerivedEstimate | None
) -> Estimate:
    """A planted value beside what the fit has of it, if anything."""
    value, error = (None, None) if item is None else (item.value, item.std_error)
    return Estimate(name=name, kind=kind, units=units, truth=truth, value=value, std_error=error)


def _nearest(entry: PlantedConfig, items: Iterable[Item]) -> Item | None:
    """The item whose region begins nearest the planted onset; None where none begins nearer than the end."""
    reach = np.inf if entry.start is None or entry.stop is None else 0.5 * (entry.stop - entry.start)

    def distance(item: Item) -> float:
        if item.region_s is None or entry.start is None:
            return 0.0 if item.region_s is None and entry.start is None else np.inf
        return abs(item.region_s[0] - entry.start)

    found = min(items, key=distance, default=None)
    return found if found is not None and distance(found) < reach else None
