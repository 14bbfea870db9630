"""The slope of the static moment by Mach number, against flights of the independent simulation, and in words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from brv_hypo.comparison.diagnostics import caveats_of
from brv_hypo.inference.derivatives import Derivative
from brv_hypo.tracing import TraceConfig, trace
from brv_hypo.tracing.final_model import damping_in_words, stability_in_words
from tests.chains import reconstructed
from tests.studies.independent.flights import make_flight
from tests.studies.independent.vehicles import CAPSULE

BARE = TraceConfig(effects=("trim",), discover=False, max_steps=1)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [11, pytest.param(12, marks=pytest.mark.slow)])
def test_the_slope_is_that_of_the_vehicle(seed: int) -> None:
    """At no angle of attack and at that flown, of a moment that bends."""
    craft = replace(CAPSULE, alpha=np.radians(8.0), static_bend=0.3, duration=4.0)
    true = make_flight(craft, seed=seed).true
    (found,) = trace(make_flight(craft, seed=seed).flight, BARE).static_slopes
    slope = np.interp(found.time_s, true.time, true.static_slope)
    alpha, step = np.array(found.alpha_rad), 1e-5
    ends = [np.array([a * craft.bent(craft.static_bend, np.array(a)) for a in alpha + side]) for side in (step, -step)]
    for value, error, expected in (
        (found.at_zero, found.at_zero_std_error, slope),
        (found.at_flown, found.at_flown_std_error, slope * (ends[0] - ends[1]) / (2.0 * step)),
    ):
        off = (np.array(value) - expected) / np.array(error)
        assert np.sqrt(np.mean(off**2)) < 2.5
        np.testing.assert_allclose(value, expected, rtol=0.05)


def sloped(at_zero: list[float], flight: int = 0, mach: float = 20.0, **known: object) -> Derivative:
    count = len(at_zero)
    return Derivative(
        flight=flight,
        time_s=tuple(10.0 * k for k in range(count)),
        mach=tuple(mach - k for k in range(count)),
        alpha_rad=(0.05,) * count,
        at_zero=tuple(at_zero),
        at_zero_std_error=(0.01,) * count,
        at_flown=(-0.1,) * count,
        at_flown_std_error=(0.02,) * count,
        **known,
    )


@pytest.mark.parametrize(("last", "said"), [(-0.11, False), (-0.2, True)])
def test_drag_is_a_caveat_where_the_slope_changes(last: float, said: bool) -> None:
    """Axial force keeps its proportion to dynamic pressure on every flight of a constant drag coefficient."""
    slope = sloped([-0.1] * 8).model_copy(update={"at_flown": (*[-0.1] * 7, last)})
    found = caveats_of(reconstructed().flight, slope)
    assert any("keeps a fixed proportion to the axial force" in text for text in found) == said


@pytest.mark.parametrize(("share", "said"), [(0.02, False), (0.15, True)])
def test_density_that_is_off_for_a_while_shows_in_the_axial_force(share: float, said: bool) -> None:
    """The static slope and the normal force follow it, and the residual shows nothing of it."""
    flight = reconstructed().flight
    place = (flight.time - flight.time[0]) / (flight.time[-1] - flight.time[0])
    layer = 1.0 + share * np.exp(-(((place - 0.5) / 0.1) ** 2))
    off = replace(flight, dynamic_pressure=flight.dynamic_pressure * layer)
    found = caveats_of(off, sloped([-0.1] * 32, mach=40.0))
    assert any("density is wrong there (family air)" in text for text in found) == said


def test_a_stable_vehicle_needs_no_words() -> None:
    assert stability_in_words([sloped([-0.1, -0.05, -0.021])]) == ""


def test_where_it_is_unstable_is_reported_with_its_size() -> None:
    said = stability_in_words([sloped([-0.1, -0.01, 0.04, 0.01, -0.1, -0.1])])
    assert "is unstable from 10 to 30 s (Mach 19 to 17): 0.040 ± 0.01 per rad at 20 s" in said
    assert "-0.100 ± 0.02 at the 2.9 deg flown there" in said


def test_where_it_is_not_significantly_stable_is_reported_by_flight() -> None:
    said = stability_in_words([sloped([-0.1, -0.1]), sloped([-0.01, -0.1, -0.019], flight=1, mach=float("nan"))])
    assert said.startswith("At alpha = 0 the static moment of flight 2 is not significantly stable")
    assert "at 0 s and at 20 s: " in said
    assert "Mach" not in said


def test_a_damping_that_changes_is_reported_with_both_ends() -> None:
    damped = sloped([0.0] * 3).model_copy(update={"at_flown_std_error": (0.7,) * 3, "at_flown": (-4.0, -12.0, -3.0)})
    said = damping_in_words([damped])
    assert "changes, C_mq least -12.00 ± 0.7 at 10 s (Mach 19), largest -3.00 ± 0.7 at 20 s (Mach 18)" in said
    assert damping_in_words([damped.model_copy(update={"at_flown": (-4.0, -5.5, -3.9)})]) == ""


def test_no_value_at_alpha_zero_is_stated_where_no_sample_is_near_it() -> None:
    """A slope that is unstable there by extrapolation alone; and one that is unstable at the angle flown."""
    ends = ((0.001, 0.05), (0.04, 0.05), (0.04, 0.05))
    slope = sloped([-0.1, 0.03, 0.03], alpha_ends_rad=ends)
    assert slope.extrapolated == (False, True, True)
    assert stability_in_words([slope]) == ""
    unstable = slope.model_copy(update={"at_flown": (-0.1, -0.1, 0.07)})
    said = stability_in_words([unstable])
    assert said.startswith("At the angle flown the static moment is unstable at 20 s (Mach 18): 0.070 ± 0.02 per rad")
    assert "alpha = 0" not in said
