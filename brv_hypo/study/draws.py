"""The flights of a study: every one draws from a seed of its own, so that a study may grow."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from brv_hypo.flight.record import Record
from brv_hypo.mechanisms import parse_hypothesis
from brv_hypo.simulation import SimulationConfig, load_config
from brv_hypo.simulation.config import PlantedConfig, Section
from brv_hypo.study.config import NONE, FaultDraws, StudyConfig
from brv_hypo.study.planted_faults import fault_called, planted_faults

FAULTS = 1  # number of the stream that faults are drawn from


class Draw(Section):
    """What one flight drew; `DrawsConfig` says what each number is."""

    vehicle: str
    planted: str
    repeat: int
    seed: int
    """Of the noise and the errors of the flight's instruments."""
    size: float
    delay: float
    onset_shift: float
    alpha: float
    roll_rate: float
    windward_meridian: float
    gyro_noise: float
    fault: str = ""
    """The name of the fault of its record; empty for a sound one."""

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

    def factor(span: tuple[float, float]) -> float:
        return float(np.exp(random.uniform(*np.log(span))))

    return Draw(
        vehicle=Path(study.vehicles[vehicle]).stem,
        planted=study.planted[planted],
        repeat=repeat,
        seed=int(random.integers(2**31)),
        size=factor(ranges.size),
        delay=factor(ranges.delay),
        onset_shift=float(random.uniform(*ranges.onset_shift)),
        alpha=factor(ranges.alpha),
        roll_rate=factor(ranges.roll_rate),
        windward_meridian=float(random.uniform(*ranges.windward_meridian)),
        gyro_noise=factor(ranges.gyro_noise),
        # From a stream of its own: with faults or without, the flights are the same.
        fault=_fault(ranges.faults, np.random.default_rng([*seed, FAULTS])),
    )


def _fault(faults: FaultDraws | None, random: np.random.Generator) -> str:
    if faults is None or random.uniform() >= faults.share:
        return ""
    kinds = faults.kinds or tuple(fault.name for fault in planted_faults())
    return kinds[int(random.integers(len(kinds)))]


def corrupted(record: Record, draw: Draw) -> Record:
    """The record with the fault that was drawn; itself where it is sound."""
    if not draw.fault:
        return record
    return fault_called(draw.fault).corrupt(record, np.random.default_rng([draw.seed, FAULTS]))


def flight_config(study: StudyConfig, draw: Draw) -> SimulationConfig:
    """The flight that was drawn; raises UsageError where a vehicle cannot plant what the study names."""
    source = next(vehicle for vehicle in study.vehicles if Path(vehicle).stem == draw.vehicle)
    config = load_config(source, plant=() if draw.planted == NONE else tuple(draw.planted.split("+")))
    rate = study.sample_rate or config.sample_rate
    start = {
        "alpha": config.start.alpha * draw.alpha,
        "roll_rate": config.start.roll_rate * draw.roll_rate,
        "windward_meridian": draw.windward_meridian,
    }
    gyro, stated = config.instruments.gyro, study.draws.instruments
    instruments: dict[str, Any] = {"gyro": gyro.model_copy(update={"noise": gyro.noise * draw.gyro_noise})}
    if stated is not None:
        instruments |= {"grade": stated.grade, "tolerances": stated.tolerances, "draw": stated.factor}
    changes = {
        "sample_rate": rate,
        "step": 1.0 / (rate * max(1, round(1.0 / (rate * config.step)))),
        "start": config.start.model_copy(update=start),
        "instruments": config.instruments.model_copy(update=instruments),
        "mechanisms": tuple(_resized(entry, draw) for entry in config.mechanisms),
    }
    return config.model_copy(update=changes)


def _resized(entry: PlantedConfig, draw: Draw) -> PlantedConfig:
    changes = {
        "terms": {name: value * draw.size for name, value in entry.terms.items()},
        "theta": {name: value * draw.delay for name, value in entry.theta.items()},
        "start": None if entry.start is None else entry.start + draw.onset_shift,
        "stop": None if entry.stop is None else entry.stop + draw.onset_shift,
    }
    return entry.model_copy(update=changes)


def check_names(study: StudyConfig) -> None:
    """Raise UsageError now for a vehicle, a planted set or a mechanism that does not exist."""
    for name in study.compare.mechanisms or ():
        parse_hypothesis(name, study.compare.options)
    for draw in draws(study.model_copy(update={"flights": 1})):
        flight_config(study, draw)
