"""What a study flies: the schema of `configs/studies/*.yaml`. SI and radians throughout."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Field, model_validator

from brv_hypo.io.text import meant
from brv_hypo.ranking import CompareConfig
from brv_hypo.settings import read_settings
from brv_hypo.simulation.config import NotNegative, Positive, Section, TolerancesConfig, config_path
from brv_hypo.study.planted_faults import planted_faults

NONE = "none"
HOME = "studies"


def _in_order(span: tuple[float, float]) -> tuple[float, float]:
    if span[0] > span[1]:
        raise ValueError("the lower end comes first")
    return span


Span = Annotated[tuple[float, float], AfterValidator(_in_order)]
PositiveSpan = Annotated[tuple[Positive, Positive], AfterValidator(_in_order)]


class InstrumentDraws(TolerancesConfig):
    """What every record states of its instruments, and how many times that its errors are drawn from; 0: perfect."""

    factor: NotNegative = 1.0


class FaultDraws(Section):
    """Faults of the record: the `share` of flights that have one, drawn evenly from `kinds` (None: every kind)."""

    share: Annotated[float, Field(ge=0.0, le=1.0)]
    kinds: tuple[str, ...] | None = Field(default=None, min_length=1)

    @model_validator(mode="after")
    def _known(self) -> FaultDraws:
        known = [fault.name for fault in planted_faults()]
        for kind in self.kinds or ():
            if kind not in known:
                hint = meant(kind, known, f"known are {', '.join(known)}", cutoff=0.4)
                raise ValueError(f"a known fault, not '{kind}' ({hint})")
        return self


class DrawsConfig(Section):
    """Ranges from which every flight draws. Factors multiply the vehicle's own values, log-uniformly.

    `size` multiplies the planted coefficients, `delay` the planted delays and other nonlinear parameters,
    `gyro_noise` the gyros' standard deviation. `onset_shift` s moves the planted regions, uniformly.
    `windward_meridian` rad is the meridian at the start, uniform. `instruments` replaces what the vehicles say of
    tolerances and errors to draw; `faults` corrupts some of the records.
    """

    size: PositiveSpan = (0.15, 1.2)
    delay: PositiveSpan = (0.8, 1.25)
    onset_shift: Span = (-0.5, 0.5)
    alpha: PositiveSpan = (0.8, 1.25)
    roll_rate: PositiveSpan = (0.8, 1.25)
    windward_meridian: Span = (-math.pi, math.pi)
    gyro_noise: PositiveSpan = (1.0, 1.0)
    instruments: InstrumentDraws | None = None
    faults: FaultDraws | None = None


class StudyConfig(Section):
    """A study: `flights` for each vehicle and each entry of `planted`.

    `vehicles` are simulation configurations; `planted` names sets of their `plantable` block, a plus joining
    several, or `none`. `sample_rate` Hz replaces the vehicles' own. Planted effects below
    `visible_effect` (part of the moment's rms) are counted apart. `compare` holds the settings of `compare`.
    """

    title: str = "study"
    vehicles: tuple[str, ...] = Field(min_length=1)
    planted: tuple[str, ...] = Field(min_length=1)
    flights: Annotated[int, Field(ge=1)] = 10
    seed: Annotated[int, Field(ge=0)] = 1
    draws: DrawsConfig = DrawsConfig()
    sample_rate: Positive | None = None
    visible_effect: Positive = 0.05
    compare: CompareConfig = CompareConfig()

    @model_validator(mode="after")
    def _each_once(self) -> StudyConfig:
        for what, names in (("vehicle", [Path(v).stem for v in self.vehicles]), ("plant", self.planted)):
            twice = [name for name in names if list(names).count(name) > 1]
            if twice:
                raise ValueError(f"the {what} '{twice[0]}' is named twice: ask for more `flights` instead")
        return self


def read_study(source: str | Path, **overrides: Any) -> StudyConfig:
    """The study of a YAML file, or of the name of one that comes along, with `overrides` set over it.

    Raises UsageError that names each wrong setting, what it holds and what is expected.
    """
    return read_settings(StudyConfig, config_path(source, HOME), **overrides)
