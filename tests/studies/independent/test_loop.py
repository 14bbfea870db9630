"""The loop on independent flights whose like it once got wrong; the study by hand is `loop_study`."""

from __future__ import annotations

import numpy as np
import pytest

from tests.studies.independent import descriptions
from tests.studies.independent.effects import ROUGH, TIMES, sized_pair, with_pair
from tests.studies.independent.loop_study import Outcome, fly, traced
from tests.studies.independent.oracle import DETECTED
from tests.studies.independent.record_oracle import f_ratios_in_record


@pytest.mark.slow
@pytest.mark.parametrize("seed", [43016, pytest.param(43134, marks=pytest.mark.slow)])
def test_a_slope_that_follows_the_speed_is_no_finding(seed: int) -> None:
    """A light biconic: the temperature of the air moves its Mach number as much as its speed does."""
    found = fly(seed, "none")
    assert isinstance(found, Outcome)
    assert found.added == ()


@pytest.mark.slow
def test_an_effect_beyond_doubt_is_added_though_the_gyros_noise_drowns_the_moments_error() -> None:
    found = fly(43121, "damping")
    assert isinstance(found, Outcome)
    assert [each.name for each in found.added] == ["damping"]


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "truth"), [(43125, "bodyfixed"), (43203, "inplane"), (43307, "lag")])
def test_what_begins_and_ends_is_found_though_neither_alone_is_worth_much(seed: int, truth: str) -> None:
    found = fly(seed, truth)
    assert isinstance(found, Outcome)
    assert found.added[0].name == truth


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "truth"), [(260020, "mach_step"), (260021, "rotating")])
def test_an_effect_that_no_plugin_has_is_described(seed: int, truth: str) -> None:
    """A step of the stiffness that on one flight is as well one at a time; a turn over a third of the record."""
    found = descriptions.fly(seed, truth)
    assert isinstance(found, descriptions.Outcome)
    assert found.described


@pytest.mark.slow
def test_a_turn_that_is_described_predicts_a_sister() -> None:
    """Its rate was estimated a quarter too slow, over two thirds of its time."""
    found = descriptions.fly(334018, "rotating")
    assert isinstance(found, descriptions.Outcome)
    assert found.lowers
    assert found.lowers


@pytest.mark.slow
def test_of_two_effects_at_once_neither_gives_way_to_a_third() -> None:
    """A lag explains more than either alone; with the best effect beside it, less."""
    made = with_pair(44206, "inplane", "sticking", (9.12e-3, 1.776e-2))
    found = traced(made, "inplane+sticking", (4.6, 7.0), ())  # limits of one alone
    assert {each.name for each in found.added} == {"inplane", "sticking"}


@pytest.mark.slow
def test_a_pair_is_sized_by_the_limit_of_each_beside_the_other() -> None:
    made, times = sized_pair(210000, "damping", "inplane")
    assert min(times) >= TIMES[0] - ROUGH
    assert times == tuple(np.sqrt(np.array(f_ratios_in_record(made)) / DETECTED).tolist())


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "truth", "near"), [(44519, "vortex", True), (43229, "sticking", False)])
def test_an_effect_that_is_tried_as_constant_is_a_near_equal_at_the_times_of_another(
    seed: int, truth: str, near: bool
) -> None:
    """A side moment that begins and ends looks like sticking and Magnus; sticking does not look like Magnus."""
    found = fly(seed, truth)
    assert isinstance(found, Outcome)
    assert found.added[0].name == "sticking"
    assert ("magnus" in found.added[0].near) is near
