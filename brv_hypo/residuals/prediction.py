"""The result of a prediction; its dump is the contract's JSON."""

from __future__ import annotations

from collections.abc import Sequence

from pydantic import Field

from brv_hypo.json_result import NullIsNaN, Result
from brv_hypo.ranking.result import FlightSummary, RecordSummary, TermEstimate
from brv_hypo.results import HasCharts, Row


class ModelSource(NullIsNaN):
    """Where the model came from: its file, and the flights that it was found on."""

    path: str | None
    found_on: tuple[str, ...]


class ErrorsOfPrediction(NullIsNaN):
    """Mean squares of the moment coefficients, both axes together.

    `without` a model: as measured; less the `frozen` model; less the same model refitted here (`own`); of the `noise`.
    """

    without: float
    frozen: float
    own: float
    noise: float


class Region(NullIsNaN):
    """A stretch of the record, the Mach numbers that it runs through (None where unknown), and its ratio of errors."""

    start_s: float
    stop_s: float
    mach: tuple[float, float] | None
    ratio: float


class LocalChange(NullIsNaN):
    """Where this flight differs from the frozen model: a term's coefficient is more by `value` from start to stop.

    More than before and after: what is off throughout is no change.
    `mach` are the Mach numbers there, None where they are unknown; `f_ratio` is of one coefficient, at the effective
    number of samples, `p_value` is paid for all terms and regions that were tried.
    """

    term: str
    units: str
    start_s: float
    stop_s: float
    mach: tuple[float, float] | None
    value: float
    std_error: float
    f_ratio: float
    p_value: float


class Difference(NullIsNaN):
    """The frozen coefficient that differs most from what this flight asks for, the others within their errors.

    `value` is what it is more here, `p_value` paid for all of them; `beside_processes` where the evidence wants these.
    """

    term: str
    units: str
    frozen: float
    value: float
    std_error: float
    p_value: float
    beside_processes: bool


Series = tuple[float, ...]


class Band(NullIsNaN):
    """The predictive band of the moments at `level`, noise included; `inside` is the share of the samples within it.

    Record and vehicle err within their tolerances, by what this flight shows: that is no error of the model. Counted
    where the model's flights flew. `model_error` is the rms of the part of it that the model left beyond the
    noise where it was found. `measured`, `predicted` and `half_width` are of C_m and C_n at `time_s`.
    """

    level: float
    inside: float
    model_error: float = 0.0
    time_s: Series
    measured: tuple[Series, Series]
    predicted: tuple[Series, Series]
    half_width: tuple[Series, Series]


class Prediction(HasCharts, Result):
    """What a frozen model says of a flight; `ratio` is the error with it over that without.

    `explained` is the share of the moments' mean square, noise aside, that the frozen model explains where the flights
    that it was found on flew in Mach number and angle of attack; `flown` is the share of the samples there.
    `local_change` is where slope or damping differ from the frozen model's, None where nothing beyond chance does.
    `refused` says that this flight contradicts the model: there is a local change, or `difference`, None where no
    coefficient is frozen, is more than chance makes it.
    `left_out` are mechanisms of the model that belong to the times of its own flights. `record` is what the trial of
    the flight's record found.
    """

    schema_: str = Field(default="brv-hypo/predict/1", alias="schema")
    flight: FlightSummary
    model: ModelSource
    frozen: tuple[TermEstimate, ...]
    refitted: tuple[TermEstimate, ...]
    error: ErrorsOfPrediction
    ratio: float
    explained: float
    flown: float
    band: Band
    regions: tuple[Region, ...]
    local_change: LocalChange | None = None
    difference: Difference | None = None
    refused: bool = False
    left_out: tuple[str, ...] = ()
    reason: str
    record: RecordSummary = RecordSummary()

    def headline(self) -> str:
        """The flight, and the ratio of mean squares."""
        return f"{self.flight.title or self.flight.path}: error {self.ratio:.3g} of that without the model"

    def conclusion(self) -> str:
        """The outcome in a few sentences."""
        return self.reason

    def rows(self) -> Sequence[Row]:
        """One row for each region of time."""
        return [
            {
                "start_s": region.start_s,
                "stop_s": region.stop_s,
                "mach_from": None if region.mach is None else region.mach[0],
                "mach_to": None if region.mach is None else region.mach[1],
                "ratio": region.ratio,
            }
            for region in self.regions
        ]
