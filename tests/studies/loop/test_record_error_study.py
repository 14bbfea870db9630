"""Errors of the record that are planted change what depends on them, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.flight.record import Flight
from tests.chains import traced_trim
from tests.flights import nominal
from tests.studies.loop.record_error_study import KINDS, line, most, planted

CHANNELS = ("p", "q", "r", "ax", "ay", "az", "velocity", "mach", "altitude", "dynamic_pressure", "density", "reynolds")
CHANGED = {"air": {"dynamic_pressure", "density", "reynolds"}, "gyros": {"p", "q", "r"}}


def changed(kind: str, flight: Flight, times: float = 1.0) -> dict[str, np.ndarray]:
    """What a plant adds, by channel of those that the record has."""
    with_it, known = planted(flight, kind, times, 1), [name for name in CHANNELS if getattr(flight, name) is not None]
    found = {name: getattr(with_it, name) - getattr(flight, name) for name in known}
    return {name: change for name, change in found.items() if np.any(change)}


@pytest.mark.parametrize("kind", KINDS)
def test_only_what_depends_on_it_changes_and_in_proportion(kind: str) -> None:
    flight = nominal().flight
    once, more = changed(kind, flight), changed(kind, flight, 3.0)
    assert set(once) <= CHANGED[KINDS[kind].family]
    assert once
    for name, change in once.items():
        np.testing.assert_allclose(more[name], 3.0 * change, rtol=1e-6, atol=1e-9 * np.max(np.abs(change)))


def test_all_that_is_derived_from_the_density_has_one_share() -> None:
    flight = nominal().flight
    shares = [change / getattr(flight, name) for name, change in changed("layer", flight).items()]
    assert len(shares) > 1
    for each in shares:
        np.testing.assert_allclose(each, shares[0], rtol=1e-6, atol=1e-12)
    assert np.max(np.abs(shares[0])) == pytest.approx(KINDS["layer"].ordinary, rel=0.1)


def test_a_line_has_the_families_with_and_without_it() -> None:
    result = traced_trim()
    said = line("ramp", "gyros", result, result)
    assert said.startswith("ramp: residual ")
    assert f"90 % {', '.join(most(result))}; gyros " in said
    assert ", rises" not in said
