"""The slow wind across the track: how finely it may change, and what its components are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms import RecordEffect
from brv_hypo.mechanisms.registry import find_installed
from tests.chains import trimmed


@pytest.fixture(scope="module")
def wind() -> RecordEffect:
    found = find_installed("wind")
    assert isinstance(found, RecordEffect)
    return found


def falling(flight: Flight, height: float) -> Flight:
    return replace(flight, altitude=np.linspace(60e3, 60e3 - height, flight.samples))


@pytest.mark.parametrize(("height", "waves"), [(0.0, 5), (11e3, 5), (13e3, 6), (43e3, 21), (100e3, 24)])
def test_a_wind_changes_with_height(wind: RecordEffect, height: float, waves: int) -> None:
    flight = falling(trimmed().flight, height)
    components = wind.components(flight)
    assert {component.name for component in components} == {
        f"{axis} {shape}{wave}" for axis in "yz" for shape in ("", "s") for wave in range(1, waves + 1)
    }
    for axis, place in (("y", 1), ("z", 2)):
        sizes = [c.size for c in components if c.name.startswith(f"{axis} s")]
        assert np.hypot.reduce(sizes) == pytest.approx(flight.instruments.wind[place])


def test_a_record_without_altitude_has_the_fewest(wind: RecordEffect) -> None:
    assert len(wind.components(replace(trimmed().flight, altitude=None))) == 4 * 5


@pytest.mark.parametrize(("name", "shape"), [("y 2", np.cos), ("z 12", np.cos), ("z s3", np.sin), ("y s21", np.sin)])
def test_a_component_is_its_half_wave(wind: RecordEffect, name: str, shape: np.ufunc) -> None:
    flight = trimmed().flight
    place = (flight.time - flight.time[0]) / (flight.time[-1] - flight.time[0])
    known = wind.perturb(flight, name, 3.0).wind
    assert known is not None
    waves = int(name.split()[1].removeprefix("s"))
    np.testing.assert_allclose(known[:, "xyz".index(name[0])], -3.0 * shape(np.pi * waves * place), atol=1e-12)
