"""Seconds of a fit on 1,080 samples, errors of the record within their tolerances.

Run by `pytest tests/identification/test_speed.py -m slow --benchmark-enable`.
"""

from __future__ import annotations

import pytest

from brv_hypo.identification import identify
from tests.studies.identification.study import CASES, flights, trial


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_seconds_of_a_fit(benchmark, case):
    ((simulated, flight),) = flights(case, 1, seed=7, tolerances=1.0)
    work = trial(simulated, flight.window(None, float(flight.time[1079])))
    found = benchmark(identify, work.frame, work.columns, work.values)
    assert found.status == "converged"
    assert sum(left.shape[1] for left in found.innovations) >= 1075
