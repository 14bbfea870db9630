"""What comes in is sound: mounting, units, rate and derived speed of a rocket that leans and spins."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from brv_hypo.errors import FlightRecordError, UsageError
from brv_hypo.flight import Flight
from brv_hypo.flight.inspection import held_or_rounded
from brv_hypo.flight.plausibility import ARM_OFF, nose_axis
from brv_hypo.flight.record import ACCELEROMETERS, GYROS, Record
from brv_hypo.importing import bring_in
from brv_hypo.importing.rocket_log import decimated, needed_rate
from tests.flight.records import VEHICLE
from tests.importing.rockets import Log, fly
from tests.importing.test_foreign import write_csv, write_map
from tests.studies.independent.flights import make_flight
from tests.studies.soundness import MISTAKES, foreign, guess_map, log_map, mistaken, named, wrong

pytestmark = pytest.mark.thorough


@cache
def flown(lean: float = 12.0) -> Log:
    return fly(4, lean)


@cache
def coasting() -> Flight:
    return make_flight("cone", seed=3).flight


IN_ALL_RUNS = ("sound", *sorted(MISTAKES)[:2])


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=() if n in IN_ALL_RUNS else pytest.mark.thorough) for n in sorted(MISTAKES)]
)
def test_a_mistake_is_named_and_a_sound_log_is_not(tmp_path: Path, name: str) -> None:
    assert bool(named(flown(), mistaken(flown(), name, np.random.default_rng(1)), tmp_path)) == (name != "sound")


@pytest.mark.parametrize("seed", [1, 2])
def test_axes_and_units_of_a_foreign_log_are_guessed(tmp_path: Path, seed: int) -> None:
    columns = foreign(flown(), np.random.default_rng(seed))
    assert wrong(guess_map(write_csv(tmp_path / "a.csv", columns)), columns, flown()) == []


@pytest.mark.parametrize("how", ["auto", "y 20", "rows"])
def test_a_turned_unit_is_turned_back(tmp_path: Path, how: str) -> None:
    matrix = Rotation.from_euler("y", 20.0, degrees=True).as_matrix()
    read = flown().read(np.random.default_rng(2), matrix.T)
    rotation: Any = matrix.tolist() if how == "rows" else how
    path = write_map(tmp_path, log_map(flown()) | {"rotation": rotation})
    flight = bring_in(write_csv(tmp_path / "a.csv", read), path).flight
    assert not any(fault.decisive for fault in flight.faults)
    truth = np.interp(flight.time, flown().time, flown().forces[0])
    np.testing.assert_allclose(flight.ax[5:], truth[5:], atol=0.3)  # the filter rings where the burn ends
    assert (max(flight.instruments.accel_misalignment) > 0.004) == (how == "auto")


@pytest.mark.parametrize("rotation", ["x", "w 20", [[1, 0, 0], [0, 1, 0], [0, 0, -1]]])
def test_what_is_no_rotation_is_refused(tmp_path: Path, rotation: Any) -> None:
    with pytest.raises(UsageError, match="rotation"):
        bring_in(tmp_path / "a.csv", write_map(tmp_path, log_map(flown()) | {"rotation": rotation}))


@pytest.mark.thorough
@pytest.mark.parametrize("lean", [12.0, pytest.param(30.0, marks=pytest.mark.slow)])
def test_the_speed_of_a_leaning_climb_is_within_its_error(tmp_path: Path, lean: float) -> None:
    log = flown(lean)
    path = write_csv(tmp_path / "a.csv", log.read(np.random.default_rng(3)))
    flight = bring_in(path, write_map(tmp_path, log_map(log))).flight
    known = next(note for note in flight.notes if "at worst to" in note).split("at worst to ")[1]
    error = flight.velocity - np.interp(flight.time, log.time, log.speed)
    assert np.max(np.abs(error)) < 2.5 * float(known.split()[0]) < 30.0
    assert flight.samples >= 500


def test_a_trend_is_no_motion_and_a_rate_is_not_lowered_for_nothing() -> None:
    time = np.arange(0.0, 6.0, 0.005)
    swing = 0.05 * np.sin(2 * np.pi * 1.66 * time)
    channels = {"q": 0.5 * np.exp(-time / 3.0) + swing, "r": 0.3 * time + swing}
    assert needed_rate(time, channels) >= 500.0 / 6.0 > 20.0 * 1.66
    channels |= {**dict.fromkeys(("p", "ax", "ay", "az"), swing), "velocity": 100.0 + time, "altitude": 1000.0 - time}
    record = Record(time=time, channels=channels, vehicle=VEHICLE)
    assert decimated(record, 199.0)[0] is record


def test_held_and_rounded_channels_are_described() -> None:
    time = np.arange(0.0, 10.0, 0.01)
    noise = np.random.default_rng(4).standard_normal(time.size)
    climb = 100.0 * time + noise
    assert held_or_rounded("altitude", time, climb) is None
    held = held_or_rounded("altitude", time, np.repeat(climb[::5], 5))
    assert held is not None
    assert "new values at 20 Hz," in held
    rounded = held_or_rounded("altitude", time, np.round(time + 0.1 * noise))
    assert rounded is not None
    assert "rounded to 1 m" in rounded


@pytest.mark.parametrize("name", ["ay", "altitude"])
def test_a_channel_without_a_number_is_refused(tmp_path: Path, name: str) -> None:
    read = flown().read(np.random.default_rng(2))
    path = write_csv(tmp_path / "a.csv", read | {name: np.full_like(read["time"], np.nan)})
    with pytest.raises(FlightRecordError, match=f"dataset '{name}': found no number"):
        bring_in(path, write_map(tmp_path, log_map(flown())))


@pytest.mark.parametrize("turn", ["y 3", "z 45", "y 90", "y 180"])
def test_a_coast_without_thrust_shows_how_the_unit_is_mounted(turn: str) -> None:
    made = coasting()
    axis, angle = turn.split()
    matrix = Rotation.from_euler(axis, float(angle), degrees=True).as_matrix()
    rates, forces = (matrix @ np.stack([getattr(made, name) for name in triad]) for triad in (GYROS, ACCELEROMETERS))
    air = (made.velocity, made.dynamic_pressure, np.array(made.vehicle.accelerometer_position), ARM_OFF)
    found = nose_axis(made.time, rates, forces, air)
    assert found is not None
    assert np.degrees(np.arccos(min(found.nose @ matrix[:, 0], 1.0))) < 3.0 * np.degrees(found.sigma)
    np.testing.assert_allclose(found.matrix @ found.nose, [1.0, 0.0, 0.0], atol=1e-6)
