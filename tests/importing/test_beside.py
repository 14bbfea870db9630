"""What a log holds beside its channels: an attitude, and further inertial units."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from brv_hypo.errors import FlightRecordError, UsageError
from brv_hypo.flight.plausibility import contradictions
from brv_hypo.importing import Imported, bring_in
from brv_hypo.importing.rocket_log import lean_by_gyros
from tests.importing.rockets import GRAVITY
from tests.importing.test_foreign import write_csv, write_map
from tests.importing.test_soundness import flown
from tests.studies.soundness import log_map

INERTIAL = ("p", "q", "r", "ax", "ay", "az")


def brought(folder: Path, read: dict[str, Any], **keys: Any) -> Imported:
    """The log by the map of its columns, with more channels and keys."""
    content = log_map(flown())
    content["channels"] |= keys.pop("channels", {})
    return bring_in(write_csv(folder / "a.csv", read), write_map(folder, content | keys))


@pytest.mark.thorough
def test_an_angle_from_the_vertical_gives_the_lean(tmp_path: Path) -> None:
    log = flown()
    up = log.forces[:, 0] / GRAVITY
    lean = np.degrees(lean_by_gyros(log.time, log.rates, up))
    read = log.read(np.random.default_rng(3)) | {"tilt": lean}
    flight = brought(tmp_path, read, channels={"lean": {"column": "tilt", "units": "deg"}}).flight
    assert any("the lean is that of the log's attitude" in note for note in flight.notes)


def two_units() -> dict[str, Any]:
    """A second unit beside the first, turned about the nose."""
    rng = np.random.default_rng(6)
    first, second = flown().read(rng), flown().read(rng, Rotation.from_euler("x", 70.0, degrees=True).as_matrix())
    return first | {f"{name}_2": second[name] for name in INERTIAL}


SECOND = {name: {"column": f"{name}_2", "units": "rad/s" if name in "pqr" else "m/s^2"} for name in INERTIAL}


@pytest.mark.thorough
def test_two_units_that_agree_are_averaged(tmp_path: Path) -> None:
    one = brought(tmp_path, two_units()).flight
    both = brought(tmp_path, two_units(), beside=[SECOND]).flight
    assert any("units 2 and 1 differ" in note for note in both.notes)
    truth = [np.interp(both.time, flown().time, each) for each in flown().rates]
    off = [np.std(np.diff(each.q - np.interp(each.time, flown().time, flown().rates[1]))) for each in (one, both)]
    assert off[1] < 0.9 * off[0]
    np.testing.assert_allclose(both.p, truth[0], atol=0.05)


def test_a_further_unit_has_inertial_channels_only(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="beside/0/altitude"):
        brought(tmp_path, two_units(), beside=[{"altitude": {"column": "altitude", "units": "m"}}])


@pytest.mark.parametrize(("factor", "says"), [(1.0, ""), (0.3048, "bends by"), (1.0 / 0.3048, "bends by")])
def test_units_of_altitudes_show_where_nothing_else_says_the_speed(factor: float, says: str) -> None:
    log = flown()
    coast = np.flatnonzero(log.time > log.time[np.argmax(log.speed)] + 1.0)
    read = {name: values[coast] for name, values in log.read(np.random.default_rng(3)).items()}
    found = contradictions(read.pop("time"), read | {"altitude": factor * read["altitude"]})
    assert bool(found) == bool(says)
    assert all(says in fault.action for fault in found)


def test_a_further_unit_may_have_what_the_first_lacks_or_less(tmp_path: Path) -> None:
    read = two_units()
    content = log_map(flown()) | {"beside": [{"ax": SECOND["ax"]}]}
    for name in "pqr":
        content["channels"].pop(name)
    content.pop("pad")
    with pytest.raises(FlightRecordError, match="no such dataset"):
        bring_in(write_csv(tmp_path / "a.csv", read), write_map(tmp_path, content))
