"""The forty flights whose results are frozen, and which commands' results of each.

Simulated flights are those of `configs/`, shortened and sampled at half the usual rate, with other seeds, planted
mechanisms and grades of instruments. Measured ones are read from the folder `shared` beside the checkout.
`DEFAULT` are the eight that the tests run, what takes long of them with the thorough or slow ones; `python -m
tests.frozen --all` runs all.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from tests.flights import SAMPLE_RATE_HZ

Command = str
"""One of `COMMANDS`."""
COMMANDS: tuple[Command, ...] = ("inspect", "reconstruct", "compare", "trace", "predict")
RECORD_ONLY: tuple[Command, ...] = ("inspect", "reconstruct")
RANK: tuple[Command, ...] = ("inspect", "reconstruct", "compare")


@dataclass(frozen=True, kw_only=True)
class Frozen:
    """A flight and what of it is frozen.

    `model` names the flight whose trace `predict` takes its model from, `refit` what it fits anew; `accept_record` goes
    on with a record that contradicts itself; `start`, `stop` (s) are the window of every command. `rounded` are
    the commands whose results hang on rounding, one of several solutions being found: they are checked only with the
    libraries that they were written with.
    """

    name: str
    commands: tuple[Command, ...] = RANK
    default: bool = False
    rounded: tuple[Command, ...] = ()
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
        name="rocket_lag", config="sounding_rocket", seed=3, plant=("lag",), grade="industrial", draw=1.0, default=True
    ),
    Simulated(
        name="table_5",
        rounded=("compare",),
        config="report_table_5",
        seed=1,
        duration=4.0,
        sample_rate=50.0,
        default=True,
    ),
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
        commands=(*RECORD_ONLY, "predict"),
        model="cone_magnus",
        default=True,
    ),
    Measured(
        name="opportunity_late",
        rounded=("compare",),
        source="data/opportunity/opportunity_entry.h5",
        start=1120.0,
        default=True,
    ),
    Measured(
        name="launch12_early",
        rounded=("reconstruct", "compare"),
        source="data/launch12/imu.csv",
        map="launch12",
        accept_record=True,
        stop=11.5,
        default=True,
    ),
)

TRACED: tuple[Command, ...] = (*RANK, "trace")
OTHER_FLIGHTS: tuple[Frozen, ...] = (
    # The research cone: every mechanism and effect that can be planted in it, all grades of instruments.
    Simulated(name="cone_none", config="research_cone", seed=11, draw=1.0, commands=TRACED),
    Simulated(
        name="cone_damping",
        rounded=("trace",),
        config="research_cone",
        seed=12,
        plant=("damping",),
        grade="laboratory",
        draw=1.0,
        commands=TRACED,
    ),
    Simulated(name="cone_inplane", config="research_cone", seed=13, plant=("inplane",), draw=1.0),
    Simulated(
        name="cone_bodyfixed", config="research_cone", seed=14, plant=("bodyfixed",), grade="industrial", draw=1.0
    ),
    Simulated(name="cone_lag", config="research_cone", seed=15, plant=("lag",), grade="laboratory"),
    Simulated(name="cone_sticking", config="research_cone", seed=16, plant=("sticking",), draw=1.0),
    Simulated(
        name="cone_cubic", config="research_cone", seed=17, plant=("cubic_stiffness",), duration=4.0, commands=TRACED
    ),
    Simulated(
        name="cone_cubic_sister",
        config="research_cone",
        seed=18,
        plant=("cubic_stiffness",),
        duration=4.0,
        draw=1.0,
        changes={"vehicle": {"mass": 341.0, "ixx": 14.4}, "start": {"alpha": 0.04, "roll_rate": 9.0}},
        commands=(*RECORD_ONLY, "predict"),
        model="cone_cubic",
    ),
    Simulated(
        name="cone_trim", config="research_cone", seed=19, plant=("trim",), draw=1.0, duration=4.0, commands=TRACED
    ),
    Simulated(name="cone_asymmetry", config="research_cone", seed=20, plant=("stiffness_asymmetry",)),
    Simulated(name="cone_two", rounded=("compare",), config="research_cone", seed=21, plant=("sticking", "bodyfixed")),
    Simulated(name="cone_long", config="research_cone", seed=23, plant=("inplane",), duration=9.0, draw=1.0),
    Simulated(
        name="cone_gaps",
        config="research_cone",
        seed=24,
        plant=("damping",),
        sample_rate=200.0,
        changes={
            "instruments": {
                "gaps": [{"start": 1.2, "duration": 0.12}, {"channels": ["q", "r"], "duration": 0.03, "count": 2}],
                "spikes": [{"channel": "q", "count": 6, "size": 0.3}],
            }
        },
    ),
    Simulated(
        name="cone_brief",
        config="research_cone",
        seed=25,
        duration=0.5,
        commands=(*TRACED, "predict"),
        model="cone_cubic",
    ),
    # The capsule.
    Simulated(name="capsule_none", config="blunt_capsule", seed=31, draw=1.0),
    Simulated(name="capsule_damping", config="blunt_capsule", seed=32, plant=("damping",), grade="laboratory"),
    Simulated(
        name="capsule_inplane",
        rounded=("compare",),
        config="blunt_capsule",
        seed=33,
        plant=("inplane",),
        grade="industrial",
        draw=1.0,
    ),
    Simulated(name="capsule_lag", config="blunt_capsule", seed=34, plant=("lag",), draw=1.0),
    Simulated(name="capsule_sticking", config="blunt_capsule", seed=35, plant=("sticking",), grade="industrial"),
    Simulated(name="capsule_slow", config="blunt_capsule", seed=36, duration=6.0, sample_rate=50.0, commands=TRACED),
    Simulated(
        name="capsule_slow_sister",
        config="blunt_capsule",
        seed=37,
        duration=6.0,
        sample_rate=50.0,
        changes={"vehicle": {"mass": 214.0, "iyy": 43.0}, "start": {"alpha": 0.06}},
        commands=(*RECORD_ONLY, "predict"),
        model="capsule_slow",
    ),
    # The sounding rocket.
    Simulated(name="rocket_none", config="sounding_rocket", seed=41, grade="laboratory", draw=1.0),
    Simulated(name="rocket_damping", config="sounding_rocket", seed=42, plant=("damping",), draw=1.0),
    Simulated(name="rocket_bodyfixed", config="sounding_rocket", seed=43, plant=("bodyfixed",), grade="industrial"),
    Simulated(
        name="rocket_sticking",
        rounded=("trace",),
        config="sounding_rocket",
        seed=44,
        plant=("sticking",),
        grade="laboratory",
        duration=6.0,
        commands=TRACED,
    ),
    # The report's own moments, and the demonstration with poor instruments.
    Simulated(name="table_5_industrial", config="report_table_5", seed=2, grade="industrial", draw=1.0),
    Simulated(name="demo_industrial", config="demo", seed=5, grade="industrial", draw=1.0),
    # Measured flights, whole.
    Measured(name="opportunity", rounded=("compare",), source="data/opportunity/opportunity_entry.h5"),
    Measured(
        name="launch12",
        rounded=("inspect", "reconstruct", "compare"),
        source="data/launch12/imu.csv",
        map="launch12",
        accept_record=True,
    ),
    Measured(name="launch12_refused", source="data/launch12/imu.csv", map="launch12", commands=("compare",)),
    Measured(
        name="opportunity_traced",
        source="data/opportunity/opportunity_entry.h5",
        start=1100.0,
        commands=("trace",),
        rounded=("trace",),
    ),
    Measured(
        name="jackpot4",
        rounded=("reconstruct", "compare"),
        source="data/jackpot4/log.csv",
        map="data/jackpot4/map.yaml",
    ),
)

FLIGHTS: dict[str, Frozen] = {flight.name: flight for flight in (*DEFAULT_FLIGHTS, *OTHER_FLIGHTS)}
