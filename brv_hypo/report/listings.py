"""Terminal listings that are no document: inspected record, mechanisms, conformance, simulation; also as JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from brv_hypo import __version__
from brv_hypo.flight.inspection import ChannelQuality, Inspection, Phase
from brv_hypo.flight.record import RecordTrial
from brv_hypo.io.text import NOT_A_NUMBER, number, share, times
from brv_hypo.mechanisms.conformance import CheckOutcome, sample_flight, sample_motion, uniform_time
from brv_hypo.mechanisms.contract import Mechanism, MomentProcess, Process, RecordEffect
from brv_hypo.mechanisms.registry import OWN, Installed, Item, find, find_installed
from brv_hypo.model.term import theta_grid
from brv_hypo.report.document import Block, Table, Texts
from brv_hypo.simulation import SimulatedFlight
from brv_hypo.simulation.config import PlantedConfig

NOTES = 5  # notes on how the record was made that the terminal shows; all of them with -v
KINDS = ("mechanism", "aerodynamic", "process", "instrument", "environment")
"""In the order of the list: what `compare` takes if nothing is named comes first."""
OF_KINDS = (
    "`compare` takes kind mechanism (`--mechanisms installed`: all of it, other packages' too), kind aerodynamic "
    "only by name. `trace` tries all. Every hypothesis has the processes, and errors with a tolerance. By shape: by "
    "what makes most of the moment on a flight."
)


def inspection_blocks(inspection: Inspection, trial: RecordTrial) -> list[Block]:
    """All that is known of the record before anything is done with it."""
    channels = [
        {
            "channel": channel.name,
            "units": _units(channel),
            "least": number(channel.minimum),
            "greatest": number(channel.maximum),
            "noise": number(channel.noise.sigma, 2) if channel.noise.trusted else f"~{number(channel.noise.sigma, 1)}",
            "missing": f"{channel.missing} (≤{channel.longest_gap})" if channel.missing else "",
            "spikes": str(channel.spikes or ""),
        }
        for channel in inspection.channels
    ]
    channels += [{**dict.fromkeys(channels[0], ""), "channel": name, "units": "absent"} for name in inspection.absent]
    shown = ("channel", "fault", "when", "action")
    faults = [{name: getattr(fault, name) for name in shown} for fault in trial.faults]
    vehicle = inspection.vehicle
    position = ", ".join(f"{value:.4g}" for value in vehicle.accelerometer_position)
    described = (
        f"vehicle: {vehicle.mass:.5g} kg, Ix {vehicle.ixx:.5g}, I {vehicle.iyy:.5g} kg m², reference length "
        f"{vehicle.reference_length:.4g} m, area {vehicle.reference_area:.4g} m², accelerometers at ({position}) m"
    )
    spans = ", ".join(f"{start:.2f}–{stop:.2f}" for start, stop in inspection.segments)
    low, high = map(number, inspection.dynamic_pressure_range)
    frequency, samples = number(inspection.transverse_frequency), number(inspection.samples_per_cycle)
    moves = f"q and r are strongest at {frequency} Hz, {samples} samples a cycle (alpha may oscillate faster)"
    moves = moves if inspection.transverse_frequency > 0.0 else "no periodic transverse motion is found"
    usable = f"usable: {spans} s, dynamic pressure {low} to {high} Pa; {moves}"
    title = f"Faults: {'corrected, or to be, as stated' if trial.sound else 'the record contradicts itself'}"
    replaced = any(" replaced " in note or "masked" in note for note in inspection.notes)
    noted = ", but for the samples that the notes name (the table counts those of this file)" if replaced else ""
    none = f"No fault is found{noted}."
    what_then = "compare refuses such a record without --accept-record; trace goes on, with a warning first."
    return [
        Texts((inspection.title or inspection.path,), bullets=False, strong=True),
        Texts((inspection_line(inspection), usable), bullets=False),
        Table(channels, words=("channel", "units")),
        Texts(("", described), bullets=False),
        Table(faults, title, shown),
        Texts((none if not faults else "" if trial.sound else f"\n{what_then}\n",), bullets=False),
        Texts(phase_texts(inspection.phases), "Phases"),
        Texts(inspection.notes, "Notes", most=NOTES),
        Texts(inspection.warnings, "Warnings", warning=True),
    ]


def phase_texts(phases: tuple[Phase, ...]) -> list[str]:
    """One line for each phase of a rocket's flight."""
    return [f"{phase.name}: {times(phase.start_s, phase.stop_s)}" for phase in phases]


def inspection_line(inspection: Inspection) -> str:
    """Length, rate and planet in one line."""
    span = f"{inspection.samples} samples, {times(inspection.start, inspection.stop)}"
    return f"{span}, {inspection.sample_rate:.4g} Hz, {inspection.planet.capitalize()}"


def _units(channel: ChannelQuality) -> str:
    """The SI unit that the values are in, and where it came from."""
    unit = "1" if channel.si_units == "dimensionless" else channel.si_units
    if channel.derived:
        return f"{unit} (derived)"
    return unit if channel.units == channel.si_units else f"{unit} (from {channel.units})"


def inspection_data(inspection: Inspection, trial: RecordTrial) -> dict[str, Any]:
    """The same as data for JSON."""
    return {"schema": "brv-hypo/inspect/1", **asdict(inspection), "record": asdict(trial)}


def listing_table(found: Mapping[str, Installed], *, verbose: bool = False) -> Table:
    """One row for each: name, kind, claim or process, others' package; `verbose`: source, what is planted."""
    rows = []
    for name, entry in found.items():
        item = entry.item
        family = f"{_family(item) or 'by shape'}: " if isinstance(item, Mechanism | Process) else ""
        lines = [family + (item.title if isinstance(item, Process) else item.claims)]
        if verbose or entry.package != OWN:
            lines.append(f"package: {entry.package} {entry.version}")
        if verbose:
            lines += [f"source: {item.source}", f"planted: {', '.join(planted_names(item))}"]
        kind = "process" if isinstance(item, Process) else item.kind
        rows.append({"name": name, "kind": kind, "family: claims": "\n".join(lines)})
    rows.sort(key=lambda row: (KINDS.index(row["kind"]), row["name"]))
    heading = f"Mechanisms, effects and processes of {OWN} {__version__}, or of the package given"
    return Table(rows, heading, ("name", "kind", "family: claims"))


def _family(item: Item) -> str | None:
    """The family whose processes it may be taken for; None: of those whose shapes make most of its moment."""
    if isinstance(item, Mechanism) and not isinstance(item, MomentProcess):
        return item.stated_family
    return item.family


def planted_names(item: Item) -> tuple[str, ...]:
    """What a simulation plants of it, with units: `terms` and `theta`, or components; of a process the ends."""
    if isinstance(item, Mechanism):
        terms = item.terms(sample_motion(uniform_time()), dict(theta_grid(item)[0]))
        names = [(term.name, term.units) for term in terms]
        others = [(f"theta {each.name}", each.units) for each in item.parameters()]
    else:
        names, others = [(each.name, each.units) for each in item.components(sample_flight())], []
    ends = [names[0], ("...", "1"), names[-1]] if isinstance(item, Process) else names
    return tuple(name if units == "1" else f"{name} ({units})" for name, units in (*ends, *others))


def plantable_texts(plantable: Mapping[str, Sequence[str]]) -> Texts:
    """What `simulate --plant` takes, by configuration."""
    by_sets: dict[str, list[str]] = {}
    for name, sets in plantable.items():
        by_sets.setdefault(", ".join(sets), []).append(name)
    texts = [f"{', '.join(names)}: {text}" for text, names in by_sets.items()]
    return Texts(texts, "Planted by `simulate CONFIGURATION --plant NAME` (by a file: -v)")


def listing_data(found: Mapping[str, Installed], plantable: Mapping[str, Sequence[str]]) -> dict[str, Any]:
    """The same as data for JSON."""
    mechanisms = []
    for name, entry in found.items():
        item = {key: getattr(entry.item, key) for key in ("kind", "title", "claims", "source")}
        about = {"planted": planted_names(entry.item), "package": entry.package, "version": entry.version}
        mechanisms.append({"name": name, **item, "family": _family(entry.item), **about})
    return {"schema": "brv-hypo/mechanisms/1", "mechanisms": mechanisms, "plantable": plantable}


def conformance_table(name: str, outcomes: Sequence[CheckOutcome]) -> Table:
    """One row for each check, with what was found where it failed."""
    rows = [
        {"check": each.check.replace("_", " "), "": "passed" if each.passed else "failed", "found": each.detail}
        for each in outcomes
    ]
    failed = [i for i, outcome in enumerate(outcomes) if not outcome.passed]
    return Table(rows, f"Conformance of '{name}'", ("check", "", "found"), marked=failed)


def simulation_blocks(flown: SimulatedFlight, *, verbose: bool = False) -> list[Block]:
    """What was flown and planted, and how large that is; `verbose` adds each error of record and vehicle."""
    flight, config = flown.flight, flown.config
    inside, outside = flown.truth.planted_share
    planted = ", ".join(flown.truth.planted) or "nothing"
    if flown.truth.planted:
        whole = f"{share(math.hypot(inside, outside))} of the moment's rms"
        planted += f", {whole} ({share(inside)} in plane, {share(outside)} across)"
    named = {
        "errors of the record": [*config.instruments.errors],
        "asymmetries of the vehicle": [each.mechanism for each in config.asymmetries],
    }
    errors = "".join(f"; {what}: {', '.join(names)}" for what, names in named.items() if names)
    said = f"{errors}{'' if verbose else ' (sizes: -v)'}" if errors else ""
    texts = (
        f"Simulated '{flight.title}', seed {flown.seed}: {flight.samples} samples at {flight.sample_rate:.4g} Hz.",
        f"Planted: {planted}{said}.",
        *(f"  {planted_text(each)}" for each in config.mechanisms),
    )
    drawn = _drawn_errors(flown) if verbose else ()
    return [Texts(texts, bullets=False), Table(drawn, "Errors of record and vehicle", ("error", "component", "unit"))]


def planted_text(entry: PlantedConfig) -> str:
    """A planted mechanism with its coefficients, delays and times."""
    units = {each.name: each.units for each in find(entry.mechanism, entry.options).parameters()}
    rate = " per s" if entry.kind == "ramp" else ""
    sizes = [f"{name} {value:g}{rate}" for name, value in entry.terms.items()]
    sizes += [f"{name} {value:g} {units[name]}" for name, value in entry.theta.items()]
    ends = {"from": entry.start, "to": entry.stop}
    when = " ".join(f"{word} {end:g}" for word, end in ends.items() if end is not None)
    return f"{entry.mechanism}: {', '.join(sizes)}, {f'{when} s' if when else 'throughout'}"


def _drawn_errors(flown: SimulatedFlight) -> list[dict[str, str]]:
    """One row for each error of record and vehicle: its size, and that in the tolerances stated."""
    rows: list[tuple[str, str, float, str, float | None]] = []
    for name, values in flown.config.instruments.errors.items():
        item = find_installed(name)
        known = {each.name: each for each in item.components(flown.flight)} if isinstance(item, RecordEffect) else {}
        rows += [(name, part, value, known[part].units, known[part].size) for part, value in values.items()]
    for entry in flown.config.asymmetries:
        mechanism = find(entry.mechanism, entry.options)
        terms = {each.name: each.units for each in mechanism.terms(sample_motion(uniform_time()), dict(entry.theta))}
        sizes = dict(zip(terms, mechanism.tolerance(flown.flight) or (), strict=False))
        rows += [(entry.mechanism, part, value, terms[part], sizes.get(part)) for part, value in entry.terms.items()]
    return [
        {
            "error": name,
            "component": part,
            "size": number(value),
            "unit": units,
            "tolerances": number(value / size, 2) if size else NOT_A_NUMBER,
        }
        for name, part, value, units, size in rows
    ]


def simulation_data(flown: SimulatedFlight, path: Path) -> dict[str, Any]:
    """The same as data for JSON; sizes are in SI."""
    inside, outside = flown.truth.planted_share
    planted = flown.config.model_dump(include={"mechanisms", "asymmetries"})
    return {
        "schema": "brv-hypo/simulate/1",
        "path": str(path),
        "seed": flown.seed,
        "samples": flown.flight.samples,
        "sample_rate_hz": flown.flight.sample_rate,
        "planted": list(flown.truth.planted),
        "planted_share": {"in_plane": inside, "out_of_plane": outside},
        **planted,
        "errors": flown.config.instruments.errors,
    }
