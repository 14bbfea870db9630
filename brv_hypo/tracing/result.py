"""Settings of a trace, and its result; its dump is the contract's JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, TypedDict

from pydantic import BaseModel, ConfigDict, Field

from brv_hypo.comparison import result
from brv_hypo.comparison.result import FlightSummary, Interval, MotionHistories, RecordError, TermEstimate
from brv_hypo.flight.record import RecordTrial
from brv_hypo.inference.derivatives import Derivative
from brv_hypo.io.text import below_noise, interval, number, p_value
from brv_hypo.json_result import NullIsNaN, Result
from brv_hypo.mechanisms.yaml_mechanism import MechanismFile
from brv_hypo.model.aero_table import AeroTable
from brv_hypo.model.model import SavedColumn, SavedModel
from brv_hypo.model.term import BASELINE
from brv_hypo.motion.methods import Method
from brv_hypo.results import HasCharts, Row

WHITE_CHANCE = 0.05  # p-value above which what is left is called white; convention
TRACED_SMALLEST = 120  # samples from which a record is enough to hold any out
Baseline = Literal["scheduled", "constant"]


class TraceConfig(BaseModel):
    """Settings of `trace`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    start: str | SavedModel = Field(default="none", description="A hypothesis as in `compare`, or a model of a trace.")
    columns: tuple[SavedColumn, ...] = Field(default=(), description="Of that hypothesis, as compared; else searched.")
    baseline: Baseline = Field(
        default="scheduled",
        description='Whether the stiffness that it starts from follows Mach and Reynolds number ("scheduled"), or is '
        "constant, so that such a change is for the loop to find.",
    )
    aero: AeroTable | None = Field(default=None, description="Slopes in the baseline's place, known to uncertainties.")
    effects: tuple[str, ...] | None = Field(default=None, description="The effects to try; None tries all installed.")
    discover: bool = Field(default=True, description="Whether the dictionary of generic terms is searched too.")
    method: Method = Field(default="joint", description="Of reconstruction, as in `reconstruct`.")
    blocks: int = Field(default=32, ge=16, le=200, description="Of time; every fourth decides, every eighth reports.")
    max_steps: int = Field(default=8, ge=1, le=30, description="Effects that may be added.")
    significance: float = Field(default=0.01, gt=0.0, lt=0.5, description="Largest adjusted p-value of an effect.")
    knot_count: int = Field(default=7, ge=0, le=40, description="As in `compare`.")
    max_terms: int = Field(default=4, ge=1, le=20, description="As in `compare`.")


TraceSettings = TypedDict("TraceSettings", {  # noqa: UP013
    "start": str | SavedModel, "columns": Sequence[SavedColumn], "baseline": Baseline, "aero": AeroTable | None,
    "effects": Sequence[str] | None, "discover": bool, "method": str, "blocks": int, "max_steps": int,
    "significance": float, "knot_count": int, "max_terms": int,
}, total=False)  # fmt: skip
"""The fields of `TraceConfig` as keywords."""


Kind = Literal["mechanism", "instrument", "environment", "discovered"]
Status = Literal["finding", "hint"]
Stop = Literal["white", "nothing significant", "nothing improves held-out error", "limit"]


class Residual(NullIsNaN):
    """What a model leaves, and where it is worst; whiteness is of the derolled rates."""

    flight: int | None = Field(default=None, description="of several, counted from 0: of which all but whiteness is")
    rms: float = Field(description="of the moment coefficients, pitch and yaw together")
    white: bool = Field(description="rates are noise, by correlation and size")
    p_value: float = Field(description="of Ljung-Box test and size")
    noise_ratio: float = Field(description="rms over that of the gyros' noise")
    worst_channel: str = Field(description="moment with the largest residual")
    worst_region_s: Interval = Field(description="when, s")
    dominant_frequency_hz: float = Field(description="in body axes, Hz; positive from y to z")

    @property
    def words(self) -> str:
        """Size, whiteness and place."""
        beyond = "white but for its size" if self.p_value > WHITE_CHANCE else "not white"
        white = "white" if self.white else f"{beyond} (p-value {p_value(self.p_value)})"
        where = "" if self.flight is None else f"flight {self.flight + 1}: "
        return (
            f"{where}rms {number(self.rms)}, {number(self.noise_ratio)} times the noise"
            f"{below_noise(self.noise_ratio)}, {white}; largest in {self.worst_channel}, "
            f"{interval(self.worst_region_s)} s, mostly at {number(self.dominant_frequency_hz)} Hz"
        )


class Family(NullIsNaN):
    """What a family explains of the residual's mean square."""

    family: str = Field(description="kind of cause")
    share: float = Field(description="of the residual's mean square")
    interval_95: Interval = Field(description="of the share")
    evidence: float = Field(default=0.0, description="nats of its processes beside all others")
    effects: tuple[str, ...] = Field(default=(), description="added ones of the family")
    process: str | None = Field(default=None, description="the largest of its processes")
    extremes: str = Field(default="", description="its least and largest value, and where, in words")


class TriedCandidate(NullIsNaN):
    """One effect as tried."""

    effect: str = Field(description="name")
    kind: Kind = Field(description="mechanism, instrument, environment or discovered")
    f_ratio: float = Field(description="of its terms, no processes")
    p_value_adjusted: float = Field(description="for all effects tried (Holm)")
    explains: float | None = Field(description="share of the weighted squares, noise included")
    description: str = Field(default="", description="in words")
    near_equals: tuple[str, ...] = Field(default=(), description="effects confounded with it on this flight")


class Errors(NullIsNaN):
    """Mean squares of errors, both axes together."""

    fit: float = Field(description="mean square on the fitted blocks")
    held_out: float = Field(description="on held-out blocks")


class Step(NullIsNaN):
    """One turn of the loop."""

    step: int = Field(description="counted from 1")
    residual: Residual = Field(description="of the model before")
    families: dict[str, float] = Field(default={}, description="shares of the residual, by family")
    decomposition: tuple[Family, ...] = Field(default=(), description="the same with intervals, by family")
    candidates: tuple[TriedCandidate, ...] = Field(description="effects tried; first the one added")
    refused: tuple[str, ...] = Field(default=(), description="significant in the fit, and not added")
    unwanted: tuple[str, ...] = Field(default=(), description="refused since processes explain the flight better")
    evidence_gain: float | None = Field(default=None, description="of what was added, nats beside processes")
    removed: tuple[str, ...] = Field(default=(), alias="taken_out", description="earlier effects, no longer needed")
    added: str | None = Field(description="effect; null: none")
    description: str = Field(default="", description="of what was added, in words")
    status: Status | None = Field(default=None, alias="standing", description="`finding` or `hint`")
    doubts: tuple[str, ...] = Field(default=(), description="why it is a hint")
    named_in: float | None = Field(default=None, description="share of the repetitions that name it")
    error_before: Errors = Field(description="mean squares without it")
    error_after: Errors | None = Field(default=None, description="with it; where none was added, with the best refused")
    error_ratio_held_out: float | None = Field(default=None, description="after over before, or over that without any")
    error_ratio_std_error: float | None = Field(default=None, description="1 sigma")
    held_out_score: float | None = Field(default=None, description="fall of error of moments and force, in sigmas")
    ratio_of_flights_left_out: float | None = Field(default=None, description="each flight's from the others")

    def as_hint(self, doubt: str) -> Step:
        """The same as a hint, for a further doubt."""
        return self.model_copy(update={"status": "hint", "doubts": (*self.doubts, doubt)})


GIVEN_MODEL = "the model given"  # the first of an account, where a trace did not start from nothing


def lasting_steps(steps: Sequence[Step]) -> tuple[Step, ...]:
    """The steps that added what the model still holds."""
    return tuple(
        step
        for place, step in enumerate(steps)
        if step.added is not None and not any(step.added in later.removed for later in steps[place + 1 :])
    )


def names_added(steps: Sequence[Step], status: Status | None = None) -> tuple[str, ...]:
    """The effects that were added (with a status where one is given) and stay, in order; once, though in parts."""
    own = (step for step in lasting_steps(steps) if status in (None, step.status))
    return tuple(dict.fromkeys(step.added for step in own if step.added is not None))


class Account(NullIsNaN):
    """A model on the way to the last one."""

    model: str = Field(description="constant, scheduled, or the effect added")
    held_out: float = Field(description="mean square moment error on held-out blocks")
    std_error: float = Field(description="1 sigma, from block to block")


class ModelSummary(NullIsNaN):
    """The model as it ended, fitted to the whole record; another trace can start from `definition`."""

    terms: tuple[TermEstimate, ...] = Field(description="fitted to the whole record")
    definition: SavedModel = Field(description="for another trace or a prediction: columns, covariance, errors")


class Picture(MotionHistories):
    """Residual moments (pitch, yaw) before and after, of one flight."""

    measured: tuple[tuple[float, ...], tuple[float, ...]]
    before: tuple[tuple[float, ...], tuple[float, ...]]
    after: tuple[tuple[float, ...], tuple[float, ...]]
    sigma: tuple[float, ...]


class Trace(HasCharts, Result):
    """The history of a trace: its steps, its last model, and the residual."""

    schema_: str = Field(default="brv-hypo/trace/1", alias="schema", description="`brv-hypo/trace/1`")
    flight: FlightSummary = Field(description="the first")
    flights: tuple[FlightSummary, ...] = Field(default=(), description="all")
    record: RecordTrial = Field(default=RecordTrial(), description="faults of the records")
    steps: tuple[Step, ...] = Field(description="of the loop")
    findings: tuple[str, ...] = Field(default=(), description="established effects")
    hints: tuple[str, ...] = Field(default=(), description="other effects added")
    families: dict[str, float] = Field(default={}, description="what each explains of the first step's residual")
    account: tuple[Account, ...] = Field(default=(), description="from constant coefficients to the last model")
    model: ModelSummary = Field(description="the last")
    reconstruction: result.ReconstructionSummary | None = Field(default=None, description="how well motion is known")
    record_errors: tuple[RecordError, ...] = Field(default=(), description="of the model, the largest first")
    collinear: tuple[str, ...] = Field(default=(), description="pairs of coefficients, as those of a comparison")
    collinear_groups: tuple[tuple[str, ...], ...] = Field(default=(), description="names that these pairs link")
    static_slopes: tuple[Derivative, ...] = Field(default=(), description="C_malpha along each flight")
    static_stability: str = Field(default="", description="where the static moment is not significantly stable")
    damping: tuple[Derivative, ...] = Field(default=(), description="C_mq along each flight, processes included")
    dynamic_stability: str = Field(default="", description="where damping is significantly unstable, or changes")
    stopped: Stop = Field(description="why the loop ended")
    unexplained: str | None = Field(description="what is left, in a sentence; null: nothing")
    caveats: tuple[str, ...] = Field(default=(), description="what limits the result")
    noise: float = Field(description="mean square of the moment coefficients' noise on the held-out blocks")
    final_residual: Residual | None = Field(default=None, description="of the last model")
    seconds: float = Field(default=0.0, description="elapsed, s")
    settings: dict[str, Any] = Field(default_factory=dict, description="other than defaults; no model")
    picture: Picture | None = Field(default=None, exclude=True)
    discovered: MechanismFile | None = Field(default=None, exclude=True)

    @property
    def added(self) -> tuple[str, ...]:
        """The effects that were added and stay, in order; once, though an effect was added in parts."""
        return names_added(self.steps)

    @property
    def given(self) -> tuple[str, ...]:
        """The effects of the model that the trace started from."""
        names = (term.mechanism for term in self.model.terms if term.mechanism not in (BASELINE, *self.added))
        return tuple(dict.fromkeys(names)) if self.account and self.account[0].model == GIVEN_MODEL else ()

    @property
    def hints_in_words(self) -> str:
        """The hints; of what was found, a further part may be one."""
        return ", ".join(name + (" (a further part)" if name in self.findings else "") for name in self.hints)

    def headline(self) -> str:
        """What was found, what is hinted at, and why the loop stopped."""
        hints = f"; hints {self.hints_in_words}" if self.hints else ""
        found = ", ".join(self.findings) or "nothing"
        return f"{self.flight.title or self.flight.path}: found {found}{hints}; {self.stopped}"

    def conclusion(self) -> str:
        """What is left, where anything is."""
        return self.unexplained or ("The residual is noise." if self.stopped == "white" else "")

    def rows(self) -> Sequence[Row]:
        """One row for each step: what was added, and the errors before and after."""
        return [
            {"step": step.step, "added": step.added, "standing": step.status, "named_in": step.named_in}
            | {"residual_rms": step.residual.rms, "white": step.residual.white}
            | {f"{k}_before": value for k, value in step.error_before}
            | {f"{k}_after": getattr(step.error_after, k, None) for k, _ in step.error_before}
            | {"error_ratio_held_out": step.error_ratio_held_out}
            for step in self.steps
        ]
