"""A foreign table that is being guessed at: its columns, and what is known of each so far."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import BrvHypoError
from brv_hypo.flight import guess_physics as physics
from brv_hypo.flight.tables import column_names, read_columns

DELIMITERS = (",", ";", "\t")


@dataclass(frozen=True)
class Entry:
    """One channel of the map; `why` it is what it is, and what is `unsure` about it. `recorder`: of another file."""

    column: str
    units: str
    why: str
    unsure: tuple[str, ...] = ()
    scale: float = 1.0
    offset: float = 0.0
    recorder: str | None = None


@dataclass
class Table:
    """The numeric columns, what is known of them so far, and the pad, if there is one."""

    path: Path
    delimiter: str
    columns: dict[str, FloatArray]
    entries: dict[str, Entry] = field(default_factory=dict)
    unsure: list[str] = field(default_factory=list)
    rest_s: tuple[float, float] | None = None

    def values(self, channel: str) -> FloatArray:
        """The column of a channel (n,), as it was read."""
        return self.columns[self.entries[channel].column]

    @property
    def seconds(self) -> FloatArray:
        """The table's times (n,), s."""
        return self.values("time") * physics.TIMES.get(self.entries["time"].units, 60.0)

    def change(self, channel: str, why: str, *unsure: str, **changes: Any) -> None:
        """Another reason for what a channel is, with doubts and changed fields."""
        entry = self.entries[channel]
        told = f"{entry.why}; {why}"
        self.entries[channel] = replace(entry, why=told, unsure=(*entry.unsure, *unsure), **changes)

    def sure(self, channel: str, units: str, why: str) -> None:
        """Units by physics, which stand above those of a name."""
        before = self.entries[channel]
        named = () if before.units == units or before.unsure else (f"its name says {before.units}, {why}",)
        self.entries[channel] = replace(before, units=units, why=f"{before.why}; {why}", unsure=named)


def numeric_table(path: Path) -> Table:
    """Every column of numbers of a file, under the delimiter that parts most.

    Raises UsageError and FlightRecordError as `read_columns`.
    """
    tried = DELIMITERS if path.suffix.lower() == ".csv" else DELIMITERS[:1]
    delimiter = max(tried, key=lambda each: len(column_names(path, each)))
    names = tuple(dict.fromkeys(column_names(path, delimiter)))
    try:
        return Table(path, delimiter, dict(read_columns(path, names, delimiter)))
    except BrvHypoError:
        found: dict[str, FloatArray] = {}
        for name in names:
            try:
                found |= read_columns(path, (name,), delimiter)
            except BrvHypoError:  # text: it is no channel
                continue
        return Table(path, delimiter, found)
