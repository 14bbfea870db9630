"""The Opportunity entry: measured, Martian, 8 Hz; through format 1 and through its csv the same flight."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from brv_hypo.flight import CHANNELS, inspect_flight, load_flight
from brv_hypo.importing import import_record
from tests.shared_data import shared_file

pytestmark = pytest.mark.shared

COLUMNS = {
    "time": ("t_mid_s", "s"),
    "p": ("p_radps", "rad/s"),
    "q": ("q_radps", "rad/s"),
    "r": ("r_radps", "rad/s"),
    "ax": ("ax_rimu_mps2", "m/s^2"),
    "ay": ("ay_rimu_mps2", "m/s^2"),
    "az": ("az_rimu_mps2", "m/s^2"),
    "velocity": ("v_rel_mps", "m/s"),
    "dynamic_pressure": ("qbar_Pa", "Pa"),
    "altitude": ("alt_m", "m"),
    "density": ("rho_kgm3", "kg/m^3"),
    "mach": ("mach", "dimensionless"),
}
VEHICLE = {
    "mass": (832.0, "kg"),
    "ixx": (358.182, "kg*m^2"),
    "iyy": (270.0, "kg*m^2"),
    "reference_length": (2.648, "m"),
    "reference_area": (5.507136523519223, "m^2"),
    "accelerometer_position": ([0.187, -0.19, 0.234], "m"),
}


def test_the_record_loads_whole() -> None:
    flight = load_flight(shared_file("data/opportunity/opportunity_entry.h5"))
    assert flight.samples == 1283
    assert flight.sample_rate == pytest.approx(8.0)
    assert flight.segments == ((0, 1283),)
    assert flight.planet == "mars"
    assert flight.vehicle.inertia_ratio == pytest.approx(1.3266)
    assert flight.roll_rate_mag is None
    assert [note.split(":")[0] for note in flight.notes] == ["ax", "p"]  # two real one-sample spikes, nothing else


def test_the_record_is_inspected() -> None:
    found = inspect_flight(shared_file("data/opportunity/opportunity_entry.h5"))
    assert 14.0 < found.samples_per_cycle < 20.0
    assert found.dynamic_pressure_range == pytest.approx((775.33, 5498.03), abs=0.01)
    assert not any(channel.derived for channel in found.channels)


def test_its_csv_through_a_map_is_the_same_flight(tmp_path: Path) -> None:
    mapping = {
        "planet": "mars",
        "channels": {name: {"column": column, "units": units} for name, (column, units) in COLUMNS.items()},
        "vehicle": {name: {"value": value, "units": units} for name, (value, units) in VEHICLE.items()},
    }
    map_path = tmp_path / "map.yaml"
    map_path.write_text(yaml.safe_dump(mapping))
    expected = load_flight(shared_file("data/opportunity/opportunity_entry.h5"))
    found = import_record(shared_file("data/opportunity/opportunity_entry.csv"), map_path)
    for name in ("time", *CHANNELS, "altitude", "density", "mach"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)
    assert found.vehicle == expected.vehicle
    assert found.reynolds is None
    assert found.notes[:2] == expected.notes
    assert "reynolds missing and not derived: the planet is mars" in found.notes[-1]
