"""What `compare` returns; `Comparison.model_dump(by_alias=True)` is the JSON of the contract."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from pydantic import Field

from brv_hypo.flight.record import RecordTrial
from brv_hypo.inference.derivatives import Derivative, Function
from brv_hypo.io.text import below_noise, counted, estimated, hypothesis, number, percent, percents, times
from brv_hypo.json_result import NullIsNaN, Result
from brv_hypo.linearisation.nuisance import beyond_level
from brv_hypo.model.model import SavedColumn
from brv_hypo.results import HasCharts, Row
from brv_hypo.thresholds import FAR_PROCESS, FAR_TOLERANCES, NOISE_LEVEL, NORMAL_95

OTHER = "other"  # what is on no list, beside the names of hypotheses
DAMPING = "C_damping"  # negative: it takes energy out of the motion
BEYOND_NAMED = 3  # of what is beyond its tolerance
_FAR_MORE = 1.5  # times an error that its tolerance draws to nothing: the data alone give far more
Interval = tuple[float, float]
Moments = tuple[tuple[float, ...], tuple[float, ...]]
QUOTED = "quote the other tables, which are fitted with processes"  # in place of a maximum likelihood in trouble
MEAN_SQUARES = "(Mean squares; sizes are rms of all.)"
BUT_MARKED = ", but no value that is marked *"


class TermEstimate(NullIsNaN):
    """One fitted coefficient: value, standard error and partial F-ratio, with its region and delay in s."""

    name: str = Field(description="what the coefficient is of, as `jump in eps`")
    mechanism: str = Field(description="which it belongs to; `baseline`, `record`")
    channel: str = Field(description="plane of its moment: in-plane, out-of-plane, both; of an error the instrument")
    value: float = Field(description="as fitted, in `units`")
    std_error: float = Field(description="1 sigma")
    f_ratio: float = Field(description="of the coefficient alone: (value / std_error)²")
    units: str = Field(description="`1`: dimensionless")
    region_s: Interval | None = Field(default=None, description="when it acts, s; null: throughout")
    delay_s: float | None = Field(default=None, description="by which the moment acts late, s; null: at once")

    @property
    def begins(self) -> str:
        """Its name with the time that it begins at, by which what is nearly collinear with others is known."""
        return self.name + (f" at {self.region_s[0]:.2f} s" if self.region_s else "")


class DerivedEstimate(NullIsNaN):
    """A quantity derived from coefficients of one region, such as phi_b."""

    name: str = Field(description="as `phi_b`, `delay`, `first knot`")
    value: float = Field(description="in `units`")
    std_error: float = Field(description="1 sigma")
    units: str = Field(description="`1`: dimensionless")
    region_s: Interval | None = Field(default=None, description="of which region's coefficients, s; null: of no one's")


class Knot(NullIsNaN):
    """A time at which a coefficient of several flights begins, changes or ends."""

    time_s: float = Field(description="on the reference flight, s")
    mach: float = Field(description="Mach number that all flights share")
    flights_s: tuple[float | None, ...] = Field(description="each flight's own time, s; null: it does not reach it")


class MaximumLikelihood(NullIsNaN):
    """The likelihood fit of one hypothesis."""

    status: str = Field(description="`converged`, or why the fit is not to be quoted")
    iterations: int = Field(description="of Gauss and Newton")
    log_likelihood: float | None = Field(description="natural logarithm, at the maximum")
    terms: tuple[TermEstimate, ...] = Field(default=(), description="coefficients")
    derived: tuple[DerivedEstimate, ...] = Field(default=(), description="delays and knots")
    instrument: tuple[TermEstimate, ...] = Field(default=(), description="errors of the record")
    knots: tuple[Knot, ...] = Field(default=(), description="as in `ranking`")
    seconds: float = Field(default=0.0, description="elapsed, s")
    message: str = Field(default="", description="what the fit says of itself")

    @property
    def trouble(self) -> str:
        """Why it is not to be relied on; empty where it converged from every starting point alike."""
        apart = "starting points disagree" if "Starting points disagree" in self.message else ""
        ended = {"converged": "", "left out": "not run"}.get(self.status, self.status)
        return ", ".join(filter(None, (ended, apart)))


class NetInterval(NullIsNaN):
    """The net values of a hypothesis between two of its knots."""

    start_s: float = Field(description="its first knot, s of the reference flight")
    stop_s: float = Field(description="its last, s")
    values: tuple[TermEstimate, ...] = Field(description="net coefficients: sums of jumps and ramps")
    collinear_groups: tuple[tuple[str, ...], ...] = Field(default=(), description="names of nearly collinear values")

    @property
    def acts(self) -> bool:
        """Whether a value is beyond two standard errors, or may be with one it makes up for; not a direction."""
        known = any(abs(each.value) > 2.0 * each.std_error for each in self.values if each.units != "rad")
        names = {each.name for each in self.values}
        return known or not all(names.issuperset(group) for group in self.collinear_groups)


class RankedHypothesis(NullIsNaN):
    """One hypothesis as fitted and scored."""

    rank: int = Field(description="1: the largest evidence")
    mechanism: str = Field(description="name of the hypothesis; `none`: baseline only")
    f_ratio: float | None = Field(description="of its terms together, no processes; null for `none`")
    cp: float = Field(description="Mallows' C_p, no processes, against the largest model compared")
    prediction_error: float = Field(description="mean square of moment coefficients on held-out blocks")
    prediction_ratio: float = Field(description="`prediction_error` over that of `none`")
    r2: float = Field(description="share of the weighted squares that the fit without processes explains")
    bic: float = Field(description="extended BIC at `n_effective` samples")
    log_likelihood: float = Field(description="at `n_effective` samples, no processes")
    log_evidence: float = Field(default=float("nan"), description="nats over baseline only: weighted, less the price")
    n_terms: int = Field(description="coefficients besides baseline and processes")
    n_effective: float = Field(description="whitened rows of all channels, averaged where noise is white")
    terms: tuple[TermEstimate, ...] = Field(description="jumps and ramps as fitted")
    columns: tuple[SavedColumn, ...] = Field(default=(), description="the same, for `trace --model`")
    intervals: tuple[NetInterval, ...] = Field(default=(), description="net values between knots")
    derived: tuple[DerivedEstimate, ...] = Field(default=(), description="delays, knots, what follows from terms")
    knots: tuple[Knot, ...] = Field(default=(), description="ends of regions by Mach number, if flights share them")
    criteria: dict[str, float] = Field(default_factory=dict, description="of subset selection, by name (page `theory`)")
    status: Literal["ok", "term limit"] = Field(default="ok", description="`term limit`: search came to `max_terms`")
    impossible: str = Field(default="", description="value that no body can have, if any, in the fit without processes")
    notes: tuple[str, ...] = Field(default=(), description="on its fit")
    held_out_gain: float = Field(default=float("nan"), description="nats over baseline only: each twelfth given others")
    held_out_gain_std_error: float = Field(default=float("nan"), description="1 sigma, nats")
    share_of_moment: float = Field(default=float("nan"), description="rms moment beside processes, over the record's")
    share_std_error: float = Field(default=float("nan"), description="1 sigma of `share_of_moment`")
    rms_moment: float = Field(default=float("nan"), description="the same, N m")
    share_beside_processes: float = Field(default=float("nan"), description="of the squares that it and processes make")
    share_of_static: float = Field(default=float("nan"), description="added to the static moment; null: not along it")
    process_shares: dict[str, float] = Field(default={}, description="of the moment; below its sigma: left out")
    ml: MaximumLikelihood | None = Field(default=None, description="fit by maximum likelihood; null: none was made")

    @property
    def size(self) -> str:
        """The rms moment over that of the record, in a sentence; empty where it is not known."""
        share, sigma = self.share_of_moment, self.share_std_error
        if np.isnan(share):
            return ""
        if sigma > share:
            return "Its own moment is not known: processes, or its parts, may cancel it."
        whole, acts = (sum(x.stop_s - x.start_s for x in some) for some in (self.intervals, self.acting))
        more, known = float(np.sqrt(whole / (acts or whole))), np.isfinite(self.rms_moment)
        high = more * (self.rms_moment if known else 100.0 * share)
        then = (
            f" ({estimated(high, high * sigma / share)} while acting)"
            if 0.0 < acts < (1.0 - AT_ITS_ENDS) * whole
            else ""
        )
        part = f"{estimated(100.0 * share, 100.0 * sigma)} % of the record's"
        newtons = estimated(self.rms_moment, self.rms_moment * sigma / share) if known else ""
        made = f"{newtons} N m{then}, {part}" if known else f"{part}{then}"
        said = f"Its rms moment is {made}."
        along = f"{number(100.0 * abs(self.share_of_static), 2)} %"
        does = f"adds {along} to" if self.share_of_static > 0.0 else f"takes away {along} of"
        return said if np.isnan(self.share_of_static) else f"{said} It {does} the static moment."

    @property
    def changes(self) -> list[tuple[DerivedEstimate, DerivedEstimate | None]]:
        """Its knots, each with the width over which what begins or ends there comes on, if any, by time."""
        found: list[tuple[DerivedEstimate, DerivedEstimate | None]] = []
        for each in self.derived:  # a width follows its knot
            if each.name.endswith(KNOT):
                found.append((each, None))
            elif each.name.endswith(WIDTH) and found:
                found[-1] = (found[-1][0], each)
        return sorted(found, key=lambda pair: pair[0].value)

    def middle(self, at: float) -> float:
        """The knot whose gradual change begins or ends at a time (s); else that time."""
        wide = [(abs(abs(at - knot.value) - 0.5 * w.value), knot.value) for knot, w in self.changes if w is not None]
        off, knot = min(wide, default=(np.inf, at))
        return knot if off < SAME_TIME else at

    @property
    def acting(self) -> tuple[NetInterval, ...]:
        """From the first to the last interval in which the mechanism acts, by values not far below its largest."""
        sizes = [{v.name: abs(v.value) for v in each.values if v.units != "rad"} for each in self.intervals]
        most = {name: max(own.get(name, 0.0) for own in sizes) for own in sizes for name in own}
        small = [all(size < REMAINS * most[name] for name, size in own.items()) for own in sizes]
        acts = [each.acts and not few for each, few in zip(self.intervals, small, strict=True)]
        return self.intervals[acts.index(True) : len(acts) - acts[::-1].index(True)] if any(acts) else ()


class FlightSummary(NullIsNaN):
    """The part of a record that was compared."""

    path: str = Field(description="of the record")
    samples: int = Field(description="used")
    start_s: float = Field(description="first sample used, s")
    stop_s: float = Field(description="last, s")
    sample_rate_hz: float = Field(description="Hz")
    gaps_s: tuple[Interval, ...] = Field(default=(), description="begin and end of each gap that is not bridged, s")
    title: str = Field(default="", description="of the record")
    instruments: str = Field(default="", description="grade of the tolerances, and how many are stated")
    vehicle: dict[str, float] = Field(default_factory=dict, description="SI; `inertia`, `inertia_ratio`: tolerances")
    notes: tuple[str, ...] = Field(default=(), description="how the record was read")


class ReconstructionSummary(NullIsNaN):
    """How well the motion is known that a model is linear about."""

    method: str = Field(description="of reconstruction")
    alpha_rms_sigma_rad: float | None = Field(description="rms standard deviation of alpha, rad")
    phi_w_rms_sigma_rad: float | None = Field(description="of the windward meridian, rad")
    moved_rad: float = Field(default=0.0, description="distance from the motion of the instruments alone, rms, rad")
    warnings: tuple[str, ...] = Field(default=(), description="what limits the motion")


class BaselineSummary(NullIsNaN):
    """The terms that are fitted along with every hypothesis, as the likeliest has them."""

    terms: tuple[TermEstimate, ...] = Field(description="of every hypothesis, as fitted by the leader")


class Adequacy(NullIsNaN):
    """Adequate: what the residual has beyond the noise is less than the leader explains, or than the noise; something
    outside the list has no probability of 0.9 or more; and the leader needs no value that no body has.
    """

    ratio: float = Field(description="rms residual of the leader with processes, over the noise's")
    p_value: float = Field(description="of a ratio as large where the stated noise is right; it decides nothing")
    adequate: bool = Field(description="whether the leader is (page `verdict`)")


class Explained(NullIsNaN):
    """Of the mean square that the baseline's fit has as residual: what the leader explains, and what it does not."""

    share: float = Field(description="of the mean square that the baseline leaves, what the leader explains")
    unexplained: float = Field(description="1 - `share`: `processes` + `noise`")
    interval_95: Interval = Field(description="of `share`")
    processes: float = Field(description="what processes explain")
    noise: float = Field(description="noise and lack of fit")


KNOT, WIDTH = " knot", " onset width"  # how names of derived times end
SAME_TIME = 1e-6  # s
REMAINS = 0.1  # of the largest value of a mechanism, below which a value is said to be none; wording alone
AT_ITS_ENDS = 0.02  # share of a record, at its ends: what changes there is there throughout, as far as a reader goes
LEAST_PROCESS = 1e-3  # share of the static moment above which a process is shown


class ProcessEstimate(NullIsNaN):
    """A process beside the leader; `planted` goes under `mechanisms` or `instruments.errors` of a simulation."""

    name: str = Field(description="of the process")
    family: str = Field(description="kind of its cause")
    size: float = Field(description="rms of its moment coefficient; of instruments and air of its splines'")
    std_error: float = Field(description="1 sigma of `size`")
    units: str = Field(description="of `size`, `std_error`, `tolerance`; `1`: a moment coefficient")
    share_of_moment: float = Field(description="over the moment's rms; of instruments and air by their rates")
    tolerance: float = Field(description="an ordinary size")
    planted: dict[str, float] = Field(default_factory=dict, description="estimate, as `simulate` plants it; small: {}")

    @property
    def is_of_moment(self) -> bool:
        """Whether it is a moment, not an error of instruments or air."""
        return self.family in ("stiffness", "rate", "side", "body", "harmonic")

    @property
    def is_shown(self) -> bool:
        """Whether it makes a noticeable part of the moment."""
        return self.share_of_moment > LEAST_PROCESS

    @property
    def sized(self) -> str:
        """Its name with its size over the ordinary one, in words that `times` follows."""
        return f"{self.name} {number(self.size / self.tolerance, 2)}"

    @property
    def is_far(self) -> bool:
        """Whether it is far beyond an ordinary size, and above its sigma; a moment that it makes significant, and
        noticeable. Of errors of instruments an unknown constant is in `std_error`.
        """
        beyond, sigmas = self.size > FAR_PROCESS * self.tolerance, NORMAL_95 if self.is_of_moment else 1.0
        return beyond and self.size > sigmas * self.std_error and (not self.is_of_moment or self.is_shown)


class MechanismLimit(NullIsNaN):
    """How large a mechanism may be, at 95 %; NaN where withheld. Leaders and delays have no `coefficients_95`."""

    mechanism: str = Field(description="name of the hypothesis")
    share_of_moment_95: float = Field(default=float("nan"), description="largest rms over the moment's; null: withheld")
    share_in_part_95: float = Field(default=float("nan"), description="if it does not act throughout; not of leaders")
    coefficient_95: float = Field(default=float("nan"), description="`share_of_moment_95` as an rms moment coefficient")
    coefficients_95: dict[str, float] = Field(default_factory=dict, description="largest by term, a quarter or longer")
    share_of_moment: float = Field(default=float("nan"), description="of the leader, as estimated")
    share_std_error: float = Field(default=float("nan"), description="1 sigma of it")


class RecordError(NullIsNaN):
    """An error of record or vehicle as the leader has it."""

    name: str = Field(description="effect and component; with the flight's number where there are several")
    value: float = Field(description="in `units`, as the leader has it")
    std_error: float = Field(description="1 sigma beside a model that is known")
    units: str = Field(description="`1`: dimensionless")
    tolerance: float = Field(description="1 sigma, as the record or `--instruments` states it")
    without_tolerance: float = Field(default=np.nan, description="value by the data alone; null where they give none")

    @property
    def tolerances(self) -> float:
        """Its value in tolerances."""
        return self.value / self.tolerance

    @property
    def sigmas(self) -> float:
        """Its value over the standard deviation of fitted ones: small where the data hardly determine it."""
        alone = self.value if np.isnan(self.without_tolerance) else self.without_tolerance
        return math.sqrt(max(self.value * alone, 0.0)) / self.tolerance

    @property
    def stated(self) -> str:
        """Its value with units, in words."""
        return f"{number(self.value)}{'' if self.units == '1' else f' {self.units}'}"

    @property
    def in_tolerances(self) -> str:
        """The same and in tolerances; of the data alone where that is far more."""
        if abs(self.without_tolerance) > _FAR_MORE * abs(self.value):
            alone = self.model_copy(update={"value": self.without_tolerance})
            return f"{alone.in_tolerances} by the data alone ({self.stated} with that tolerance)"
        return f"{self.stated}, {abs(self.tolerances):.1f} times its tolerance"


def beyond_tolerances(errors: Sequence[RecordError]) -> list[RecordError]:
    """Those of all a result's errors that exceed what the largest of so many may be."""
    return [each for each in errors if each.sigmas > beyond_level(len(errors))]


def beyond_text(errors: Sequence[RecordError], model: str, outcome: str = "") -> str:
    """The largest of those beside a `model` in a sentence, and what they may be where none is adequate; else empty."""
    poses = ", which may be what the hypotheses lack" if outcome == "none adequate" else ""
    said = [f"{each.name} is {each.in_tolerances}" for each in beyond_tolerances(errors)]
    beside = f"Beside {hypothesis(model)} and processes, errors are"
    return _listed(f"{beside} beyond their tolerances (--instruments){poses}", said)


def within_text(errors: Sequence[RecordError]) -> str:
    """Those that are significant, and no larger than the largest of so many is by chance, in a sentence."""
    beyond, level = beyond_tolerances(errors), beyond_level(len(errors))
    known = [each for each in errors if each not in beyond and abs(each.value) > level * each.std_error]
    said = [f"{e.name} {estimated(e.value, e.std_error)}{'' if e.units == '1' else f' {e.units}'}" for e in known]
    return _listed(f"Errors of the record, significant and within {level:.1f} tolerances, the bound of so many", said)


def _listed(what: str, said: Sequence[str]) -> str:
    more = f", and {len(said) - BEYOND_NAMED} more" if len(said) > BEYOND_NAMED else ""
    return f"{what}: {', '.join(said[:BEYOND_NAMED])}{more}." if said else ""


def far_beyond(errors: Sequence[RecordError]) -> str:
    """The largest, in a clause, where a leader with it is no established cause: beyond `FAR_TOLERANCES`; else empty."""
    far = sorted((e for e in errors if abs(e.tolerances) > FAR_TOLERANCES), key=lambda e: -abs(e.tolerances))
    return "".join(f"{e.name} is {e.in_tolerances}" for e in far[:1])


class SizedModel(NullIsNaN):
    """The best subset of `n_terms` of the leader's terms on the grid of knots and delays (Tables 5.5, 5.7)."""

    n_terms: int = Field(description="of the leader's")
    n_coefficients: int = Field(description="with those of the baseline")
    cp: float = Field(description="Mallows' C_p")
    terms: tuple[str, ...] = Field(description="best subset of that size")


Outcome = Literal["named", "undecided", "none adequate", "record fault"]


class Verdict(NullIsNaN):
    """What the flights say of the hypotheses."""

    winner: str | None = Field(description="hypothesis that is named; null unless `outcome` is `named`")
    outcome: Outcome = Field(description="`named`, `undecided`, `none adequate` or `record fault`")
    described: str | None = Field(default=None, description="if `undecided`: as probable as a name, but no cause")
    equivalent: tuple[str, ...] = Field(description="all hypotheses that may be right")
    probability: dict[str, float] = Field(description="by hypothesis and `other`: sums to 1")
    adequacy: Adequacy | None = Field(default=None, description="of the leader")
    explained: Explained | None = Field(default=None, description="shares of the baseline's residual")
    processes: tuple[ProcessEstimate, ...] = Field(default=(), description="beside the leader, largest first")
    limits: tuple[MechanismLimit, ...] = Field(default=(), description="how large each mechanism may be")
    stability: float | None = Field(default=None, description="share of repetitions with the same outcome and name")
    same_leader: float = Field(default=1.0, description="share of repetitions in which the same hypothesis leads")
    reason: str = Field(description="the outcome in a sentence")


class Seconds(NullIsNaN):
    """Wall-clock time of each stage, s."""

    reconstruct: float = Field(description="of the motion, s")
    select: float = Field(description="of terms, processes and evidence, s")
    ml: float = Field(description="of maximum likelihood, s")
    total: float = Field(description="of all, s")


class MotionHistories(NullIsNaN):
    """Histories for pictures, of one flight: not part of the JSON. `mach` is NaN where it is not known."""

    time_s: tuple[float, ...]
    alpha_rad: tuple[float, ...]
    windward_meridian_rad: tuple[float, ...]
    alpha_sigma_rad: tuple[float, ...]
    windward_meridian_sigma_rad: tuple[float, ...]
    roll_rate_rad_s: tuple[float, ...]
    windward_meridian_rate_rad_s: tuple[float, ...]
    mach: tuple[float, ...]
    dynamic_pressure_pa: tuple[float, ...]
    whitened: dict[str, tuple[float, ...]] = Field(default_factory=dict)
    """Of model and processes, by channel: the residual at unit noise, in axes that do not roll."""


class Series(MotionHistories):
    """What was measured and fitted, of one flight; moments are (C_N', C_Z') over `time_s`. `fitted[mechanism]` includes
    the errors of record and vehicle beside the mechanism, but no process; it and `measured` are NaN at the ends.
    """

    measured: Moments
    sigma: tuple[float, ...]
    fitted: dict[str, Moments]
    channels: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = Field(default_factory=dict)
    """Of the leader with its processes, by name: q, r (rad/s), ay, az (m/s^2) at the c.g., measured and modelled."""
    residuals: dict[str, Moments] = Field(default_factory=dict)
    """Of some hypotheses, the leader among them, with their processes and errors of the record: as `measured`."""
    alone: tuple[Moments, ...] = ()
    """Of the likeliest mechanism: as `measured` less baseline, processes and errors of the record beside it; what it
    makes; and that with the moments of processes. Empty where none was compared.
    """
    histories: dict[str, tuple[tuple[tuple[float, ...], tuple[float, ...]], ...]] = Field(default_factory=dict)
    """Of processes beside the leader, by name, at even times: value and standard error of each shape or channel, in the
    process's units; of moments as the moment coefficient that it makes, by the rms of the shape about there.
    """


class Comparison(HasCharts, Result):
    """The ranking of the hypotheses with its verdict."""

    schema_: str = Field(default="brv-hypo/compare/1", alias="schema", description="`brv-hypo/compare/1`")
    flights: tuple[FlightSummary, ...] = Field(description="that were compared")
    reference_flight: int | None = Field(default=None, description="number (from 1) of the flight whose clock is used")
    reconstruction: ReconstructionSummary = Field(description="of the motion about the leader")
    baseline: BaselineSummary = Field(description="of every hypothesis")
    record: RecordTrial = Field(default=RecordTrial(), description="faults of the records")
    ranking: tuple[RankedHypothesis, ...] = Field(description="hypotheses, largest evidence first")
    verdict: Verdict = Field(description="the answer")
    seconds: Seconds = Field(description="elapsed")
    settings: dict[str, Any] = Field(default_factory=dict, description="other than defaults")
    warnings: tuple[str, ...] = Field(default=(), description="what limits the result")
    disagreements: tuple[str, ...] = Field(default=(), description="where criteria put different hypotheses first")
    record_errors: tuple[RecordError, ...] = Field(default=(), description="of the leader, largest in tolerances first")
    best_by_size: tuple[SizedModel, ...] = Field(default=(), description="best of the leader's terms, by their number")
    collinear: tuple[str, ...] = Field(default=(), description="pairs of coefficients: correlation (inflations)")
    collinear_groups: tuple[tuple[str, ...], ...] = Field(default=(), description="names that these pairs link")
    functions: dict[Function, tuple[Derivative, ...]] = Field(default_factory=dict, description="along each flight")
    series: tuple[Series, ...] = Field(default=(), exclude=True)

    @property
    def quoted(self) -> str:
        """What to quote in place of a maximum likelihood in trouble: no value that is nearly collinear with others."""
        groups = [self.collinear_groups, *(each.collinear_groups for row in self.ranking[:1] for each in row.intervals)]
        return f"{QUOTED}{BUT_MARKED if any(groups) else ''}"

    def named(self) -> str:
        """What the verdict names, or that a mechanism describes the moments and is no cause; else the outcome."""
        verdict = self.verdict
        if verdict.described is not None:
            return f"{verdict.outcome}; {verdict.described} describes the moments, no established cause"
        return verdict.outcome if verdict.winner is None else hypothesis(verdict.winner)

    def mach_at(self, time_s: float) -> float:
        """The Mach number at a time (s) of the reference flight, from JSON by places; NaN where it is not known."""
        for known in (self.series or self.functions.get("C_m0", ()))[(self.reference_flight or 1) - 1 :]:
            return float(np.interp(time_s, known.time_s, known.mach))
        return float("nan")

    def headline(self) -> str:
        """Flights, outcome, and what the verdict names."""
        verdict, found = self.verdict, self.verdict.explained
        names, best = ", ".join(map(hypothesis, verdict.equivalent)), verdict.winner or verdict.described
        headline = self.named() if verdict.described else verdict.outcome + (f" ({names})" if names else "")
        headline = f"{verdict.outcome} {self.named()}" if verdict.winner else headline
        explains = f" (explains {percent(found.share)} %)" if best and found and found.share else ""
        count = "1 flight" if len(self.flights) == 1 else f"{len(self.flights)} flights"
        return f"{count}, {len(self.ranking)} hypotheses: {headline}{explains}"

    def conclusion(self) -> str:
        """The reason of the verdict; on lines of their own shares of the baseline's residual, and what limits it."""
        lines = [" ".join(filter(None, (self.verdict.reason, self._when())))]
        if self.verdict.winner is None and self.reconstruction.warnings:
            lines.append(f"What limits the motion: {self.reconstruction.warnings[0]}.")
        found, fits = self.verdict.explained, self.verdict.adequacy
        if found is not None:
            low, high = found.interval_95
            digits = 2 if found.share and high - low < 0.01 else 0
            share, processes, rest = percents((found.share, found.processes, found.noise), digits)
            known = f"{share} % ({100.0 * low:.{digits}f} to {100.0 * high:.{digits}f} %), "
            leader = f"{self.ranking[0].mechanism} {known}" if found.share else ""
            noise = "noise" if fits is None or fits.ratio < 1.0 + NOISE_LEVEL[1] else "noise and lack of fit"
            shares = f"{leader}processes {processes} %, {noise} {rest} %"
            lines.append(f"Of the residual of the baseline: {shares}{f'. {MEAN_SQUARES}' if leader else '.'}")
        if fits is not None:
            within = f"The leader's residual is {fits.ratio:.2f} times the noise (rms){below_noise(fits.ratio)}"
            of_leader = self.verdict.outcome == "undecided"
            stable = self.verdict.same_leader if of_leader else self.verdict.stability
            same = {"undecided": "give the same leader", "none adequate": "find none adequate either"}
            found_again = f"the repetitions {same.get(self.verdict.outcome, 'give the same answer')}"
            lines.append(f"{within}{'' if stable is None else f'; {100.0 * stable:.0f} % of {found_again}'}.")
        lines.append(self._gaps())
        leader = self.ranking[0].mechanism if self.ranking else ""
        lines.append(beyond_text(self.record_errors, leader, self.verdict.outcome))
        lines.append(self._far_processes())
        if self.ranking and (fit := self.ranking[0].ml) is not None and fit.trouble:
            name = hypothesis(self.ranking[0].mechanism)
            lines.append(f"Maximum likelihood of {name}: {fit.trouble}: {self.quoted}.")
        return "\n".join(filter(None, lines))

    def _gaps(self) -> str:
        """How many gaps the record has, how long, and what they do to the answer, in a sentence; empty without any."""
        gaps = [gap for flight in self.flights for gap in flight.gaps_s]
        if not gaps:
            return ""
        lasts, first = max((stop - start, start) for start, stop in gaps)
        lost, whole = (
            sum(stop - start for start, stop in some)
            for some in (gaps, ((each.start_s, each.stop_s) for each in self.flights))
        )
        acts = self.ranking[0].acting if self.ranking else ()
        ends = {end for each in acts for end in (each.start_s, each.stop_s)}
        near = any(2.0 * start - stop < end < 2.0 * stop - start for start, stop in gaps for end in ends)
        return (
            f"{counted(len(gaps), 'gap')}, {number(lost, 2)} s or {percent(lost / whole)} % in all, the longest "
            f"{number(lasts, 2)} s from {times(first)}: errors include what the vehicle may have done there (gap_turn"
            f"){'; a change of the leader is dated to within one' if near else ''}."
        )

    def _far_processes(self) -> str:
        """Processes far beyond an ordinary size, but for those in the reason, in a sentence: what they may be."""
        advice = {True: "the model lacks something of its kind", False: "check its channels, their units and place"}
        far = [each for each in self.verdict.processes if each.is_far and each.name not in self.verdict.reason]
        sizes = ", ".join(f"{each.sized} times ({advice[each.is_of_moment]})" for each in far)
        return f"Far beyond an ordinary size: {sizes}." if far else ""

    def _damps(self, net: TermEstimate) -> str:
        """What a damping moment does, in the baseline's C_mq, to which it is added in plane."""
        damps = ", which adds damping" if net.value < 0.0 else ", which takes damping away"
        base = next((term for term in self.baseline.terms if term.name == "C_mq"), None)
        if base is None or base.value > -2.0 * base.std_error:
            return damps
        return f"{damps}: C_mq is {base.value + net.value:.3g} with it, {base.value:.3g} without"

    def _when(self) -> str:
        """From when to when the mechanism that the verdict names, or describes, acts, and at which Mach numbers."""
        leader, best = self.ranking[0] if self.ranking else None, self.verdict.winner or self.verdict.described
        if leader is None or leader.mechanism != best or not (acts := leader.acting):
            return ""
        ends, size = tuple(map(leader.middle, (acts[0].start_s, acts[-1].stop_s))), ""
        if len(acts) == 1 and len(acts[0].values) == 1 and not acts[0].collinear_groups:
            (net,) = acts[0].values
            unit = "" if net.units == "1" else f" {net.units}"
            sign = self._damps(net) if net.name == DAMPING else ""
            size = f" {net.name} is {estimated(net.value, net.std_error)}{unit}{sign}."
        size += f" {leader.size}" if leader.size else ""
        machs = " to ".join(number(self.mach_at(end)) for end in ends)
        if self.reference_flight is not None:
            return f"{best} acts from Mach {machs}, on each flight at its own times.{size}"
        first, last = leader.intervals[0].start_s, leader.intervals[-1].stop_s
        begins, ended = ends[0] - first < AT_ITS_ENDS * (last - first), last - ends[1] < AT_ITS_ENDS * (last - first)
        if begins and ended:
            return f"{best} acts throughout the record.{size}"
        wide = [width.value for knot, width in leader.changes if width is not None and knot.value == ends[0]]
        over = "".join(f"; it comes on over {number(width, 2)} s" for width in wide[:1])
        # What is at an end of the record is no event.
        beyond = ", and perhaps before the record" * begins + ", and perhaps after the record" * ended
        known = "" if np.isnan(self.mach_at(ends[0])) else f" (Mach {machs})"
        return f"{best} acts from {times(*ends)}{known}{beyond}{over}.{size}"

    def rows(self) -> Sequence[Row]:
        """One row for each hypothesis, by rank, and last `other`, which has a probability alone.

        `mechanism` as on the page: "baseline only" is `none` of JSON and `ranking`. `probability` sums to 1 over all
        rows. `log_evidence` to `log_likelihood`: as in `ranking`. `share_of_moment_95`: of `limits`.
        """
        probability = self.verdict.probability
        limits = {limit.mechanism: limit.share_of_moment_95 for limit in self.verdict.limits}
        criteria = ("log_evidence", "n_terms", "f_ratio", "cp", "prediction_error", "prediction_ratio", "r2", "bic")
        rows: list[dict[str, Any]] = [
            {
                "rank": row.rank,
                "mechanism": hypothesis(row.mechanism),
                "probability": probability.get(row.mechanism),
                **{name: getattr(row, name) for name in (*criteria, "log_likelihood")},
                "share_of_moment_95": limits.get(row.mechanism),
            }
            for row in self.ranking
        ]
        if OTHER in probability:
            rows.append(dict.fromkeys(rows[0]) | {"mechanism": OTHER, "probability": probability[OTHER]})
        return rows
