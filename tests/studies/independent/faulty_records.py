"""Faults and blemishes planted into independent records: what the trial names, and what is said where it names nothing.

By hand: python -m tests.studies.independent.faulty_records --seed 1000 --flights 1 --jobs 1

Every vehicle with every truth, FLIGHTS times, sound and with one fault at a time (`brv_hypo.study.config`) or
one blemish that no trial has to name: gaps, samples that are no number, channels that are missing or zero, stamps
given twice, coarse digits, stamps that jitter, an inertia 5 % off. Where no fault is named and the record is not
refused, it is compared; with `--trial` it is not, and blemishes are left out. `--only` takes some of both alone.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from joblib import Parallel, delayed

from brv_hypo import compare
from brv_hypo.comparison import CompareConfig
from brv_hypo.errors import FlightRecordError, UnanswerableError
from brv_hypo.flight.clock import sigma_of_differences
from brv_hypo.flight.format import assemble, unassemble
from brv_hypo.flight.record import Record, RecordFault, validated
from brv_hypo.motion import try_record
from brv_hypo.study.config import planted_faults
from tests.studies.independent.flights import draw_flight
from tests.studies.independent.instruments import GRADES
from tests.studies.independent.mechanisms import LISTED
from tests.studies.independent.vehicles import CRAFTS
from tests.studies.record_faults import shows

SOUND = "sound"
REFUSED, UNREADABLE = "refused", "unreadable"
Corruption = Callable[[Record, np.random.Generator], Record]


@dataclass(frozen=True)
class Tried:
    """One record: what was wrong with it, whether that was named, and what was said where nothing was.

    `said`: a winner, None, REFUSED where the trial found some other fault, or UNREADABLE.
    """

    truth: str
    fault: str
    named: bool
    said: str | None

    @property
    def is_wrong(self) -> bool:
        """Whether a hypothesis other than the truth, or than none, was named."""
        return self.said not in (None, REFUSED, UNREADABLE, "none", self.truth)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.studies.independent.faulty_records", description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--flights", type=int, default=1, help="of each vehicle and truth (24 in all)")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--trial", action="store_true", help="try the records only, which takes a fifth of the time")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="faults and blemishes, as the table names them")
    parser.add_argument("-v", "--verbose", action="store_true", help="a line of what was not named, as it goes")
    options = parser.parse_args(arguments)
    cases = [(v, t) for _ in range(options.flights) for v in sorted(CRAFTS) for t in ("none", *LISTED)]
    runs = (delayed(records_of)(options.seed + k, *case, options.trial, options.only) for k, case in enumerate(cases))
    found: list[Tried] = []
    for k, flown in enumerate(Parallel(n_jobs=options.jobs, return_as="generator")(runs)):
        found.extend(flown)
        if options.verbose:
            for each in flown:
                if each.is_wrong or not (each.named or each.fault in BLEMISHES):
                    print(f"{options.seed + k} {cases[k][0]:14s} {each}", flush=True)
            print(f"{k + 1} of {len(cases)} flights", file=sys.stderr, flush=True)
    for line in report(found):
        print(line)


def records_of(
    seed: int, vehicle: str, truth: str, trial: bool = False, only: Sequence[str] | None = None
) -> list[Tried]:
    """A flight's record as it is, and with each fault and blemish, or with `only` some.

    `trial`: with each fault, and tried only.
    """
    made = draw_flight(seed, vehicle=vehicle, truth=truth, grade=GRADES[seed % len(GRADES)])
    record = unassemble(made.flight)
    random = np.random.default_rng([seed, 7])
    found = [_tried(record, truth, SOUND, lambda faults: not faults, trial)]
    found += [
        _tried(fault.corrupt(record, random), truth, fault.name, fault.named_by, trial)
        for fault in planted_faults().values()
        if shows(record, fault.channels) and (only is None or fault.name in only)
    ]
    if trial:
        return found
    chosen = {name: corrupt for name, corrupt in BLEMISHES.items() if only is None or name in only}
    found += [_tried(corrupt(record, random), truth, name, lambda _: False) for name, corrupt in chosen.items()]
    return found


def _tried(
    record: Record, truth: str, name: str, is_named: Callable[[Sequence[RecordFault]], bool], trial: bool = False
) -> Tried:
    """`said` of a record that is tried only: REFUSED where the trial found it at fault."""
    try:
        record = validated(Record, dict(record))  # as a file is when it is read
        tried = try_record(assemble(record))[1]
        faults = tried.faults
    except FlightRecordError:
        return Tried(truth, name, False, UNREADABLE)
    if is_named(faults) and name != SOUND:
        return Tried(truth, name, True, None)
    sound = name == SOUND and not faults
    if trial:
        return Tried(truth, name, sound, None if tried.sound else REFUSED)
    try:
        verdict = compare(assemble(record), CompareConfig(mechanisms=LISTED, maximum_likelihood="none")).verdict
    except UnanswerableError:
        return Tried(truth, name, False, REFUSED)
    said = REFUSED if verdict.outcome == "record fault" else verdict.winner
    return Tried(truth, name, sound, said)


def report(tried: Sequence[Tried]) -> Iterator[str]:
    """Lines of the table: records, share named, and wrong names among those that were compared."""
    yield f"{'fault':42s} {'records':>7s} {'named':>6s} {'refused':>8s} {'wrong':>6s}"
    for name in dict.fromkeys(each.fault for each in tried):
        yield _row(name, [each for each in tried if each.fault == name])
    faulty = {fault.name for fault in planted_faults().values()}
    yield _row("all faults", [each for each in tried if each.fault in faulty])
    misread = {fault.name for fault in planted_faults().values() if fault.kind in {"sign", "axes", "units"}}
    yield _row("signs, axes and units", [each for each in tried if each.fault in misread])
    yield _row("all blemishes", [each for each in tried if each.fault in BLEMISHES])


def _row(name: str, own: Sequence[Tried]) -> str:
    named, wrong = sum(each.named for each in own), sum(each.is_wrong for each in own)
    refused = sum(each.said in (REFUSED, UNREADABLE) for each in own)
    return f"{name:42s} {len(own):7d} {named:6d} {refused:8d} {wrong:6d}"


def _gaps(record: Record, random: np.random.Generator) -> Record:
    """Three stretches of 0.05 s without any inertial channel."""
    step, kept = float(np.median(np.diff(record.time))), np.ones(record.time.size, dtype=bool)
    for at in random.integers(record.time.size // 10, 9 * record.time.size // 10, size=3):
        kept[at : at + max(1, round(0.05 / step))] = False
    channels = {name: values[kept] for name, values in record.channels.items()}
    return record.model_copy(update={"time": record.time[kept], "channels": channels})


def _coarse(record: Record, _: np.random.Generator) -> Record:
    """Inertial channels in steps of their own noise."""
    steps = {name: sigma_of_differences([record.channels[name]]) for name in ("p", "q", "r", "ax", "ay", "az")}
    coarse = {name: step * np.round(record.channels[name] / step) for name, step in steps.items() if step > 0.0}
    return record.model_copy(update={"channels": {**record.channels, **coarse}})


def _jitter(record: Record, random: np.random.Generator) -> Record:
    """Stamps off by a twentieth of a step."""
    step = float(np.median(np.diff(record.time)))
    return record.model_copy(update={"time": record.time + 0.05 * step * random.uniform(-1, 1, record.time.size)})


def _lost(name: str, share: float) -> Corruption:
    """No number in a channel, for a share of the record."""

    def corrupt(record: Record, random: np.random.Generator) -> Record:
        values = record.channels[name].copy()
        count = round(share * values.size)
        first = int(random.integers(0, values.size - count + 1))
        values[first : first + count] = np.nan
        return record.model_copy(update={"channels": {**record.channels, name: values}})

    return corrupt


def _zero(name: str) -> Corruption:
    def corrupt(record: Record, _: np.random.Generator) -> Record:
        channels = {**record.channels, name: np.zeros(record.time.size)}
        return record.model_copy(update={"channels": channels})

    return corrupt


def _twice(record: Record, random: np.random.Generator) -> Record:
    """Five samples with the stamp of the one before."""
    time = record.time.copy()
    for at in random.integers(1, time.size, size=5):
        time[at] = time[at - 1]
    return record.model_copy(update={"time": time})


def _inertia(*names: str) -> Corruption:
    def corrupt(record: Record, random: np.random.Generator) -> Record:
        factor = 1.0 + 0.05 * float(random.choice([-1.0, 1.0]))
        changes = {name: factor * getattr(record.vehicle, name) for name in names}
        return record.model_copy(update={"vehicle": replace(record.vehicle, **changes)})

    return corrupt


BLEMISHES: dict[str, Corruption] = {
    "gaps of 0.05 s": _gaps,
    "q without numbers for 3 %": _lost("q", 0.03),
    "ay without numbers for 3 %": _lost("ay", 0.03),
    "q without a number": _lost("q", 1.0),
    **{f"{name} zero": _zero(name) for name in ("p", "q", "ax", "ay", "velocity", "dynamic_pressure")},
    "stamps given twice": _twice,
    "digits as coarse as the noise": _coarse,
    "stamps that jitter by 5 % of a step": _jitter,
    "inertias 5 % off": _inertia("ixx", "iyy"),
    "transverse inertia 5 % off": _inertia("iyy"),
}


if __name__ == "__main__":
    main()
