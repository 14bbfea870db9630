"""A motion by its start and its walk: what a fit found too much of either is subtracted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from brv_hypo.linearisation.response import (
    GRAVITY_ERRORS,
    MOTION,
    START,
    PropagatedMotion,
    gravity_axes,
    linearisation_point,
    walk_name,
    walk_sines,
)
from brv_hypo.motion import ReconstructionConfig, reconstruct
from brv_hypo.motion.inertial import NominalMotion, WindStart, transverse_axes
from tests.flights import nominal

USUAL = ReconstructionConfig()


@pytest.fixture(scope="module")
def point():
    return linearisation_point(reconstruct(nominal().flight), USUAL)


def test_start_and_walk_make_the_crossflow_that_they_are_of(point):
    record, smooth = point
    made = PropagatedMotion.of(record, smooth).crossflow(record)
    np.testing.assert_allclose(made, smooth.crossflow, atol=1e-12)


def test_a_motion_that_a_fit_led_to_is_linearised_about_as_it_is(point):
    """The record as it reads: nothing more is subtracted from it, and the motion is not smoothed anew."""
    record, smooth = point
    fitted = replace(PropagatedMotion.of(record, smooth), walk=1e-3 * np.exp(3j * record.time) - 1e-3)
    again, moved = linearisation_point(smooth, USUAL, fitted)
    np.testing.assert_allclose(moved.crossflow, fitted.crossflow(again), atol=1e-12)
    np.testing.assert_array_equal(moved.flight.q, smooth.flight.q)
    assert all(effect.value == 0.0 for effect in moved.effects)


@pytest.mark.parametrize(
    ("name", "size"), [(START[0], 1e-3), (START[1], -2e-3), (GRAVITY_ERRORS[2], 0.1), (GRAVITY_ERRORS[0], -0.2)]
)
def test_an_error_of_the_start_is_subtracted(point, name, size):
    record, smooth = point
    true = PropagatedMotion.of(record, smooth)
    direction, gravity = true.start.direction, true.start.gravity
    if name in START:
        across = transverse_axes(direction[np.newaxis])[START.index(name)][0]
        wrong = replace(true, start=WindStart(direction + size * across, gravity))
    else:  # the axes are those of the motion that is linearised about, which is the wrong one
        wrong = replace(true, start=WindStart(direction, gravity + np.array([0.5, -0.2, 0.1])))
        change = size * gravity_axes(NominalMotion(record, wrong.start))[1][:, GRAVITY_ERRORS.index(name)]
        true = replace(true, start=WindStart(direction, wrong.start.gravity - change))
    found = wrong.less(record, {(MOTION, name): size})
    np.testing.assert_allclose(found.start.direction, true.start.direction, atol=size**2)
    np.testing.assert_allclose(found.start.gravity, true.start.gravity, atol=1e-12)


def test_an_error_of_the_walk_is_subtracted(point):
    record, smooth = point
    true = PropagatedMotion.of(record, smooth)
    wrong = replace(true, walk=true.walk + walk_sines(record, 3)[0] @ np.array([0.5, 0.0, -1.0 + 2.0j]))
    errors = {
        (MOTION, walk_name(axis, number)): size
        for number, both in enumerate([(0.5, 0.0), (0.0, 0.0), (-1.0, 2.0)])
        for axis, size in zip("yz", both, strict=True)
    }
    np.testing.assert_allclose(wrong.less(record, errors).walk, true.walk, atol=1e-15)


def test_the_meridian_of_a_motion_far_from_that_before_has_no_turn_from_sample_to_sample(point):
    """Next to the meridian before, each sample would be on whichever side of half a turn it happens to fall."""
    record, smooth = point
    motion = PropagatedMotion.of(record, smooth)
    other = replace(motion, walk=-1.5 * motion.walk - 1.2 * np.mean(smooth.crossflow))
    _, moved = linearisation_point(smooth, ReconstructionConfig(), other)
    assert np.max(np.abs(np.diff(moved.motion.windward_meridian))) <= np.pi
