"""What is planted is what is tested: the simulator and the regression add up the same moment."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.mechanisms import find
from brv_hypo.mechanisms.conformance import sample_motion, uniform_time
from brv_hypo.model.term import TimeBasis, candidates, evaluated, theta_grid
from brv_hypo.simulation.vehicle import Planted


@pytest.mark.parametrize("name", ["lag", "magnus", "bodyfixed"])
@pytest.mark.parametrize("time_basis", [TimeBasis("constant"), TimeBasis("jump", 0.7), TimeBasis("ramp", 0.5, 1.5)])
def test_the_planted_moment_is_the_sum_of_the_columns_tested(name: str, time_basis: TimeBasis) -> None:
    mechanism, motion = find(name), sample_motion(uniform_time())
    theta = theta_grid(mechanism)[0]
    columns = {
        column.term: column.at(theta, time_basis) for column in candidates(mechanism, motion, np.array([0.7]), [theta])
    }
    coefficients = {term: np.asarray(0.1 * (k + 1.0)) for k, term in enumerate(columns)}
    planted = Planted(mechanism, dict(theta), coefficients, time_basis).contribution(motion)
    terms = evaluated(list(columns.values()), {name: mechanism}, motion)
    weights = [coefficients[term] * column.time_basis(motion.time) for term, column in columns.items()]
    for channel, found in zip(("in_plane", "out_of_plane"), planted, strict=True):
        expected = np.einsum("kn,kn->n", weights, [getattr(term, channel) for term in terms])
        np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-15)
    assert max(np.max(np.abs(each)) for each in planted) > 0.0
