"""When a comparison estimates by likelihood, and what that says of the record's own errors."""

from __future__ import annotations

import pytest

from brv_hypo.comparison import CompareConfig
from brv_hypo.comparison.compare import identify_credible
from brv_hypo.comparison.result import Verdict
from brv_hypo.inference.fit import fit_hypothesis
from tests.chains import prepared
from tests.studies.independent.instrument_errors import estimated_errors
from tests.studies.independent.study import drawn_flight

QUICK = CompareConfig(mechanisms=("damping",), maximum_likelihood="quick")


@pytest.mark.slow
@pytest.mark.parametrize("seed", [400004, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (400005, 400013))])
def test_errors_of_the_record_are_reported_whole(seed: int) -> None:
    """What a linearisation subtracted from the record before is part of them: it was 60 standard errors once."""
    found = list(estimated_errors(drawn_flight(seed, seed - 400000, "tactical", 1.0, 0)))
    assert len(found) >= 4
    for each in found:
        assert abs(each.scaled) < 4.0, each.name


@pytest.mark.parametrize(("extent", "adequate", "run"), [("quick", True, 1), ("quick", False, 0), ("full", False, 1)])
def test_quick_maximum_likelihood_is_of_none_only_where_it_is_adequate(extent: str, adequate: bool, run: int) -> None:
    problem = prepared()
    fit = fit_hypothesis(problem, "none", ())
    said: list[str] = []
    config = QUICK.model_copy(update={"maximum_likelihood": extent})
    verdict = Verdict(
        winner="none" if adequate else None,
        outcome="named" if adequate else "none adequate",
        equivalent=("none",) if adequate else (),
        probability={"none": 1.0, "other": 0.0} if adequate else {"none": 0.0, "other": 1.0},
        reason="",
    )
    found = identify_credible(problem, [fit], verdict, config, said.append)
    assert [each is not None for each in found.values()] == ([True] * run or [False])
    assert len(said) == run
