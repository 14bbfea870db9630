"""The studies of what misleads a fit, in small: the full figures are those of their commands."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.likelihood import Segment, Status, fit
from tests.studies.likelihood.hard_study import (
    TrapStudy,
    hold_bias,
    print_hold,
    record_kinds,
    run_kind,
    stiff_kinds,
    trapped,
)
from tests.studies.likelihood.problems import held_short_period, oscillator, thinned, with_gap


@pytest.mark.thorough
def test_a_held_input_gives_no_bias_where_it_is_declared_as_held() -> None:
    assert np.abs(hold_bias(200)).max() < 0.02
    said: list[str] = []
    print_hold(3, 1, said.append)
    assert "bias without noise" in said[0]


def test_the_wrong_hold_is_a_bias() -> None:
    problem = held_short_period()
    segment = problem.simulate(200, seed=0)
    cubic = Segment(segment.t, segment.u, segment.y, segment.x0)
    declared, undeclared = (fit(problem.dynamics, problem.outputs, [s], problem.truth) for s in (segment, cubic))
    assert declared.nllf < undeclared.nllf - 10.0


@pytest.mark.parametrize(
    "name",
    [
        "held input, half missing",
        *(
            pytest.param(name, marks=pytest.mark.thorough)
            for name in ("both, unstable body", "oscillator, 1 sample a rad")
        ),
    ],
)
def test_spoiled_records_are_fitted_with_honest_errors(name: str) -> None:
    kind = next(kind for kind in record_kinds() if kind.name == name)
    found = run_kind(kind, 2, seed=3)
    assert not np.any(found.converged & found.beyond)
    assert found.score.shape == (2, len(kind.problem.truth))


def test_kinds_are_ten_so_that_trials_are_shared_evenly() -> None:
    assert len(record_kinds()) == 10
    assert len({kind.name for kind in (*record_kinds(), *stiff_kinds())}) == 10 + len(stiff_kinds())


def test_what_is_deceived_has_converged_below_the_best() -> None:
    found = TrapStudy(
        log_likelihood=np.array([100.0, 99.5, 50.0, 50.0]), converged=np.array([True, True, True, False]), best=100.0
    )
    assert found.solved.tolist() == [True, True, False, False]
    assert found.deceived.tolist() == [False, False, True, False]


@pytest.mark.slow
def test_a_stall_that_the_model_lacks_traps_the_first_starting_point_alone() -> None:
    whole, first_alone = trapped(4.0, starts=3, seed=2)
    assert whole.solved.all()
    assert not first_alone.solved.any()


def test_gaps_and_missing_samples_are_what_they_say() -> None:
    segment = oscillator(5.0).simulate(100, seed=0)
    gap = np.isnan(with_gap(segment, 0.5, 1.0).y[0])
    assert gap.sum() == pytest.approx(20, abs=1)
    assert np.flatnonzero(gap)[0] == 50
    assert np.isnan(thinned(segment, 0.5, np.random.default_rng(0)).y).mean() == pytest.approx(0.5, abs=0.15)


def test_a_known_noise_that_residuals_exceed_is_begun_from_others_too() -> None:
    """The cubic spring fitted by a linear one, its noise given: the first starting point is not the only one."""
    body = oscillator(2.0)
    segment = body.simulate(120, seed=0)
    y = segment.y + 0.3 * segment.y**3
    known = np.array([1e-4])
    bent = fit(body.dynamics, body.outputs, [Segment(segment.t, segment.u, y, segment.x0)], body.truth, noise=known)
    straight = fit(body.dynamics, body.outputs, [segment], body.truth, noise=known)
    assert len(straight.starting_points) == 1
    assert len(bent.starting_points) == 4
    assert straight.status is Status.CONVERGED
    np.testing.assert_array_equal(bent.noise_variance, known)
