from __future__ import annotations

import pytest

from brv_hypo.identification import Identification, identify
from brv_hypo.simulation import SimulatedFlight
from tests.studies.identification.study import Trial, flights, trial


@pytest.fixture(scope="session")
def bodyfixed() -> tuple[SimulatedFlight, Trial, Identification]:
    """A flight with a body-fixed moment, its true model regressed and identified."""
    ((simulated, flight),) = flights("bodyfixed", 1, seed=7)
    work = trial(simulated, flight)
    return simulated, work, identify(work.frame, work.columns, work.values)
