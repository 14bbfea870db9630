"""The flights of a study: every one draws from a seed of its own, so that a study may grow."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from brv_hypo.flight.record import Record
from brv_hypo.mechanisms import parse_hypothesis
from brv_hypo.simulation import SimulationConfig, load_config
from brv_hypo.simulation.config import PlantedConfig, Section
from brv_hypo.study.config import NONE, FaultDraws, InstrumentDraws, StudyConfig
from brv_hypo.study.faults import fault_called, planted_faults

FAULTS = 1  # number of the stream that faults are drawn from


class Draw(Section):
    """What one flight drew; `DrawsConfig` says what each number is.

    `seed` is of its instruments' noise and errors; `fault` names the fault of its record, empty for a sound one.
    """

    vehicle: str
    planted: str
    repeat: int
    seed: int
    size: float
    delay: float
    onset_shift: float
    alpha: float
    roll_rate: float
    windward_meridian: float
    gyro_noise: float
    fault: str = ""

    @property
    def key(self) -> str:
        """The flight's name within its study."""
        return f"{self.vehicle}/{self.planted}/{self.repeat}"


def draws(study: StudyConfig) -> tuple[Draw, ...]:
    """Every flight of the study, all vehicles and mechanisms once before any comes a second time."""
    return tuple(
        _draw(study, (vehicle, planted, repeat))
        for repeat in range(study.flights)
        for vehicle in range(len(study.vehicles))
        for planted in range(len(study.planted))
    )


def _draw(study: StudyConfig, place: tuple[int, int, int]) -> Draw:
    vehicle, planted, repeat = place
    random = np.random.default_rng([study.seed, *place])
    ranges = study.draws

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
        fault=_fault(ranges.faults, np.random.default_rng([study.seed, *place, FAULTS])),
    )


def _fault(faults: FaultDraws | None, random: np.random.Generator) -> str:
    """The fault of a record, from a stream of its own: with faults or without, the flights are the same."""
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
    chosen = () if draw.planted == NONE else tuple(draw.planted.split("+"))
    config = load_config(source, plant=chosen)
    start, gyro = config.start, config.instruments.gyro
    rate = study.sample_rate or config.sample_rate
    return config.model_copy(
        update={
            "sample_rate": rate,
            "step": 1.0 / (rate * max(1, round(1.0 / (rate * config.step)))),
            "start": start.model_copy(
                update={
                    "alpha": start.alpha * draw.alpha,
                    "roll_rate": start.roll_rate * draw.roll_rate,
                    "windward_meridian": draw.windward_meridian,
                }
            ),
            "instruments": config.instruments.model_copy(
                update={
                    "gyro": gyro.model_copy(update={"noise": gyro.noise * draw.gyro_noise}),
                    **_tolerances(study.draws.instruments),
                }
            ),
            "mechanisms": tuple(_resized(entry, draw) for entry in config.mechanisms),
        }
    )


def _tolerances(instruments: InstrumentDraws | None) -> dict[str, Any]:
    """The settings of the simulated instruments that the study replaces."""
    if instruments is None:
        return {}
    return {
        "grade": instruments.grade,
        "tolerances": instruments.tolerances,
        "draw": instruments.factor,
    }


def _resized(entry: PlantedConfig, draw: Draw) -> PlantedConfig:
    return entry.model_copy(
        update={
            "terms": {name: value * draw.size for name, value in entry.terms.items()},
            "theta": {name: value * draw.delay for name, value in entry.theta.items()},
            "start": None if entry.start is None else entry.start + draw.onset_shift,
            "stop": None if entry.stop is None else entry.stop + draw.onset_shift,
        }
    )


def check_names(study: StudyConfig) -> None:
    """Raise UsageError now for a vehicle, a planted set or a mechanism that does not exist."""
    for name in study.compare.mechanisms or ():
        parse_hypothesis(name, study.compare.options)
    for draw in draws(study.model_copy(update={"flights": 1})):
        flight_config(study, draw)
