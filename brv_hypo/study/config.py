"""What a study flies: the schema of `configs/studies/*.yaml`, faults to inject, and what each of its flights draws.

Every flight draws from a seed of its own, so that a study may grow. `read_study` reads the schema, SI and radians
throughout; `planted_faults` lists the faults of records, each with the kind and the channels that a report has to
name; `draws` makes the flights, `flight_config` and `corrupted` what was drawn.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product
from pathlib import Path
from typing import Annotated, Any, TypedDict

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from brv_hypo.arrays import FloatArray
from brv_hypo.comparison import CompareConfig
from brv_hypo.flight.clock import sigma_of_differences
from brv_hypo.flight.plausibility import FEET, GRAVITY, PSF
from brv_hypo.flight.record import ACCELEROMETERS, GYROS, INERTIAL_CHANNELS, Record, RecordFault
from brv_hypo.io.files import config_path
from brv_hypo.io.text import meant
from brv_hypo.mechanisms import parse_hypothesis
from brv_hypo.motion.compatibility import DEGREES, RPM
from brv_hypo.settings import settings_of
from brv_hypo.simulation import SimulationConfig, load_config
from brv_hypo.simulation.config import ConfigSection, NotNegative, PlantedConfig, Positive, TolerancesConfig

STUCK_SECONDS, CLOCK_STEP_SECONDS, CLIPPED_AT, SPIKE_SHARE, PLANTED_SPIKE_SIGMAS = 0.2, 0.1, 0.8, 0.01, 30.0

Corruption = Callable[[Record, np.random.Generator], Record]
NONE = "none"
FAULTS = 1  # number of the stream that faults are drawn from


@dataclass(frozen=True)
class PlantedFault:
    """`corrupt` makes the faulty record; a report has to name the `channels` and the `kind`."""

    name: str
    channels: tuple[str, ...]
    kind: str
    corrupt: Corruption

    def named_by(self, faults: Iterable[RecordFault]) -> bool:
        """Whether any of `faults` names the channels, all and no others, and the kind."""
        mine = (fault for fault in faults if fault.fault == self.kind)
        return any(set(fault.channel.split(", ")) == set(self.channels) for fault in mine)


@cache
def planted_faults() -> Mapping[str, PlantedFault]:
    """Every fault of the study, by its name."""
    found = [PlantedFault(f"sign of {n}", (n,), "sign", _scaled((n,), -1.0)) for n in INERTIAL_CHANNELS]
    pairs = (("q", "r"), ("ay", "az"))
    found += [PlantedFault(f"{' and '.join(pair)} exchanged", pair, "axes", _swapped(*pair)) for pair in pairs]
    for names, factor, large, small in (
        (GYROS, DEGREES, "deg/s tagged rad/s", "rad/s tagged deg/s"),
        (GYROS, 1.0 / RPM, "rpm tagged deg/s", "deg/s tagged rpm"),
        (ACCELEROMETERS, GRAVITY, "m/s^2 tagged g", "g tagged m/s^2"),
    ):
        for chosen in (*((name,) for name in names), names):
            found += [_units(large, chosen, factor), _units(small, chosen, 1.0 / factor)]
    found += [
        _units("ft/s tagged m/s", ("velocity",), 1.0 / FEET),
        _units("psf tagged Pa", ("dynamic_pressure",), 1.0 / PSF),
        PlantedFault("q stuck", ("q",), "stuck", _changed("q", _stuck)),
        PlantedFault("ay clipped", ("ay",), "clipped", _changed("ay", _clipped)),
        PlantedFault("az clipped", ("az",), "clipped", _changed("az", _clipped)),
        PlantedFault("clock step", ("time",), "clock step", _clock_step),
        PlantedFault("samples lost without stamps", ("time",), "clock step", _lost),
        PlantedFault("1 % spikes in q", ("q",), "spikes", _changed("q", _spikes)),
        PlantedFault("burst in ay", ("ay",), "spikes", _changed("ay", _burst)),
        PlantedFault("r dead", ("r",), "dead", _scaled(("r",), 0.0)),
        PlantedFault("az dead", ("az",), "dead", _scaled(("az",), 0.0)),
    ]
    return {fault.name: fault for fault in found}


def _units(label: str, channels: tuple[str, ...], factor: float) -> PlantedFault:
    return PlantedFault(f"{label}: {', '.join(channels)}", channels, "units", _scaled(channels, factor))


def _scaled(names: Sequence[str], factor: float) -> Corruption:
    return lambda record, _: _with(record, {name: factor * record.channels[name] for name in names})


def _swapped(one: str, other: str) -> Corruption:
    return lambda record, _: _with(record, {one: record.channels[other], other: record.channels[one]})


def _with(record: Record, changes: dict[str, FloatArray]) -> Record:
    return record.model_copy(update={"channels": {**record.channels, **changes}})


def _changed(name: str, change: Callable[[FloatArray, Record, np.random.Generator], None]) -> Corruption:
    """`change` writes the fault into a copy of the channel's values."""

    def corrupt(record: Record, random: np.random.Generator) -> Record:
        values = record.channels[name].copy()
        change(values, record, random)
        return _with(record, {name: values})

    return corrupt


def _stuck(values: FloatArray, record: Record, random: np.random.Generator) -> None:
    at = _middle(record, random)
    values[at : at + _samples(record, STUCK_SECONDS)] = values[at]


def _clipped(values: FloatArray, record: Record, random: np.random.Generator) -> None:
    limit = CLIPPED_AT * float(np.max(np.abs(values)))
    np.clip(values, -limit, limit, out=values)


def _spikes(values: FloatArray, record: Record, random: np.random.Generator) -> None:
    count = max(1, round(SPIKE_SHARE * values.size))
    at = random.choice(values.size, size=count, replace=False)
    values[at] += PLANTED_SPIKE_SIGMAS * sigma_of_differences([values]) * random.choice([-1.0, 1.0], size=count)


def _burst(values: FloatArray, record: Record, random: np.random.Generator) -> None:
    at = _middle(record, random)
    values[at : at + int(random.integers(3, 20))] += PLANTED_SPIKE_SIGMAS * sigma_of_differences([values])


def _clock_step(record: Record, random: np.random.Generator) -> Record:
    time, at = record.time.copy(), _middle(record, random)
    time[at:] += CLOCK_STEP_SECONDS
    return record.model_copy(update={"time": time})


def _lost(record: Record, random: np.random.Generator) -> Record:
    at, count = _middle(record, random), _samples(record, CLOCK_STEP_SECONDS)
    kept = np.delete(np.arange(record.time.size), np.arange(at, at + count))
    channels = {name: values[kept] for name, values in record.channels.items()}
    return record.model_copy(update={"time": record.time[: kept.size], "channels": channels})


def _middle(record: Record, random: np.random.Generator) -> int:
    return int(random.integers(record.time.size // 5, 4 * record.time.size // 5))


def _samples(record: Record, seconds: float) -> int:
    return max(1, round(seconds / float(np.median(np.diff(record.time)))))


# ---- The schema of a study ----


def _in_order(span: tuple[float, float]) -> tuple[float, float]:
    if span[0] > span[1]:
        raise ValueError("the lower end comes first")
    return span


Span = Annotated[tuple[float, float], AfterValidator(_in_order)]
PositiveSpan = Annotated[tuple[Positive, Positive], AfterValidator(_in_order)]


class InstrumentDraws(TolerancesConfig):
    """What every record states of its instruments; their errors are drawn from `factor` times that (0: none)."""

    factor: NotNegative = 1.0


class FaultDraws(ConfigSection):
    """Faults of the record: the `share` of flights that have one, drawn evenly from `kinds` (None: every kind)."""

    share: Annotated[float, Field(ge=0.0, le=1.0)]
    kinds: tuple[str, ...] | None = Field(default=None, min_length=1)

    def drawn(self, random: np.random.Generator) -> str:
        """The name of a fault for one flight; empty for a sound record."""
        if random.uniform() >= self.share:
            return ""
        kinds = self.kinds or tuple(planted_faults())
        return kinds[int(random.integers(len(kinds)))]

    @model_validator(mode="after")
    def _known(self) -> FaultDraws:
        known = list(planted_faults())
        for kind in self.kinds or ():
            if kind not in known:
                hint = meant(kind, known, f"known are {', '.join(known)}", cutoff=0.4)
                raise ValueError(f"a known fault, not '{kind}' ({hint})")
        return self


class DrawsConfig(ConfigSection):
    """Ranges from which every flight draws. Factors multiply the vehicle's own values, log-uniformly. `size` multiplies
    the planted coefficients, `delay` the planted delays and other nonlinear parameters, `gyro_noise` the gyros'
    standard deviation. `onset_shift` s moves the planted regions, uniformly. `windward_meridian` rad is the meridian at
    the start, uniform. Errors of instruments, vehicle and air are drawn from the tolerances that the vehicles state, or
    from those of `instruments`; `faults` corrupts some of the records.
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


class StudyConfig(ConfigSection):
    """A study: many simulated flights, each compared."""

    title: str = Field(default="study", description="For the reader.")
    vehicles: tuple[str, ...] = Field(min_length=1, description="Simulation configurations, by file or name.")
    planted: tuple[str, ...] = Field(
        min_length=1, description="Sets of the vehicles' `plantable` block, a plus joining several, or `none`."
    )
    flights: int = Field(default=10, ge=1, description="For each vehicle and each entry of `planted`.")
    seed: int = Field(default=1, ge=0, description="Of all draws.")
    draws: DrawsConfig = Field(default=DrawsConfig(), description="What each flight draws.")
    sample_rate: Positive | None = Field(default=None, description="Hz, in place of the vehicles' own.")
    visible_effect: Positive = Field(default=0.05, description="Part of the moment's rms; effects below count apart.")
    compare: CompareConfig = Field(default=CompareConfig(), description="Settings of `compare`.")

    @model_validator(mode="after")
    def _each_once(self) -> StudyConfig:
        for what, names in (("vehicle", [Path(v).stem for v in self.vehicles]), ("plant", self.planted)):
            twice = [name for name in names if list(names).count(name) > 1]
            if twice:
                raise ValueError(f"the {what} '{twice[0]}' is named twice: ask for more `flights` instead")
        return self


StudySettings = TypedDict("StudySettings", {  # noqa: UP013
    "title": str, "vehicles": Sequence[str], "planted": Sequence[str], "flights": int, "seed": int,
    "draws": DrawsConfig | Mapping[str, Any], "sample_rate": float | None, "visible_effect": float,
    "compare": CompareConfig | Mapping[str, Any],
}, total=False)  # fmt: skip
"""The fields of `StudyConfig` as keywords."""


def read_study(source: StudyConfig | Mapping[str, Any] | str | Path, **overrides: Any) -> StudyConfig:
    """The study of a mapping, a YAML file or a name that comes along, under `overrides`; or UsageError."""
    file = config_path(source, "studies") if isinstance(source, str | Path) else source
    return settings_of(StudyConfig, file, overrides)


class Draw(ConfigSection):
    """What one flight drew; `DrawsConfig` says what each number is."""

    vehicle: str = Field(description="configuration")
    planted: str = Field(description="set of mechanisms")
    repeat: int = Field(description="counted from 0")
    seed: int = Field(description="Of the noise and the errors of the flight's instruments")
    size: float = Field(description="factor of planted coefficients")
    delay: float = Field(description="factor of planted delays")
    onset_shift: float = Field(description="s")
    alpha: float = Field(description="factor of that at the start")
    roll_rate: float = Field(description="factor")
    windward_meridian: float = Field(description="at the start, rad")
    gyro_noise: float = Field(description="factor")
    fault: str = Field(default="", description="The name of the fault of its record; empty for a sound one")

    @property
    def key(self) -> str:
        """The flight's name within its study."""
        return f"{self.vehicle}/{self.planted}/{self.repeat}"


def draws(study: StudyConfig) -> tuple[Draw, ...]:
    """Every flight of the study, all vehicles and mechanisms once before any comes a second time."""
    places = product(range(study.flights), range(len(study.vehicles)), range(len(study.planted)))
    return tuple(_draw(study, vehicle, planted, repeat) for repeat, vehicle, planted in places)


def _draw(study: StudyConfig, vehicle: int, planted: int, repeat: int) -> Draw:
    ranges, seed = study.draws, [study.seed, vehicle, planted, repeat]
    random = np.random.default_rng(seed)
    known: dict[str, Any] = {"seed": int(random.integers(2**31))}
    for name in ("size", "delay", "onset_shift", "alpha", "roll_rate", "windward_meridian", "gyro_noise"):
        ends = getattr(ranges, name)
        evenly = name in ("onset_shift", "windward_meridian")
        known[name] = random.uniform(*ends) if evenly else np.exp(random.uniform(*np.log(ends)))
    # From a stream of its own: with faults or without, the flights are the same.
    fault = "" if ranges.faults is None else ranges.faults.drawn(np.random.default_rng([*seed, FAULTS]))
    known |= {"vehicle": Path(study.vehicles[vehicle]).stem, "planted": study.planted[planted], "repeat": repeat}
    return Draw(**known, fault=fault)


def corrupted(record: Record, draw: Draw) -> Record:
    """The record with the fault that was drawn; itself where it is sound."""
    if not draw.fault:
        return record
    return planted_faults()[draw.fault].corrupt(record, np.random.default_rng([draw.seed, FAULTS]))


def flight_config(study: StudyConfig, draw: Draw) -> SimulationConfig:
    """The flight that was drawn; raises UsageError where a vehicle cannot plant what the study names."""
    source = next(vehicle for vehicle in study.vehicles if Path(vehicle).stem == draw.vehicle)
    config = load_config(source, plant=() if draw.planted == NONE else tuple(draw.planted.split("+")))
    rate = study.sample_rate or config.sample_rate

    def resized(entry: PlantedConfig) -> PlantedConfig:
        changes = {
            "terms": {name: value * draw.size for name, value in entry.terms.items()},
            "theta": {name: value * draw.delay for name, value in entry.theta.items()},
            "start": None if entry.start is None else entry.start + draw.onset_shift,
            "stop": None if entry.stop is None else entry.stop + draw.onset_shift,
        }
        return entry.model_copy(update=changes)

    alpha, roll_rate = config.start.alpha * draw.alpha, config.start.roll_rate * draw.roll_rate
    start = {"alpha": alpha, "roll_rate": roll_rate, "windward_meridian": draw.windward_meridian}
    gyro, stated = config.instruments.gyro, study.draws.instruments
    gyro = gyro.model_copy(update={"noise": gyro.noise * draw.gyro_noise})
    instruments: dict[str, Any] = {"gyro": gyro, "draw": 1.0}
    if stated is not None:
        instruments |= {"grade": stated.grade, "tolerances": stated.tolerances, "draw": stated.factor}
    changes = {
        "sample_rate": rate,
        "step": 1.0 / (rate * max(1, round(1.0 / (rate * config.step)))),
        "start": config.start.model_copy(update=start),
        "instruments": config.instruments.model_copy(update=instruments),
        "mechanisms": tuple(map(resized, config.mechanisms)),
    }
    return config.model_copy(update=changes)


def check_names(study: StudyConfig) -> None:
    """Raise UsageError now for a vehicle, a planted set or a mechanism that does not exist."""
    for name in study.compare.mechanisms or ():
        parse_hypothesis(name, study.compare.options)
    for draw in draws(study.model_copy(update={"flights": 1})):
        flight_config(study, draw)
