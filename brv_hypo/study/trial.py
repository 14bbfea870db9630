"""One flight of a study: simulated with a planted mechanism, compared, and kept as an `Outcome`.

`fly` is the entrance; a flight that fails is an outcome with its reason.
"""

from __future__ import annotations

import time as clock
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Literal, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict

from brv_hypo.comparison import compare
from brv_hypo.comparison.result import DerivedEstimate, RankedHypothesis, TermEstimate
from brv_hypo.errors import BrvHypoError
from brv_hypo.flight.format import assemble
from brv_hypo.mechanisms import find
from brv_hypo.motion.signals import rms
from brv_hypo.simulation import Truth, simulate
from brv_hypo.simulation.config import PlantedConfig
from brv_hypo.study.config import NONE, Draw, StudyConfig, corrupted, flight_config, planted_faults

ABSENT = 1e-6  # part of its largest value below which what is planted counts as absent: rounding of the moments

EstimateKind = Literal["theta", "knot", "coefficient", "derived"]
Item = TypeVar("Item", TermEstimate, DerivedEstimate)


class Estimate(BaseModel):
    """A planted value and its estimate; None where the fit holds no such parameter."""

    model_config = ConfigDict(frozen=True, ser_json_inf_nan="constants")

    name: str
    kind: EstimateKind
    """`theta` (a delay), `knot` (onset or end, s), `coefficient`, or `derived` (phi_b)."""
    units: str
    """Of the truth, the estimate and its standard error."""
    truth: float
    value: float | None = None
    std_error: float | None = None

    @property
    def sigmas(self) -> float | None:
        """Error over standard error; None where there is no estimate, or no standard error."""
        if self.value is None or not self.std_error:
            return None
        return (self.value - self.truth) / self.std_error


class Outcome(BaseModel):
    """One flight: what was drawn, what was planted, and what `compare` made of it."""

    model_config = ConfigDict(frozen=True, ser_json_inf_nan="constants")

    draw: Draw
    status: Literal["compared", "refused", "not simulated", "not compared"]
    reason: str = ""
    """Why the flight was not compared."""
    faults: tuple[str, ...] = ()
    """What the data compatibility check named, as "channel: fault"."""
    fault_named: bool | None = None
    """Whether the planted fault is among them; None without one."""
    effect_in_plane: float = 0.0
    """Rms of what is planted, while it lasts, over the rms of the whole moment in that time."""
    effect_out_of_plane: float = 0.0
    first: str | None = None
    winner: str | None = None
    equivalent: tuple[str, ...] = ()
    probability: dict[str, float] = {}
    information: dict[str, float] = {}
    """-2 ln evidence of each hypothesis, over that of the baseline only."""
    estimates: tuple[Estimate, ...] = ()
    """Of the planted mechanism's own fit."""
    alpha_sigma_rad: float | None = None
    phi_w_sigma_rad: float | None = None
    seconds: float = 0.0

    @property
    def planted(self) -> str:
        """The hypothesis that is true."""
        return self.draw.planted

    @property
    def effect(self) -> float:
        """The larger of the two effects."""
        return max(self.effect_in_plane, self.effect_out_of_plane)

    @property
    def right(self) -> bool:
        """True where the planted mechanism ranks first."""
        return self.first == self.planted

    @property
    def won(self) -> bool:
        """True where the verdict names the planted mechanism."""
        return self.winner == self.planted

    @property
    def wrong(self) -> bool:
        """True where the verdict names a mechanism that was not planted."""
        return self.winner not in (None, NONE, self.planted)


def effect_size(truth: Truth) -> tuple[float, float]:
    """Rms of what is planted in and out of plane over the rms of the whole moment, while it lasts.

    What is planted is the moment with the mechanism less the moment without it at the same state.
    """
    planted = np.hypot(truth.planted_in_plane, truth.planted_out_of_plane)
    if not truth.planted or not np.any(planted):
        return 0.0, 0.0
    lasts = planted > ABSENT * planted.max()
    whole = rms(np.hypot(truth.C_N, truth.C_Z)[lasts])
    return rms(truth.planted_in_plane[lasts]) / whole, rms(truth.planted_out_of_plane[lasts]) / whole


# ---- Planted parameters and what the planted mechanism's own fit makes of them ----


def estimates(planted: Sequence[PlantedConfig], fitted: RankedHypothesis) -> tuple[Estimate, ...]:
    """Each planted parameter beside its estimate, which may be missing."""
    found: list[Estimate] = []
    for entry in planted:
        terms = [term for term in fitted.terms if term.mechanism == entry.mechanism]
        leading = max(terms, key=lambda term: term.f_ratio, default=None)
        of_the_delay = [term for term in terms if leading and term.delay_s == leading.delay_s]
        found += [*_thetas(entry, fitted, leading), *_knots(entry, fitted)]
        found += [*_coefficients(entry, of_the_delay), *_derived(entry, fitted)]
    return tuple(found)


def _thetas(entry: PlantedConfig, fitted: RankedHypothesis, leading: TermEstimate | None) -> Iterator[Estimate]:
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


def fly(study: StudyConfig, draw: Draw) -> Outcome:
    """Simulate the flight and compare on it; what goes wrong is the outcome's reason."""
    begun = clock.perf_counter()
    try:
        flown = simulate(flight_config(study, draw), seed=draw.seed)
    except Exception as error:
        return Outcome(draw=draw, status="not simulated", reason=_reason(error))
    in_plane, out_of_plane = effect_size(flown.truth)
    known: dict[str, Any] = {"draw": draw, "effect_in_plane": in_plane, "effect_out_of_plane": out_of_plane}
    try:
        flight = assemble(corrupted(flown.record, draw)) if draw.fault else flown.flight
        found = compare([flight], study.compare)
    except Exception as error:
        return Outcome(**known, status="not compared", reason=_reason(error))
    faults, verdict, ranking = found.record.faults, found.verdict, found.ranking
    known["faults"] = tuple(f"{fault.channel}: {fault.fault}" for fault in faults)
    known["fault_named"] = planted_faults()[draw.fault].named_by(faults) if draw.fault else None
    known["seconds"] = clock.perf_counter() - begun
    if not ranking:
        return Outcome(**known, status="refused", reason=verdict.reason)
    own = next((row for row in ranking if row.mechanism == draw.planted), None)
    return Outcome(
        **known,
        status="compared",
        first=ranking[0].mechanism,
        winner=verdict.winner,
        equivalent=verdict.equivalent,
        probability=verdict.probability,
        information={row.mechanism: -2.0 * row.log_evidence for row in ranking},
        estimates=() if own is None else estimates(flown.config.mechanisms, own),
        alpha_sigma_rad=found.reconstruction.alpha_rms_sigma_rad,
        phi_w_sigma_rad=found.reconstruction.phi_w_rms_sigma_rad,
    )


def _reason(error: Exception) -> str:
    """A refusal in its own words; a fault with its kind, for it is the program's."""
    return str(error) if isinstance(error, BrvHypoError) else f"fault, {type(error).__name__}: {error}"
