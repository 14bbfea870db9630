"""The result of a prediction; its dump is the contract's JSON."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydantic import Field
from scipy.stats import norm

from brv_hypo.comparison.result import FlightSummary, TermEstimate
from brv_hypo.flight.record import RecordTrial
from brv_hypo.io.text import estimated, known_to, number, p_value
from brv_hypo.io.text import share as percent_of
from brv_hypo.json_result import NullIsNaN, Result
from brv_hypo.model.term import BASELINE
from brv_hypo.results import HasCharts, Row
from brv_hypo.thresholds import NOISE_LEVEL, REFUSED

# Held by `tests.studies.independent.sisters`.
PREDICTED_NEARLY_ALL = 0.995  # share of the samples where the model's flights flew, from which nothing is said of it
PREDICTED_GREATLY = 0.5  # share of the frozen model's mean square, from which letting the record err is worth a word
PREDICTED_SMALL = 4.0  # mean squares of the noise, up to which that of the frozen model needs none
PREDICTED_HOLDS = 0.90  # of the samples within a 95 % band, below which the model errs by more than it said
PREDICTED_DISTINCT = 0.25  # of the noise's mean square, from which a model's residual where it was found is reported


class ModelSource(NullIsNaN):
    """Where the model came from: its file, and the flights that it was found on."""

    path: str | None = Field(description="of its file")
    found_on: tuple[str, ...] = Field(description="titles of the flights")


class ErrorsOfPrediction(NullIsNaN):
    """Mean squares of moment coefficients."""

    without: float = Field(description="of the moments as measured, mean square")
    frozen: float = Field(description="less the frozen model, errors of record and vehicle zero unless refitted")
    within: float = Field(default=float("nan"), description="less the frozen model, these errors fitted")
    own: float = Field(description="less the same model fitted here")
    noise: float = Field(description="of the noise")


class Region(NullIsNaN):
    """A stretch of the record."""

    start_s: float = Field(description="s")
    stop_s: float = Field(description="s")
    mach: tuple[float, float] | None = Field(description="ends; null: unknown")
    ratio: float = Field(description="frozen over without a model")


class LocalChange(NullIsNaN):
    """Where this flight differs from the frozen model; what is off throughout is no change."""

    term: str = Field(description="coefficient that differs for part of the flight")
    units: str = Field(description="of `value`")
    start_s: float = Field(description="s")
    stop_s: float = Field(description="s")
    mach: tuple[float, float] | None = Field(description="ends; null: unknown")
    value: float = Field(description="what the coefficient is more there than before and after")
    std_error: float = Field(description="1 sigma, beside processes")
    f_ratio: float = Field(description="of one coefficient, no processes")
    p_value: float = Field(description="paid for all terms and regions tried")


class Difference(NullIsNaN):
    """A frozen coefficient that differs, others within their errors: this flight's is `frozen` + `value`."""

    term: str = Field(description="coefficient that differs")
    mechanism: str = Field(default="", description="which it belongs to")
    units: str = Field(description="of `value`")
    frozen: float = Field(description="the coefficient in the model file")
    value: float = Field(description="the difference: this flight's coefficient less `frozen`")
    std_error: float = Field(description="1 sigma of the difference: errors of both flights")
    p_value: float = Field(description="paid for all coefficients")
    beside_processes: bool = Field(description="whether evidence needs processes")
    alternatives: tuple[str, ...] = Field(default=(), description="terms that may differ in its place")


Series = tuple[float, ...]


class PredictionBand(NullIsNaN):
    """The predictive band of the moments; record and vehicle err within their tolerances, by what this flight shows."""

    level: float = Field(description="of the prediction interval, noise included")
    inside: float = Field(description="share of the samples in it, where the model's flights flew")
    model_error: float = Field(default=0.0, description="rms residual beyond the noise where the model was found")
    time_s: Series = Field(description="s")
    measured: tuple[Series, Series] = Field(description="C_m and C_n")
    predicted: tuple[Series, Series] = Field(description="by the frozen model, record errors fitted")
    half_width: tuple[Series, Series] = Field(description="of the interval")


class Prediction(HasCharts, Result):
    """What a frozen model says of a flight; `refused`, contradicted, by a sure `local_change` or `difference`."""

    schema_: str = Field(default="brv-hypo/predict/1", alias="schema", description="`brv-hypo/predict/1`")
    flight: FlightSummary = Field(description="predicted")
    model: ModelSource = Field(description="where it came from")
    frozen: tuple[TermEstimate, ...] = Field(description="terms with the model's coefficients")
    refitted: tuple[TermEstimate, ...] = Field(description="terms fitted to this flight")
    error: ErrorsOfPrediction = Field(description="mean squares of moment coefficients")
    ratio: float = Field(description="`frozen` over `without`")
    explained: float = Field(description="share of the mean square, noise aside, where the model's flights flew")
    flown: float = Field(description="share of the samples there")
    band: PredictionBand = Field(description="prediction interval of the moments")
    regions: tuple[Region, ...] = Field(description="ratio by interval of time")
    local_change: LocalChange | None = Field(default=None, description="where slope or damping differs; null: nowhere")
    difference: Difference | None = Field(default=None, description="coefficient that differs most; null: none")
    further_differences: tuple[Difference, ...] = Field(default=(), description="coefficients that differ besides")
    refused: bool = Field(default=False, description="whether the flight contradicts the model (5 %)")
    misfit: float = Field(default=float("nan"), description="rms residual over noise, beside processes; null: no test")
    far_processes: tuple[str, ...] = Field(default=(), description="of moments, far beyond an ordinary size, and times")
    left_out: tuple[str, ...] = Field(default=(), description="mechanisms of certain times of the model's own flights")
    own_record: bool = Field(default=False, description="whether the model was estimated from this record")
    of_own: float = Field(default=0.0, description="share of the record that the model was estimated from")
    reason: str = Field(description="the outcome in words")
    record: RecordTrial = Field(default=RecordTrial(), description="faults of the record")

    @property
    def lacks_an_effect(self) -> bool:
        """Whether something acts that no coefficients of this model explain."""
        return bool(self.far_processes) or self._chance < REFUSED

    @property
    def _chance(self) -> float:
        """That of a misfit as large; NaN without a test."""
        return float(norm.sf((self.misfit - 1.0) / NOISE_LEVEL[1]))

    @property
    def is_contradicted(self) -> bool:
        """Whether coefficients differ, throughout or between two times, or something acts that the model lacks."""
        return self.refused or self.lacks_an_effect

    @property
    def outcome(self) -> str:
        """In a few words, whether the model holds on this flight."""
        if self.own_record:
            return "Prediction of the model's own record"
        if np.isnan(self.misfit):
            return f"Prediction: an extrapolation of the model{self.without}, not tested"
        contradicted = "is contradicted" if self.is_contradicted else "is not contradicted"
        chances = [each.p_value for each in (self.difference, self.local_change) if each is not None]
        least = min(*chances, self._chance, 1.0)
        said = [f"p-value {p_value(least)}"] if least < REFUSED else []
        said += [f"tested on {percent_of(self.flown)}{'' if said else ' of the samples'}"] if self.extrapolates else []
        return f"Prediction: the model{self.without} {contradicted}{' ({})'.format(', '.join(said)) if said else ''}"

    @property
    def brief(self) -> str:
        """For one line: what the model leaves, and what differs most."""
        known = [each for each in (self.difference, self.local_change) if each is not None and each.p_value < REFUSED]
        return "; ".join([self.leaves, *(f"{most.term} differs by {_size(most)}" for most in known[:1])])

    @property
    def leaves(self) -> str:
        """What the frozen model leaves with record errors fitted, beside the noise, both as in the table."""
        own, noise = (
            f"{number(100.0 * each / self.error.without, 2)} %" for each in (self.error.within, self.error.noise)
        )
        left = f"the frozen model{self.without}, record errors fitted, leaves {own}"
        return f"{left} of the moments' mean square, noise alone {noise}"

    @property
    def extrapolates(self) -> bool:
        """Whether samples lie where the model is not known."""
        return self.flown < PREDICTED_NEARLY_ALL

    @property
    def without(self) -> str:
        """What is left out of the model, in words that follow it."""
        return f" without {', '.join(self.left_out)}" if self.left_out else ""

    def headline(self) -> str:
        """The flight, and the ratio of mean squares."""
        return f"{self.flight.title or self.flight.path}: error {self.ratio:.3g} of that without the model"

    def conclusion(self) -> str:
        """The outcome in a few sentences."""
        return self.reason

    def rows(self) -> Sequence[Row]:
        """One row for each region of time."""
        names = "start_s", "stop_s", "mach_from", "mach_to", "ratio"
        known = ((each.start_s, each.stop_s, *(each.mach or (None, None)), each.ratio) for each in self.regions)
        return [dict(zip(names, each, strict=True)) for each in known]


_OWN_RECORD = (
    "The model was estimated from this very record: agreement is that of a fit, not of a prediction, and whether the "
    "flight contradicts the model is not tested. Predict the record of another flight for that. "
)
_AGREES = (
    "This flight does not contradict the model: no coefficient differs, nor slope or damping for a part, by more than "
    "chance (5 %), and beside processes the residual is noise; what these may replace is for `compare` to find."
)
_ITS_ERRORS = "Errors of instruments and vehicle are those that were fitted to it within their tolerances. "


def reason(found: Prediction, own: float, left: float, freed: float, remedy: str) -> str:
    """The outcome in a few sentences. `own` is the share that the same model explains where it is fitted here. Of the
    whole record, as shares of the mean square: what the frozen model leaves (`left`), and what it would if record and
    vehicle erred within their tolerances (`freed`); `remedy` is what `--refit` would name as well for that.
    """
    band, noise, helps = found.band, found.error.noise, ""
    much = found.error.frozen > PREDICTED_SMALL * noise and freed < PREDICTED_GREATLY * left
    if remedy and (much or left > 1.0 or found.explained < 0.0):
        helps = (
            f" Over the whole record its error is {percent_of(left)} of the mean square, errors of record and vehicle "
            f"(trim too) assumed zero, which tests and interval fit; `--refit {remedy}` lets this flight have its own."
        )
    overlap = f" It was estimated from {percent_of(found.of_own)} of this very record, which is not counted."
    own_part = overlap if 0.0 < found.of_own < 1.0 else ""
    if np.isnan(found.misfit) and not found.own_record:
        few = f"Only {percent_of(found.flown)}" if found.flown else "None"
        return (
            f"{few} of the samples lie at Mach numbers and angles of attack that the model was found at: elsewhere it "
            f"is an extrapolation, and whether this flight contradicts it is not tested.{own_part}{helps}"
        )
    said = _OWN_RECORD + ("" if remedy else _ITS_ERRORS) if found.own_record else ""
    partly = found.extrapolates and not found.own_record
    if not found.own_record:
        said += f"{_differs(found).lstrip() if found.is_contradicted else _AGREES} "
    said += f"{found.leaves[0].upper()}{found.leaves[1:]}. "
    said += f"On the {percent_of(found.flown)} of the samples where the model is known, the" if partly else "The"
    fitted = " with what was refitted" if found.refitted or not remedy else ", record errors zero,"
    said += (
        f" frozen model{found.without}{fitted} {_explains(found.explained)} the mean square of the measured moments, "
        "noise aside (static moment and damping alone may make most of it); the same model fitted to this "
        f"flight {_explains(own)} it. The frozen model's {100.0 * band.level:.0f} % prediction interval holds "
        f"{100.0 * band.inside:.1f} % of the samples: no test, as neighbours err alike"
    )
    narrow = band.inside < PREDICTED_HOLDS and not (found.own_record or found.is_contradicted)
    said += f", but below {100.0 * PREDICTED_HOLDS:.0f} % the interval is too narrow here." if narrow else "."
    if band.model_error**2 >= PREDICTED_DISTINCT * noise:
        said += (
            " On held-out blocks of the flights that it was found on its residual was "
            f"{band.model_error:.2g} (rms), {band.model_error / np.sqrt(noise):.1f} times the noise: the prediction "
            "interval includes this."
        )
    beyond = 1.0 - found.flown - found.of_own
    if partly and beyond > 1.0 - PREDICTED_NEARLY_ALL:
        where = "elsewhere in Mach number or angle of attack: an extrapolation, not tested"
        said += f" {percent_of(beyond)} of the samples lie {where}."
    said += own_part + helps
    timed = [each.mechanism for each in found.refitted if each.region_s is not None or each.delay_s is not None]
    if timed:
        said += (
            f" Of {', '.join(dict.fromkeys(timed))} the coefficients alone were fitted to this flight, at the times "
            "and delays of the model: `brv-hypo trace FLIGHT.h5 --model MODEL` fits these too."
        )
    if found.left_out:
        said += (
            f" Left out, as it belongs to times of the model's own flight: {', '.join(found.left_out)}; `--refit "
            f"{','.join(found.left_out)}` fits its size to this flight, at these times."
        )
    return said


def _differs(found: Prediction) -> str:
    """In what this flight contradicts the model."""
    difference, change, said = found.difference, found.local_change, ""
    if found.lacks_an_effect:
        far = ", ".join(found.far_processes)
        still = f"this flight's residual is still {found.misfit:.2g} times the noise"
        still = f"processes are far beyond their ordinary size here ({far} times)" if far else still
        return (
            f" Beside processes and with coefficients of its own, {still}: something acts that the model"
            f"{found.without} lacks; a coefficient that differs may only stand for it. `brv-hypo compare` tells more."
        )
    if difference is not None and difference.p_value < REFUSED:
        every = (difference, *found.further_differences)
        beside = ", processes fitted beside the model" if difference.beside_processes else ""
        these = "; and ".join(map(_in_words, every))
        said = f" This flight contradicts the model (p-value {p_value(difference.p_value)}{beside}): {these}."
    if change is not None:
        ends = dict.fromkeys(f"{end:.4g}" for end in reversed(change.mach or ()))
        mach = f", Mach {' to '.join(ends)}" if ends else ""
        said += (
            f" This flight differs most from the model between {change.start_s:.2f} and {change.stop_s:.2f} s{mach}: "
            f"{change.term} differs there by {_size(change)} from elsewhere "
            f"(F-ratio {change.f_ratio:.0f}). Which mechanism may make that, `brv-hypo compare` on this flight tells."
        )
    return said


def _size(of: Difference | LocalChange) -> str:
    """What a coefficient differs by, with its error and unit."""
    units = "" if of.units == "1" else f" {of.units}"
    return f"{'+' if of.value > 0.0 else ''}{estimated(of.value, of.std_error)}{units}"


def _in_words(difference: Difference) -> str:
    """A coefficient that differs, the function that it is part of, and what may differ in its place."""
    beside = "" if difference.beside_processes else ", without processes"
    own, like = difference.mechanism == BASELINE, difference.alternatives
    static = own and like and all(name.startswith(("C_m0", "C_malpha")) for name in (difference.term, *like))
    others = f" (or {' or '.join(like)} in its place: this flight does not distinguish them)" if like else ""
    there, here = (
        known_to(each, difference.std_error) for each in (difference.frozen, difference.frozen + difference.value)
    )
    return (
        f"{'its static moment is another: ' if static else ''}{difference.term}"
        f"{'' if own else f' ({difference.mechanism})'} is {there} there and here {here}, a difference of "
        f"{_size(difference)} with the other coefficients as there (errors of both flights{beside}; the table's sigma "
        f"is the model's alone, beside processes){others}"
    )


def _explains(share: float) -> str:
    """What a model does to a mean square; one that explains less than nothing does not hold."""
    much = "more than 99.9" if share > 0.9995 else f"{100.0 * share:.1f}"
    return f"explains {much} % of" if share >= 0.0 else f"does not hold here: its error is {1.0 - share:.3g} times"
