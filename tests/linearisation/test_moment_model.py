"""Moments to first order in what a record changes, those of before included."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from brv_hypo.arrays import ComplexArray
from brv_hypo.linearisation.moment_model import MomentModel
from brv_hypo.mechanisms.registry import parse_hypothesis
from brv_hypo.model.term import Regressor, TimeBasis
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.motion import Motion, crossflow_rate, recorded, with_crossflow
from tests.chains import prepared

DELAY = (("delay", 0.04),)
TERMS = {"static": ("C_malpha", ()), "lag": ("lag fraction", DELAY), "sticking": ("eps", DELAY)}


def model_of(name: str) -> tuple[MomentModel, InertialRecord]:
    """One term on the research cone's flight; what is made of the past follows the static moment."""
    problem = prepared()
    (made,) = problem.frame.reconstructions
    known = {**problem.frame.mechanisms, **{each.name: each for each in parse_hypothesis("lag+sticking")}}
    term, theta = TERMS[name]
    column = Regressor(name, term, theta, TimeBasis("constant"), "1")
    motion = recorded(made.motion)
    model = MomentModel(replace(made, motion=motion), known, (column,), np.ones(1), motion)
    return model, problem.records[0]


def exactly(model: MomentModel, xi: ComplexArray) -> ComplexArray:
    """The moment on the motion at another crossflow, evaluated there."""
    (column,), motion = model.columns, _at(model.motion, xi)
    terms = model.mechanisms[column.mechanism].terms(motion, dict(column.theta))
    term = next(term for term in terms if term.name == column.term)
    return motion.to_body(term.in_plane, term.out_of_plane)


def _at(motion: Motion, xi: ComplexArray) -> Motion:
    own = 1j * np.sin(motion.alpha) * np.exp(-1j * motion.windward_meridian)
    rate = crossflow_rate(motion, own) + np.gradient(xi - own, motion.time)
    return recorded(with_crossflow(replace(motion, history=None), xi, rate))


@pytest.mark.parametrize("name", TERMS)
def test_a_change_of_the_crossflow_is_right_to_first_order(name: str) -> None:
    """Half the change has a quarter of what is not of first order, or nothing."""
    model, record = model_of(name)
    own = model.reconstruction.crossflow
    time = record.time / record.time[-1]
    shift = 1e-3 * np.abs(own).min() * np.exp(2j * np.pi * time)
    before = exactly(model, own)
    kept = np.zeros((time.size, 1))
    errors, sizes = [], []
    for share in (1.0, 0.5):
        expected = exactly(model, own + share * shift) - before
        found = model.changes([(record, own + share * shift)], [(record, own)], kept)[:, 0]
        errors.append(float(np.linalg.norm(found - expected)))
        sizes.append(float(np.linalg.norm(expected)))
    assert errors[0] < 2e-3 * sizes[0]
    assert errors[1] < 0.3 * errors[0] or errors[1] < 1e-7 * sizes[1]
