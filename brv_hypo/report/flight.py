"""An inspected record as tables and as data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from brv_hypo.flight.faults import RecordTrial
from brv_hypo.flight.phases import Phase
from brv_hypo.flight.quality import ChannelQuality, Inspection, Noise
from brv_hypo.report.style import bullets, number, plain_table

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
    told = [] if trial.sound else [Text(_WHAT_THEN)]
    return [Text(), table, *told, Text()]


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
