"""What commands show that is no document, as tables and as data for JSON: an inspected record, the installed
mechanisms and their conformance, a simulated flight.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from brv_hypo.flight.inspection import ChannelQuality, Inspection, Noise, Phase
from brv_hypo.flight.record import RecordTrial
from brv_hypo.mechanisms.conformance import Outcome
from brv_hypo.mechanisms.registry import OWN, Installed
from brv_hypo.report.style import bullets, number, plain_table, share
from brv_hypo.simulation import SimulatedFlight
from brv_hypo.version import version

# ---- An inspected record as tables and as data ----


NOTES = 6
"""Notes on how the record was made that the terminal shows; all of them with -v."""
_WHAT_THEN = "compare refuses such a record without --accept-record; trace goes on, and says so first."


def inspection_view(inspection: Inspection, trial: RecordTrial, *, verbose: bool = False) -> RenderableType:
    """All that is known of the record before anything is done with it; of many notes the first unless `verbose`."""
    return Group(
        Text(inspection.title or inspection.path, "bold"),
        Text(inspection_line(inspection)),
        Text(_usable(inspection)),
        Text(),
        channel_table(inspection),
        Text(),
        vehicle_line(inspection),
        *fault_lines(trial),
        bullets(phase_texts(inspection.phases), "Phases"),
        bullets(_shown_notes(inspection.notes, verbose), "Notes"),
        bullets(inspection.warnings, "Warnings", "yellow"),
    )


def _shown_notes(notes: Sequence[str], verbose: bool) -> list[str]:
    kept = list(dict.fromkeys(notes))
    if verbose or len(kept) <= NOTES:
        return kept
    return [*kept[: NOTES - 1], f"and {len(kept) - NOTES + 1} more on how the record was made: -v"]


def fault_lines(trial: RecordTrial) -> list[RenderableType]:
    """What the trial of the record found; nothing where it found nothing."""
    if not trial.faults:
        return []
    verdict = "" if trial.sound else ": the record contradicts itself"
    table = plain_table(f"Faults{verdict}")
    for heading in ("channel", "fault", "from s", "to s", "action"):
        table.add_column(heading, overflow="fold")
    for fault in trial.faults:
        table.add_row(fault.channel, fault.fault, f"{fault.start_s:.3f}", f"{fault.stop_s:.3f}", fault.action)
    advice = [] if trial.sound else [Text(_WHAT_THEN)]
    return [Text(), table, *advice, Text()]


def phase_texts(phases: tuple[Phase, ...]) -> list[str]:
    """One line for each phase of a rocket's flight."""
    return [f"{phase.name}: {phase.start_s:.2f} to {phase.stop_s:.2f} s" for phase in phases]


def inspection_line(inspection: Inspection) -> str:
    """Length, rate and planet in one line."""
    return (
        f"{inspection.samples} samples, {inspection.start:.2f} to {inspection.stop:.2f} s, "
        f"{inspection.sample_rate:.4g} Hz, {inspection.planet.capitalize()}"
    )


def _usable(inspection: Inspection) -> str:
    """What can be analysed."""
    stretches = ", ".join(f"{start:.2f}–{stop:.2f}" for start, stop in inspection.segments)
    low, high = inspection.dynamic_pressure_range
    text = f"usable: {stretches} s, dynamic pressure {number(low)} to {number(high)} Pa"
    if inspection.transverse_frequency > 0.0:
        text += (
            f"; the strongest transverse motion is at {number(inspection.transverse_frequency)} Hz, "
            f"{number(inspection.samples_per_cycle)} samples a cycle"
        )
    return text


def channel_table(inspection: Inspection) -> Table:
    """One row for each channel, values in SI."""
    table = plain_table()
    table.add_column("channel", no_wrap=True)
    table.add_column("units", no_wrap=True)
    for heading in ("least", "greatest", "noise", "missing", "spikes"):
        table.add_column(heading, justify="right", no_wrap=True)
    for channel in inspection.channels:
        table.add_row(
            channel.name,
            _units(channel),
            number(channel.minimum),
            number(channel.maximum),
            _noise(channel.noise),
            f"{channel.missing} (≤{channel.longest_gap})" if channel.missing else "",
            str(channel.spikes or ""),
        )
    for name in inspection.absent:
        table.add_row(name, Text("absent", "dim"))
    return table


def _units(channel: ChannelQuality) -> str:
    """The SI unit that the values are in, and where it came from."""
    unit = "1" if channel.si_units == "dimensionless" else channel.si_units
    if channel.derived:
        return f"{unit} (derived)"
    return unit if channel.units == channel.si_units else f"{unit} (from {channel.units})"


def _noise(noise: Noise) -> str:
    """Sigma; a tilde where it is no more than a guide."""
    return number(noise.sigma, 2) if noise.trusted else f"~{number(noise.sigma, 1)}"


def vehicle_line(inspection: Inspection) -> Text:
    """Mass properties and reference quantities."""
    vehicle = inspection.vehicle
    position = ", ".join(f"{value:.4g}" for value in vehicle.accelerometer_position)
    return Text(
        f"vehicle: {vehicle.mass:.5g} kg, Ix {vehicle.ixx:.5g}, I {vehicle.iyy:.5g} kg m², reference length "
        f"{vehicle.reference_length:.4g} m, area {vehicle.reference_area:.4g} m², accelerometers at "
        f"({position}) m"
    )


def inspection_data(inspection: Inspection, trial: RecordTrial) -> dict[str, Any]:
    """The same as data for JSON."""
    return {"schema": "brv-hypo/inspect/1", **asdict(inspection), "record": asdict(trial)}


# ---- The installed mechanisms and their conformance, as tables and as data ----


KINDS = ("mechanism", "aerodynamic", "instrument", "environment")
"""In the order of the list: what `compare` takes if nothing is named comes first."""


def listing_table(found: Mapping[str, Installed], *, verbose: bool = False) -> Table:
    """One row for each mechanism or effect: name, kind, claim; below the claim the package, where it is another's;
    `verbose` adds package and source of all.
    """
    table = plain_table(f"Mechanisms and effects, of {OWN} {version()} where no other package is named")
    table.add_column("name", no_wrap=True, style="bold")
    table.add_column("kind", no_wrap=True)
    table.add_column("claims", overflow="fold")
    for name, entry in sorted(found.items(), key=lambda item: (KINDS.index(item[1].item.kind), item[0])):
        lines = [entry.item.claims]
        if verbose or entry.package != OWN:
            lines.append(f"package: {entry.package} {entry.version}")
        if verbose:
            lines.append(f"source: {entry.item.source}")
        table.add_row(name, entry.item.kind, "\n".join(lines))
    return table


def listing_data(found: Mapping[str, Installed]) -> dict[str, Any]:
    """The same as data for JSON."""
    return {
        "schema": "brv-hypo/mechanisms/1",
        "mechanisms": [
            {
                "name": name,
                "kind": entry.item.kind,
                "title": entry.item.title,
                "claims": entry.item.claims,
                "source": entry.item.source,
                "package": entry.package,
                "version": entry.version,
            }
            for name, entry in found.items()
        ],
    }


def conformance_table(name: str, outcomes: Sequence[Outcome]) -> Table:
    """One row for each check, with what was found where it failed."""
    table = plain_table(f"Conformance of '{name}'")
    table.add_column("check", no_wrap=True)
    table.add_column("", no_wrap=True)
    table.add_column("found")
    for outcome in outcomes:
        passed = Text("passed", "green") if outcome.passed else Text("failed", "bold red")
        table.add_row(outcome.check.replace("_", " "), passed, outcome.detail)
    return table


def conformance_data(name: str, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """The same as data for JSON."""
    return {
        "schema": "brv-hypo/conformance/1",
        "mechanism": name,
        "passed": all(outcome.passed for outcome in outcomes),
        "checks": [asdict(outcome) for outcome in outcomes],
    }


# ---- A simulated flight in words and as data ----


def simulation_text(flown: SimulatedFlight) -> str:
    """What was flown, what was planted, and how much of the moment that is."""
    flight = flown.flight
    inside, outside = flown.truth.planted_share
    planted = ", ".join(flown.truth.planted) or "nothing"
    if flown.truth.planted:
        planted += f" ({share(inside)} of the moment's rms in plane, {share(outside)} out of plane)"
    return (
        f"Simulated '{flight.title}', seed {flown.seed}: {flight.samples} samples at "
        f"{flight.sample_rate:.4g} Hz.\nPlanted: {planted}."
    )


def simulation_data(flown: SimulatedFlight, path: Path) -> dict[str, Any]:
    """The same as data for JSON."""
    inside, outside = flown.truth.planted_share
    return {
        "schema": "brv-hypo/simulate/1",
        "path": str(path),
        "seed": flown.seed,
        "samples": flown.flight.samples,
        "sample_rate_hz": flown.flight.sample_rate,
        "planted": list(flown.truth.planted),
        "planted_share": {"in_plane": inside, "out_of_plane": outside},
    }
