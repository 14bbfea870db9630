"""What is fitted along in every hypothesis: noise-free histories, with priors where tolerances bound them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from brv_hypo.comparison import CompareConfig
from brv_hypo.comparison.preparation import Reading, _problem, shared_problem
from brv_hypo.flight.record import Flight
from brv_hypo.inference.build import carrying
from brv_hypo.inference.problem import Problem
from brv_hypo.linearisation.channels import Channels
from brv_hypo.linearisation.nuisance import Nuisances
from brv_hypo.model.baseline import StaticBend
from brv_hypo.motion import ReconstructionConfig, reconstruct
from brv_hypo.motion.inputs import PRESSURE, ROLL_RATE
from tests.chains import prepared, reconstructed
from tests.flights import USUAL_RATE_HZ, nominal

SEEDS = (1, 2)
"""Of the noise that is added."""
SHARE = 0.05
"""Of a column's rms, and of a whitened row's noise, that its own noise may be."""


def noisier(flight: Flight, seed: int) -> Flight:
    """The flight with as much noise again on gyros and accelerometers, by its third differences."""
    rng = np.random.default_rng(seed)
    channels = {}
    for name in ("p", "q", "r", "ax", "ay", "az"):
        channel = getattr(flight, name)
        sigma = np.std(np.diff(channel, 3)) / np.sqrt(20.0)
        channels[name] = channel + sigma * rng.standard_normal(flight.samples)
    return replace(flight, **channels)


@cache
def problem(seed: int) -> Problem:
    return shared_problem([reconstruct(noisier(nominal(USUAL_RATE_HZ).flight, seed))], CompareConfig())[0]


def at_half_the_rate() -> Problem:
    """The flight as it is, for what its noise has no part in."""
    return prepared()


def test_an_added_nuisance_effect_is_as_if_it_had_been_there_from_the_start() -> None:
    """The bend does not act where the motion is linearised."""
    made = reconstructed()
    settings, config = Reading((ReconstructionConfig(),), None), CompareConfig()
    first = _problem([made], settings, config)
    bend = StaticBend(slope=0.5)
    expected = _problem([made], replace(settings, bend=bend), config)
    found = carrying(first, bend)
    assert repr(found.rows.nuisances.items) == repr(expected.rows.nuisances.items)
    np.testing.assert_allclose(found.rows.nuisance_design, expected.rows.nuisance_design, rtol=1e-12, atol=1e-12)
    assert set(found.frame.mechanisms) == set(expected.frame.mechanisms)


def nuisance_columns(found: Nuisances) -> dict[str, int]:
    """Where the histories of record effects and of the vehicle's tolerances are placed; motion and force are free.

    The residual noise of a smoothed input has shapes of that noise's own smoothness.
    """
    others = ("motion", "force", ROLL_RATE, PRESSURE)
    return {item.label: k for k, item in enumerate(found.items) if item.name not in others}


def both(seed: int) -> Channels:
    """The histories of nuisance effects (rows, effects), by label."""
    found = problem(seed).rows.nuisances
    places = [place for _, place in sorted(nuisance_columns(found).items())]
    histories = found.histories(np.eye(len(found.items))[:, places])
    return Channels(histories.rates, histories.force)


@pytest.mark.thorough
def test_every_seed_has_the_same_nuisance_effects_each_once() -> None:
    one, other = (problem(seed).rows.nuisances for seed in SEEDS)
    assert set(nuisance_columns(one)) == set(nuisance_columns(other))
    assert len({item.label for item in one.items}) == len(one.items)


@pytest.mark.thorough
@pytest.mark.parametrize("channel", ["rates", "force"])
def test_two_seeds_of_the_noise_give_nearly_the_same_columns(channel: str) -> None:
    """Those that show: the first problem is linear where the record reads, noise included, and one sigma of the lowest
    mode of the random walk is a thirtieth of the noise.
    """
    one, other = (getattr(both(seed), channel) for seed in SEEDS)
    rows = problem(SEEDS[0]).rows.white_histories(both(SEEDS[0]))
    shows = np.sqrt(np.mean(rows**2, axis=0)) > 0.1
    assert np.mean(shows) > 0.5
    size = np.linalg.norm(one, axis=0)
    assert np.all((np.linalg.norm(one - other, axis=0) <= SHARE * size)[shows])


@pytest.mark.thorough
def test_the_noise_of_a_column_is_far_below_that_of_the_rows() -> None:
    """One sigma of a tolerance moves no whitened row by noise that a fit could take for the row's own."""
    one, other = (problem(SEEDS[0]).rows.white_histories(both(seed)) for seed in SEEDS)
    size, apart = np.sqrt(np.mean(one**2, axis=0)), np.sqrt(np.mean((one - other) ** 2, axis=0))
    assert np.all(apart <= SHARE * np.maximum(size, 1.0))


def test_what_has_a_prior_has_the_size_of_the_tolerance() -> None:
    known = nominal().flight.instruments
    sizes = {(item.name, item.component): item.size for item in at_half_the_rate().rows.nuisances.items}
    assert sizes["gyro_bias", "q"] == pytest.approx(known.gyro_bias[1])
    assert sizes["accel_scale", "z"] == pytest.approx(known.accel_scale[2])
    assert sizes["dynamic_pressure_scale", "scale"] == pytest.approx(known.dynamic_pressure_scale[0])
    assert sizes["inertia_ratio", "ratio"] == pytest.approx(known.inertia_ratio[0])


def test_the_normal_force_is_free_and_the_rest_is_bounded() -> None:
    found = at_half_the_rate().rows.nuisances
    free = {found.items[k].name for k in set(range(len(found.items))) - set(found.bounded.tolist())}
    assert free <= {"motion", "force"}
    assert "force" in free
    assert found.present.size == found.bounded.size
    assert np.all(np.isfinite(found.present))
