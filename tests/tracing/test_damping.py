"""C_mq along a flight against flights of the independent simulation, constant and by Mach number."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.inference.derivatives import Derivative
from brv_hypo.tracing import TraceConfig, trace
from tests.studies.independent.flights import make_flight
from tests.studies.independent.imperfections import ordinary
from tests.studies.independent.vehicles import CRAFTS

BARE = TraceConfig(effects=("trim",), discover=False, max_steps=1)


def damping_of(vehicle: str, seed: int, kinds: tuple[str, ...]) -> Derivative:
    (found,) = trace(make_flight(vehicle, seed=seed, imperfect=kinds).flight, BARE).damping
    return found


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", sorted(CRAFTS))
def test_a_constant_damping_is_found_at_every_mach_number(vehicle: str) -> None:
    """At no angle of attack; at that flown, what may bend makes it less certain."""
    found, true = damping_of(vehicle, 31, ()), CRAFTS[vehicle].damping
    for values, errors in ((found.at_zero, found.at_zero_std_error), (found.at_flown, found.at_flown_std_error)):
        off = (np.array(values) - true) / np.array(errors)
        assert np.sqrt(np.mean(off**2)) < 2.5
    assert np.max(found.at_zero_std_error) < 0.2 * abs(true)


@pytest.mark.thorough
def test_a_damping_that_follows_the_mach_number_is_drawn_by_the_process() -> None:
    """A hat, half of the damping high: within its errors, and no constant."""
    craft, kinds = CRAFTS["slender"], ("damping_mach",)
    found = damping_of("slender", 31, kinds)
    size, centre, half = ordinary(craft, kinds, np.random.default_rng(0)).damping_mach
    true = craft.damping + size * np.maximum(1.0 - np.abs(np.array(found.mach) - centre) / half, 0.0)
    for values, errors in ((found.at_zero, found.at_zero_std_error), (found.at_flown, found.at_flown_std_error)):
        off = (np.array(values) - true) / np.array(errors)
        assert np.sqrt(np.mean(off**2)) < 2.5
    assert np.corrcoef(found.at_flown, true)[0, 1] > 0.9
