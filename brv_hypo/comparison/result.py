"""What `compare` returns; `Comparison.model_dump(by_alias=True)` is the JSON of the contract."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
from pydantic import Field

from brv_hypo.flight.record import RecordTrial
from brv_hypo.inference.derivatives import Derivative, Function
from brv_hypo.io.text import estimated, hypothesis, number, percent, times
from brv_hypo.json_result import NullIsNaN, Result
from brv_hypo.linearisation.nuisance import beyond_level
from brv_hypo.results import HasCharts, Row
from brv_hypo.thresholds import FAR_PROCESS, FAR_TOLERANCES, NOISE_LEVEL, NORMAL_95

DAMPING = "C_damping"  # negative: it takes energy out of the motion
BEYOND_NAMED = 3  # of what is beyond its tolerance
_FAR_MORE = 1.5  # times an error that its tolerance draws to nothing: the data alone give far more
Interval = tuple[float, float]
Moments = tuple[tuple[float, ...], tuple[float, ...]]
QUOTED = "quote the other tables, which are fitted with processes"
"""In place of a maximum likelihood in trouble."""
BUT_MARKED = ", but no value that is marked *"


class TermEstimate(NullIsNaN):
    """One fitted coefficient: value, standard error and partial F-ratio, with its region and delay in s."""

    name: str
    mechanism: str
    channel: str
    value: float
    std_error: float
    f_ratio: float
    units: str
    region_s: Interval | None = None
    delay_s: float | None = None


class DerivedEstimate(NullIsNaN):
    """A quantity derived from coefficients of one region, such as phi_b."""

    name: str
    value: float
    std_error: float
    units: str
    region_s: Interval | None = None


class Knot(NullIsNaN):
    """A time at which a coefficient of several flights begins, changes or ends. `time_s` is in the time of the
    reference flight; `flights_s` are all flights' own times at the same `mach` number, None for a flight that does not
    come by it.
    """

    time_s: float
    mach: float
    flights_s: tuple[float | None, ...]


class MaximumLikelihood(NullIsNaN):
    """The likelihood fit of one hypothesis; `derived` holds delays and knots, `instrument` the instrument errors.
    `knots`: as those of `RankedHypothesis`.
    """

    status: str
    iterations: int
    log_likelihood: float | None
    terms: tuple[TermEstimate, ...] = ()
    derived: tuple[DerivedEstimate, ...] = ()
    instrument: tuple[TermEstimate, ...] = ()
    knots: tuple[Knot, ...] = ()
    seconds: float = 0.0
    message: str = ""

    @property
    def trouble(self) -> str:
        """Why it is not to be relied on; empty where it converged from every starting point alike."""
        apart = "starting points disagree" if "Starting points disagree" in self.message else ""
        ended = {"converged": "", "left out": "not run"}.get(self.status, self.status)
        return ", ".join(filter(None, (ended, apart)))


class NetInterval(NullIsNaN):
    """The net values of a hypothesis between two of its knots (s, of the reference flight). `collinear_groups`: names
    of values that are nearly collinear with each other.
    """

    start_s: float
    stop_s: float
    values: tuple[TermEstimate, ...]
    collinear_groups: tuple[tuple[str, ...], ...] = ()

    @property
    def acts(self) -> bool:
        """Whether a value is more than two standard errors, or makes up for a delay, together with which it may be;
        not a direction, which has one at any size.
        """
        known = any(abs(each.value) > 2.0 * each.std_error for each in self.values if each.units != "rad")
        names = {each.name for each in self.values}
        return known or not all(names.issuperset(group) for group in self.collinear_groups)


class RankedHypothesis(NullIsNaN):
    """One hypothesis as fitted and scored. `f_ratio` is of the mechanism's terms together against the baseline (None
    for `none`), `cp` Mallows' C_p against the largest model compared, `prediction_error` the mean square error of the
    moment coefficients on held-out blocks, `prediction_ratio` that error over the error of `none`; `bic` (extended) and
    `log_likelihood` are at `n_effective` samples: the whitened rows of all channels, averaged where noise is white, as
    independent as whitening makes them; what it does not reach lowers the weight of evidence instead. `criteria`: the
    seven of 3.3.2 and the usual others. `knots` are the ends of the regions of `terms` by Mach number, where flights
    share them by it; empty elsewhere.
    """

    rank: int
    mechanism: str
    f_ratio: float | None
    cp: float
    prediction_error: float
    prediction_ratio: float
    r2: float
    bic: float
    log_likelihood: float
    log_evidence: float = float("nan")
    """Over that of the baseline only, processes beside both, weighted, less the price of what acts."""
    n_terms: int
    n_effective: float
    terms: tuple[TermEstimate, ...]
    intervals: tuple[NetInterval, ...] = ()
    derived: tuple[DerivedEstimate, ...] = ()
    knots: tuple[Knot, ...] = ()
    criteria: dict[str, float] = Field(default_factory=dict)
    status: Literal["ok", "term limit"] = "ok"
    impossible: str = ""
    """Which value no body can have, if any, the fit without processes has, of which F-ratio, C_p and errors are."""
    notes: tuple[str, ...] = ()
    held_out_gain: float = float("nan")
    """ln of the predictive density of each stretch of time given the others, over the baseline only's; weighted."""
    held_out_gain_std_error: float = float("nan")
    share_of_moment: float = float("nan")
    """The rms moment of its terms beside processes, over the record's, with its standard error."""
    share_std_error: float = float("nan")
    share_beside_processes: float = float("nan")
    """Of the squares that its terms and processes make: errors are by its root larger than the likelihood's."""
    ml: MaximumLikelihood | None = None

    @property
    def size(self) -> str:
        """The rms moment over that of the record, in a sentence; empty where it is not known."""
        share = estimated(100.0 * self.share_of_moment, 100.0 * self.share_std_error)
        return "" if np.isnan(self.share_of_moment) else f"Its rms moment is {share} % of the record's."

    @property
    def acting(self) -> tuple[NetInterval, ...]:
        """From the first to the last interval in which the mechanism acts."""
        acts = [each.acts for each in self.intervals]
        return self.intervals[acts.index(True) : len(acts) - acts[::-1].index(True)] if any(acts) else ()


class FlightSummary(NullIsNaN):
    """The part of a record that was compared."""

    path: str
    samples: int
    start_s: float
    stop_s: float
    sample_rate_hz: float
    title: str = ""
    instruments: str = ""
    """The grade of the tolerances, and how many are stated."""
    vehicle: dict[str, float] = Field(default_factory=dict)
    """Mass, inertias, reference length and area, SI; `inertia` and `inertia_ratio` are relative tolerances."""
    notes: tuple[str, ...] = ()


class ReconstructionSummary(NullIsNaN):
    """How well the motion is known that a model is linear about. `moved_rad`: how far it is from that of the
    instruments alone, 1 sigma in any direction (rms), which the standard deviations include.
    """

    method: str
    alpha_rms_sigma_rad: float | None
    phi_w_rms_sigma_rad: float | None
    moved_rad: float = 0.0
    warnings: tuple[str, ...] = ()


class BaselineSummary(NullIsNaN):
    """The terms that are fitted along with every hypothesis, as the likeliest has them."""

    terms: tuple[TermEstimate, ...]


class Adequacy(NullIsNaN):
    """`ratio`: rms residual of the leader, beside all processes and errors within tolerances, over the record's noise.
    `p_value`: probability of so large a ratio where the record states its noise well; it decides nothing. `adequate`:
    what the residual has beyond the noise is less than the leader explains, or than the noise; something outside the
    list has no probability of 0.9 or more; and the leader needs no value that no body has.
    """

    ratio: float
    p_value: float
    adequate: bool


class Explained(NullIsNaN):
    """Of the mean square that the baseline's fit has as residual: what the leader explains, and what it does not.
    `share` + `unexplained` is 1: what the leader does not explain is due to `processes` and `noise`. `interval_95` of
    the share.
    """

    share: float
    unexplained: float
    interval_95: Interval
    processes: float
    noise: float


LEAST_PROCESS = 1e-3  # share of the static moment above which a process is shown


class ProcessEstimate(NullIsNaN):
    """A process beside the leader: rms `size` with its standard error, in `units`. `size`: the rms of the moment
    coefficient that it makes, of instruments and air that of its splines' coefficients. `share_of_moment`: that over
    the moment's rms, of instruments and air by the rates that they make. `tolerance`: one unit of its amplitude, an
    ordinary size, in `units`. `planted`: of the first flight, the coefficients by which a simulation plants it again,
    under `mechanisms` or `instruments.errors`; empty of one below `LEAST_PROCESS`.
    """

    name: str
    family: str
    size: float
    std_error: float
    units: str
    share_of_moment: float
    tolerance: float
    planted: dict[str, float] = Field(default_factory=dict)

    @property
    def is_of_moment(self) -> bool:
        """Whether it is a moment, not an error of instruments or air."""
        return self.family in ("stiffness", "rate", "side", "body", "harmonic")

    @property
    def is_far(self) -> bool:
        """Whether it is significant and far beyond an ordinary size."""
        least = max(NORMAL_95 * self.std_error, FAR_PROCESS * self.tolerance)
        return self.size > least and self.share_of_moment > LEAST_PROCESS


class MechanismLimit(NullIsNaN):
    """The largest share of the moment's rms that a mechanism may have, at 95 %, and that as an rms moment coefficient;
    `share_in_part_95` where it does not act throughout, as trim and the baseline do (NaN of the leader). NaN where
    nothing is adequate, or the record says nothing of the mechanism's size. `coefficients_95`: by term the largest size
    of its coefficient if the mechanism acts for a quarter of the record or longer beside the leader, not always; empty
    of the leader, and of mechanisms with a delay. `share_of_moment`: that of the leader as estimated, with its standard
    error; NaN of others.
    """

    mechanism: str
    share_of_moment_95: float = float("nan")
    share_in_part_95: float = float("nan")
    coefficient_95: float = float("nan")
    coefficients_95: dict[str, float] = Field(default_factory=dict)
    share_of_moment: float = float("nan")
    share_std_error: float = float("nan")


class RecordError(NullIsNaN):
    """An error of record or vehicle as the leader has it, with its 1-sigma `tolerance`. `std_error`: beside a model
    that is known. The `name` has the flight's number where there are several.
    """

    name: str
    value: float
    std_error: float
    units: str
    tolerance: float
    without_tolerance: float = Field(default=np.nan, description="value by the data alone; null where they give none")

    @property
    def tolerances(self) -> float:
        """Its value in tolerances."""
        return self.value / self.tolerance

    @property
    def sigmas(self) -> float:
        """Its value over the standard deviation of fitted values where the tolerance is right: what the data hardly
        determine is fitted near nothing, however large it is.
        """
        alone = self.value if np.isnan(self.without_tolerance) else self.without_tolerance
        return math.sqrt(max(self.value * alone, 0.0)) / self.tolerance

    @property
    def stated(self) -> str:
        """Its value with units, in words."""
        return f"{number(self.value)}{'' if self.units == '1' else f' {self.units}'}"

    @property
    def in_tolerances(self) -> str:
        """Its value in tolerances, and by the data alone where that is far more, in words."""
        alone, more = self.without_tolerance, abs(self.without_tolerance) > _FAR_MORE * abs(self.value)
        by_data = f"; by the data alone {number(alone)}, {abs(alone) / self.tolerance:.0f} times" if more else ""
        return f"{abs(self.tolerances):.1f} times its tolerance{by_data}"


def beyond_tolerances(errors: Sequence[RecordError]) -> list[RecordError]:
    """Those of all a result's errors that exceed what the largest of so many may be."""
    return [each for each in errors if each.sigmas > beyond_level(len(errors))]


def beyond_text(errors: Sequence[RecordError], model: str, outcome: str = "") -> str:
    """The largest of those beside a `model` in a sentence, and what they may be where none is adequate; else empty."""
    poses = ", which may be what the hypotheses lack" if outcome == "none adequate" else ""
    said = [f"{each.name} {each.stated} ({each.in_tolerances})" for each in beyond_tolerances(errors)]
    beside = f"Beside {hypothesis(model)} and processes, errors are"
    return _listed(f"{beside} beyond their tolerances (--instruments){poses}", said)


def within_text(errors: Sequence[RecordError]) -> str:
    """Those that are significant, and no larger than the largest of so many is by chance, in a sentence."""
    beyond, level = beyond_tolerances(errors), beyond_level(len(errors))
    known = [each for each in errors if each not in beyond and abs(each.value) > level * each.std_error]
    said = [f"{e.name} {estimated(e.value, e.std_error)}{'' if e.units == '1' else f' {e.units}'}" for e in known]
    return _listed("Errors of the record, significant and within their tolerances", said)


def _listed(what: str, said: Sequence[str]) -> str:
    more = f", and {len(said) - BEYOND_NAMED} more" if len(said) > BEYOND_NAMED else ""
    return f"{what}: {', '.join(said[:BEYOND_NAMED])}{more}." if said else ""


def far_beyond(errors: Sequence[RecordError]) -> str:
    """The largest, in a clause, where a leader with it is no established cause: beyond `FAR_TOLERANCES`; else empty."""
    far = sorted((e for e in errors if abs(e.tolerances) > FAR_TOLERANCES), key=lambda e: -abs(e.tolerances))
    return "".join(f"{e.name} is {e.stated}, {e.in_tolerances}" for e in far[:1])


class SizedModel(NullIsNaN):
    """The best subset of `n_terms` of the leader's terms on the grid of knots and delays (Tables 5.5, 5.7)."""

    n_terms: int
    n_coefficients: int
    cp: float
    terms: tuple[str, ...]


Outcome = Literal["named", "undecided", "none adequate", "record fault"]


class Verdict(NullIsNaN):
    """`winner` is None unless the `outcome` is "named"; `equivalent` has all that may be right. `described`: of an
    undecided outcome, the mechanism that is as probable as a name, and is no established cause.
    """

    winner: str | None
    outcome: Outcome
    described: str | None = None
    equivalent: tuple[str, ...]
    probability: dict[str, float]
    adequacy: Adequacy | None = None
    explained: Explained | None = None
    processes: tuple[ProcessEstimate, ...] = ()
    """Largest first."""
    limits: tuple[MechanismLimit, ...] = ()
    stability: float | None = None
    same_leader: float = 1.0
    """Share of the repetitions in which the same hypothesis leads, whatever the outcome."""
    reason: str


class Seconds(NullIsNaN):
    """Wall-clock time of each stage, s."""

    reconstruct: float
    select: float
    ml: float
    total: float


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
    the errors of record and vehicle beside the mechanism, but no process; it and `measured` are NaN at the ends, where
    rates cannot be differentiated.
    """

    measured: Moments
    sigma: tuple[float, ...]
    fitted: dict[str, Moments]
    channels: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = Field(default_factory=dict)
    """Of the leader with its processes, by name: q, r (rad/s), ay, az (m/s^2) at the c.g. as measured and as modelled.
    """
    residuals: dict[str, Moments] = Field(default_factory=dict)
    """Of some hypotheses, the leader among them, with their processes and errors of the record: as `measured`, less all
    that is estimated.
    """
    alone: tuple[Moments, ...] = ()
    """Of the likeliest mechanism: as `measured` less baseline, processes and errors of the record beside it; what it
    makes; and that with the moments of processes. Empty where none was compared.
    """
    histories: dict[str, tuple[tuple[tuple[float, ...], tuple[float, ...]], ...]] = Field(default_factory=dict)
    """Of processes beside the leader, by name, at even times: value and standard error of each shape or channel, in the
    process's units; of moments as the moment coefficient that it makes, by the rms of the shape about there.
    """


class Comparison(HasCharts, Result):
    """The ranking of the hypotheses with its verdict. `reference_flight`: number (from 1) of the one of several flights
    in whose time regions and knots are given; None for one flight, and where all have the same clock. The `flight` of
    `functions` counts from 0. `disagreements` say where criteria put different hypotheses first.
    """

    schema_: str = Field(default="brv-hypo/compare/1", alias="schema")
    flights: tuple[FlightSummary, ...]
    reference_flight: int | None = None
    reconstruction: ReconstructionSummary
    baseline: BaselineSummary
    record: RecordTrial = RecordTrial()
    ranking: tuple[RankedHypothesis, ...]
    verdict: Verdict
    seconds: Seconds
    warnings: tuple[str, ...] = ()
    disagreements: tuple[str, ...] = ()
    record_errors: tuple[RecordError, ...] = ()
    """The largest in tolerances first."""
    best_by_size: tuple[SizedModel, ...] = ()
    collinear: tuple[str, ...] = ()
    """Pairs of the leader's coefficients that are not to be read by themselves: correlation (variance inflations)."""
    collinear_groups: tuple[tuple[str, ...], ...] = ()
    """Those that these pairs link together."""
    functions: dict[Function, tuple[Derivative, ...]] = Field(default_factory=dict)
    """Of each flight, the leader and processes together: C_m,in, and its derivatives by alpha and pitch rate."""
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
        found, fits = self.verdict.explained, self.verdict.adequacy
        if found is not None:
            share, low, high = map(percent, (found.share, *found.interval_95))
            leader = f"{self.ranking[0].mechanism} {share} % ({low} to {high} %), " if found.share else ""
            noise = "noise" if fits is None or fits.ratio < 1.0 + NOISE_LEVEL[1] else "noise and lack of fit"
            rest = f"processes {percent(found.processes)} %, {noise} {percent(found.noise)} %"
            lines.append(f"Of the residual of the baseline: {leader}{rest}.")
        if fits is not None:
            within = f"The leader's residual is {fits.ratio:.2f} times the noise (rms)"
            of_answer, of_leader = (self.verdict.stability, "answer"), (self.verdict.same_leader, "leader")
            stable, answer = of_leader if self.verdict.outcome == "undecided" else of_answer
            repeated = "" if stable is None else f"; {100.0 * stable:.0f} % of the repetitions give the same {answer}"
            lines.append(f"{within}{repeated}.")
        leader = self.ranking[0].mechanism if self.ranking else ""
        lines.append(beyond_text(self.record_errors, leader, self.verdict.outcome))
        lines += self._far_processes()
        if self.ranking and (fit := self.ranking[0].ml) is not None and fit.trouble:
            lines.append(
                f"Maximum likelihood of {hypothesis(self.ranking[0].mechanism)}: {fit.trouble}: {self.quoted}."
            )
        return "\n".join(filter(None, lines))

    def _far_processes(self) -> list[str]:
        """Processes far beyond an ordinary size, but for those in the reason, in sentences: what they may be."""
        far = [each for each in self.verdict.processes if each.is_far and each.name not in self.verdict.reason]
        kinds = {True: "the model lacks something of their kind", False: "check these channels"}
        said = []
        for of_moment, advice in kinds.items():
            own = [each for each in far if each.is_of_moment is of_moment]
            sizes = ", ".join(f"{each.name} {number(each.size / each.tolerance, 2)} times" for each in own)
            said += [f"Far beyond an ordinary size: {sizes}: {advice}."] if own else []
        return said

    def _when(self) -> str:
        """From when to when the mechanism that the verdict names, or describes, acts, and at which Mach numbers."""
        leader, best = self.ranking[0] if self.ranking else None, self.verdict.winner or self.verdict.described
        if leader is None or leader.mechanism != best or not (acts := leader.acting):
            return ""
        ends, size = (acts[0].start_s, acts[-1].stop_s), ""
        if len(acts) == 1 and len(acts[0].values) == 1 and not acts[0].collinear_groups:
            (net,) = acts[0].values
            damps = ", which adds damping" if net.value < 0.0 else ", which takes damping away"
            sign = damps if net.name == DAMPING else ""
            size = f" {net.name} is {estimated(net.value, net.std_error)}{sign}."
        size += f" {leader.size}" if leader.size else ""
        machs = " to ".join(number(self.mach_at(end)) for end in ends)
        if self.reference_flight is not None:
            return f"{best} acts from Mach {machs}, on each flight at its own times.{size}"
        if ends == (leader.intervals[0].start_s, leader.intervals[-1].stop_s):
            return f"{best} acts throughout the record.{size}"
        known = "" if np.isnan(self.mach_at(ends[0])) else f" (Mach {machs})"
        return f"{best} acts from {times(*ends)}{known}.{size}"

    def rows(self) -> Sequence[Row]:
        """One row for each hypothesis, likeliest first, with its criteria and probability."""
        probability = self.verdict.probability
        limits = {limit.mechanism: limit.share_of_moment_95 for limit in self.verdict.limits}
        criteria = ("log_evidence", "n_terms", "f_ratio", "cp", "prediction_error", "prediction_ratio", "r2", "bic")
        return [
            {
                "rank": row.rank,
                "mechanism": row.mechanism,
                "probability": probability.get(row.mechanism),
                **{name: getattr(row, name) for name in (*criteria, "log_likelihood")},
                "share_of_moment_95": limits.get(row.mechanism),
            }
            for row in self.ranking
        ]
