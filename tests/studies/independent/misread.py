"""Misread records of the independent simulation: units, axes, signs, mounting, altitude; and sound ones, as a control.

    python -m tests.studies.independent.misread --seed 1000 --flights 100

Flights are those of `imperfect_study` (`--world one`: an imperfection of one kind each). Every record is tried as it
is and with one mistake at a time. A mistake of units, axes or signs counts where its channels exceed noise and
bias (`record_faults.shows`), one of mounting where the vehicle rolls by two turns or more; altitudes are read in
wrong units where they are all that is known of the air. Named is a mistake where the trial finds a decisive fault;
rightly named where it says the kind, and the channels where there are any.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from joblib import delayed
from scipy.spatial.transform import Rotation

from brv_hypo.errors import FlightRecordError
from brv_hypo.flight.format import assemble, unassemble
from brv_hypo.flight.record import ACCELEROMETERS, GYROS, Record, RecordFault
from brv_hypo.motion import try_record
from brv_hypo.study.config import FEET, planted_faults
from tests.studies.independent.imperfect_study import command_line, count, drawn_flight
from tests.studies.independent.imperfections import KINDS
from tests.studies.independent.reporting import fly_and_report
from tests.studies.record_faults import shows

LEAST_TURNS = 2.0  # of roll in the record, from which the axis of spin can be distinguished from a swing
TILTS = (3.0, 10.0, 45.0)  # deg
AIR = ("dynamic_pressure", "density", "mach", "reynolds")
SOUND = "sound"


@dataclass(frozen=True)
class Tried:
    """What the trial said of one record with one mistake."""

    mistake: str
    kind: str
    named: bool
    rightly: bool
    words: str = ""


@dataclass(frozen=True)
class Outcome:
    """One flight and all that was tried of it."""

    seed: int
    vehicle: str
    kind: str
    tried: tuple[Tried, ...]


def turned(record: Record, matrix: np.ndarray) -> Record:
    """The record of a unit turned in the vehicle."""
    channels = dict(record.channels)
    for triad in (GYROS, ACCELEROMETERS):
        channels |= dict(zip(triad, matrix @ np.stack([channels[name] for name in triad]), strict=True))
    return record.model_copy(update={"channels": channels})


def altitude_only(record: Record, factor: float) -> Record:
    """The record with altitudes, at `factor` times their values, for all air data but the speed."""
    channels = {name: values for name, values in record.channels.items() if name not in AIR}
    return record.model_copy(update={"channels": channels | {"altitude": factor * channels["altitude"]}})


def mistakes(record: Record, rng: np.random.Generator) -> Iterable[tuple[str, str, Callable[[], Record]]]:
    """Names, kinds and makers of the mistakes that exceed the noise of this record."""
    for fault in planted_faults().values():
        if fault.kind in ("sign", "axes", "units") and shows(record, fault.channels):
            yield fault.name, fault.kind, lambda fault=fault: fault.corrupt(record, rng)
    time, roll = record.time, record.channels["p"]
    if abs(np.trapezoid(roll, time)) > LEAST_TURNS * 2.0 * np.pi:
        angle = rng.uniform(0.0, 2.0 * np.pi)
        across = np.array([0.0, np.cos(angle), np.sin(angle)])
        for tilt in TILTS:
            turn = Rotation.from_rotvec(np.radians(tilt) * across).as_matrix()
            yield f"turned by {tilt:g} deg", "mounting", lambda turn=turn: turned(record, turn)
        for name, rows in (("nose on y", (1, 2, 0)), ("nose on -x", None)):
            turn = np.diag([-1.0, -1.0, 1.0]) if rows is None else np.eye(3)[list(rows)]
            yield name, "mounting", lambda turn=turn: turned(record, turn)
    yield "altitude: metres as feet", "altitude", lambda: altitude_only(record, FEET)
    yield "altitude: feet as metres", "altitude", lambda: altitude_only(record, 1.0 / FEET)


def trial(record: Record) -> Sequence[RecordFault]:
    """The decisive faults of a record; one that cannot be read has one."""
    try:
        return [each for each in try_record(assemble(record))[1].faults if each.decisive]
    except FlightRecordError as error:
        return [RecordFault("record", "unreadable", 0.0, 0.0, str(error), decisive=True)]


def fly(seed: int, number: int, grade: str, world: str) -> Outcome | str:
    """Draw, misread and try one flight; the reason in words where it cannot be flown."""
    try:
        made, kind, _ = drawn_flight(seed, number, grade, world)
    except (RuntimeError, ValueError) as error:
        return f"seed {seed}: not flown ({error})"
    record, rng = unassemble(made.flight), np.random.default_rng([seed, 11])
    tried = []
    for name, misread in ((SOUND, record), ("sound, altitude only", altitude_only(record, 1.0))):
        found = trial(misread)
        tried.append(Tried(name, SOUND, bool(found), not found, "; ".join(each.action for each in found)))
    for name, what, make in mistakes(record, rng):
        found = trial(make())
        fault = planted_faults().get(name)
        right = fault.named_by(found) if fault else any(each.fault in (what, "units", "axes") for each in found)
        tried.append(Tried(name, what, bool(found), right))
    return Outcome(seed, made.vehicle, kind, tuple(tried))


def line(found: Outcome) -> str:
    """What was missed, or said of a sound record."""
    missed = [each.mistake for each in found.tried if not each.named and each.kind != SOUND]
    alarms = [f"{each.mistake}: {each.words}" for each in found.tried if each.named and each.kind == SOUND]
    return f"{found.seed} {found.vehicle} {found.kind}: missed {missed}; alarms {alarms}"


def report(outcomes: Sequence[Outcome]) -> Iterable[str]:
    """Rates with their intervals: of all, by kind, by mistake."""
    every = [each for found in outcomes for each in found.tried]
    wrong = [each for each in every if each.kind != SOUND]
    yield count("sound records: a mistake is reported", [each.named for each in every if each.kind == SOUND])
    yield count("mistakes named", [each.named for each in wrong])
    yield count("mistakes named by kind and channels", [each.rightly for each in wrong])
    for key in ("kind", "mistake"):
        for value in dict.fromkeys(getattr(each, key) for each in every):
            yield count(f"  {value}", [each.named for each in every if getattr(each, key) == value])


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    given = command_line(__doc__.splitlines()[0], 4 * len(KINDS), "one", arguments)
    runs = (delayed(fly)(given.seed + k, k, given.grade, given.world) for k in range(given.flights))
    fly_and_report(runs, given.jobs, line, report)


if __name__ == "__main__":
    main()
