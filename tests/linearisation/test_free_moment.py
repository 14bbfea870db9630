"""The shapes of a moment that may be anything smooth."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.inference.problem import Problem
from brv_hypo.inference.unmodelled import ORDINARY, SHAPES, free_moment
from brv_hypo.model.baseline import StaticMoment
from tests.chains import prepared


def problem() -> Problem:
    return prepared()


@pytest.mark.parametrize("shape", SHAPES)
def test_every_shape_gives_columns_of_its_own(shape: str) -> None:
    """None is empty, and splines of one shape are independent."""
    frame, columns = free_moment(problem(), (shape,))
    complex_moments = frame.moments(columns)
    moments = np.concatenate([complex_moments.real, complex_moments.imag])
    assert np.all(np.linalg.norm(moments, axis=0) > 0.0)
    singular = np.linalg.svd(moments / np.linalg.norm(moments, axis=0), compute_uv=False)
    assert singular[-1] > 1e-3 * singular[0]


def test_shapes_together_are_those_alone() -> None:
    frame, columns = free_moment(problem(), ORDINARY)
    together = frame.moments(columns)
    alone = []
    for shape in ORDINARY:
        frame, columns = free_moment(problem(), (shape,))
        alone.append(frame.moments(columns))
    np.testing.assert_allclose(together, np.concatenate(alone, axis=1), rtol=1e-12)


def test_stiffness_is_a_shape_of_the_baseline() -> None:
    """A constant stiffness is a sum of the splines of that shape."""
    frame, columns = free_moment(problem(), ("stiffness",))
    static = next(column for column in problem().baseline if column.term == "C_malpha")
    wanted = problem().frame.moments((static,))[:, 0]
    moments = frame.moments(columns)
    values = np.linalg.lstsq(moments, wanted, rcond=None)[0]
    np.testing.assert_allclose(moments @ values, wanted, atol=1e-9 * np.abs(wanted).max())
    assert static.mechanism == StaticMoment.name
