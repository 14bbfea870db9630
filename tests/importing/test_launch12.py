"""L-12, a measured sounding rocket: from its three CSV files to a record and an honest answer."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from brv_hypo.comparison import CompareConfig, compare
from brv_hypo.importing import Imported, bring_in
from tests.shared_data import shared_file

pytestmark = pytest.mark.shared

MAP = Path(__file__).parents[2] / "configs" / "maps" / "launch12.yaml"


@pytest.fixture(scope="module")
def launch12() -> Imported:
    return bring_in(shared_file("data/launch12/imu.csv"), MAP)


def test_the_log_becomes_a_record(launch12: Imported) -> None:
    flight = launch12.flight
    assert [phase.name for phase in launch12.phases] == ["pad", "burn", "coast"]
    assert [phase.start_s for phase in launch12.phases] == pytest.approx([-4.5, 0.0, 5.9], abs=0.1)
    assert 25.0 < flight.sample_rate < 50.0  # 819 Hz brought to what a motion at some 1.2 Hz needs
    assert len(flight.segments) == 1
    assert flight.vehicle.mass == pytest.approx(26.285, abs=1e-3)
    assert any("clock of altimeter: -0.0" in note for note in flight.notes)


def test_its_speed_agrees_with_the_altimeters_own(launch12: Imported) -> None:
    """Whose table is in feet and gravities, whatever its header says."""
    table = np.genfromtxt(shared_file("data/launch12/altimeter.csv"), delimiter=",", names=True)
    flight = launch12.flight
    inside = (flight.time > 7.0) & (flight.time < 20.0)
    own = np.interp(flight.time[inside], table["met_s"], 0.3048 * table["vel_mps"])
    np.testing.assert_allclose(flight.velocity[inside], own, atol=15.0)
    assert float(flight.mach[inside].max()) == pytest.approx(1.04, abs=0.05)


@pytest.mark.parametrize(
    "settings",
    [
        pytest.param({"mechanisms": ("bodyfixed",), "maximum_likelihood": "none"}, marks=pytest.mark.thorough),
        pytest.param({}, marks=pytest.mark.slow),
    ],
)
def test_accepted_all_the_same_it_names_nothing_and_says_why(launch12: Imported, settings: dict[str, Any]) -> None:
    compared = compare([launch12.flight], CompareConfig(accept_record=True, **settings))
    verdict = compared.verdict
    assert verdict.outcome == "undecided"
    assert verdict.winner is None
    assert "But the record contradicts itself" in verdict.reason
    assert min(compared.series[0].sigma) > 0.0


def test_no_mechanism_wins_and_the_reason_is_said(launch12: Imported) -> None:
    verdict = compare([launch12.flight]).verdict
    assert verdict.winner is None
    assert verdict.outcome == "record fault"
    assert "axes and signs of the gyros are in doubt" in verdict.reason
