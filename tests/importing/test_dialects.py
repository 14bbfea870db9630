"""Tables of any recorder: the same motion from every dialect, or a refusal by line and cause; loggers by name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from brv_hypo.errors import FlightRecordError, UsageError
from brv_hypo.flight import Flight
from brv_hypo.importing import import_record
from brv_hypo.importing.guess import guess_map
from tests.flight.records import UNITS
from tests.importing.dialects import DIALECTS, REFUSED, Table, truth
from tests.importing.test_foreign import foreign_map, write_map


def brought_in(table: Table, folder: Path) -> Flight:
    """The flight by a map that names the columns."""
    path = folder / f"log.{table.suffix}"
    table.write(path)
    channels: dict[str, dict[str, Any]] = {}
    for name in truth():
        entry = {"column": table.columns.get(name, name), "units": UNITS[name], **table.channel.get(name, {})}
        channels[name] = {key: value for key, value in entry.items() if value is not None}
    return import_record(path, write_map(folder, {**foreign_map(), "channels": channels, **table.keys}))


@pytest.mark.parametrize("dialect", DIALECTS)
def test_a_table_of_any_dialect_comes_in_as_the_truth(tmp_path: Path, dialect: str) -> None:
    flight, expected = brought_in(DIALECTS[dialect], tmp_path), truth()
    np.testing.assert_allclose(flight.time - flight.time[0], expected.pop("time"), atol=1e-6)
    for name, values in expected.items():
        rough = 3e-3 if "increments" in dialect and name in "pqr" else 1e-6
        np.testing.assert_allclose(getattr(flight, name), values, rtol=1e-8, atol=rough, err_msg=name)


@pytest.mark.parametrize("dialect", REFUSED)
def test_a_table_that_cannot_come_in_is_refused_by_line_and_cause(tmp_path: Path, dialect: str) -> None:
    table, says = REFUSED[dialect]
    with pytest.raises((FlightRecordError, UsageError), match=says):
        brought_in(table, tmp_path)
