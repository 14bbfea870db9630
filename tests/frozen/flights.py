"""The forty flights whose results are frozen, and which commands' results of each.

Simulated flights are those of `configs/`, shortened and sampled at half the usual rate, with other seeds, planted
mechanisms and grades of instruments. Measured ones are read from the folder `shared` beside the checkout.
`DEFAULT` are the eight that the default tests run; `python -m tests.frozen --all` runs all.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from tests.flights import SAMPLE_RATE_HZ

Command = str
"""One of `COMMANDS`."""
COMMANDS: tuple[Command, ...] = ("inspect", "reconstruct", "compare", "trace", "predict")
LOOK: tuple[Command, ...] = ("inspect", "reconstruct")
RANK: tuple[Command, ...] = ("inspect", "reconstruct", "compare")


@dataclass(frozen=True, kw_only=True)
class Frozen:
    """A flight and what of it is frozen.

    `model` names the flight whose trace `predict` takes its model from, `refit` what it fits anew; `accept_record` goes
    on with a record that contradicts itself; `start`, `stop` (s) are the window of every command.
    """

    name: str
    commands: tuple[Command, ...] = RANK
    default: bool = False
    model: str | None = None
    refit: str = "trim,instruments"
    accept_record: bool = False
    start: float | None = None
    stop: float | None = None


@dataclass(frozen=True, kw_only=True)
class Simulated(Frozen):
    """A flight of a configuration; `changes` replace single keys of it, by section.

    `grade` of the instruments' tolerances: laboratory, tactical, industrial; their errors are drawn from `draw` times
    these, 0 for none. `duration` s; None is the configuration's own.
    """

    config: str
    seed: int
    plant: tuple[str, ...] = ()
    grade: str = "tactical"
    draw: float = 0.0
    duration: float | None = None
    sample_rate: float = SAMPLE_RATE_HZ
    changes: Mapping[str, Mapping[str, object]] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Measured(Frozen):
    """A flight of the shared data: a record of format 1, or a log that a map brings in.

    `map` is a path in the shared data, or the name of one that comes with the program.
    """

    source: str
    map: str | None = None


DEFAULT_FLIGHTS: tuple[Frozen, ...] = (
    Simulated(name="demo", config="demo", seed=1, default=True),
    Simulated(name="capsule_bodyfixed", config="blunt_capsule", seed=2, plant=("bodyfixed",), default=True),
    Simulated(
        name="rocket_lag",
        config="sounding_rocket",
        seed=3,
        plant=("lag",),
        grade="industrial",
        draw=1.0,
        default=True,
    ),
    Simulated(name="table_5", config="report_table_5", seed=1, duration=4.0, sample_rate=50.0, default=True),
    Simulated(
        name="cone_magnus",
        config="research_cone",
        seed=3,
        plant=("magnus",),
        duration=3.0,
        commands=(*RANK, "trace"),
        default=True,
    ),
    Simulated(
        name="cone_magnus_sister",
        config="research_cone",
        seed=4,
        plant=("magnus",),
        duration=3.0,
        changes={"vehicle": {"mass": 360.0, "iyy": 143.0}, "start": {"alpha": 0.035, "velocity": 6980.0}},
        commands=(*LOOK, "predict"),
        model="cone_magnus",
        default=True,
    ),
    Measured(
        name="opportunity_late",
        source="data/opportunity/opportunity_entry.h5",
        start=1120.0,
        default=True,
    ),
    Measured(
        name="launch12_early",
        source="data/launch12/imu.csv",
        map="launch12",
        accept_record=True,
        stop=11.5,
        default=True,
    ),
)

FLIGHTS: dict[str, Frozen] = {flight.name: flight for flight in DEFAULT_FLIGHTS}
