from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from brv_hypo.errors import UnanswerableError
from brv_hypo.motion import reconstruct
from brv_hypo.simulation import simulate

FLIGHT = simulate("research_cone", seed=91).flight
NOTHING = np.zeros(FLIGHT.samples)


@pytest.mark.parametrize(
    ("change", "remedy"),
    [
        ({"q": NOTHING, "r": NOTHING}, "dead or missing gyro"),
        ({"p": NOTHING, "q": NOTHING, "r": NOTHING, "ax": NOTHING, "ay": NOTHING, "az": NOTHING}, "dead"),
        ({"q": FLIGHT.q * 1e8, "r": FLIGHT.r * 1e8}, "units"),
        ({"dynamic_pressure": np.full(FLIGHT.samples, 1e-9)}, "not yet in the air"),
    ],
)
def test_records_without_an_answer_are_refused_with_a_remedy(change: dict, remedy: str) -> None:
    with pytest.raises(UnanswerableError, match=remedy):
        reconstruct(replace(FLIGHT, **change))


def test_a_quiet_flight_is_not_refused() -> None:
    """A hundredth of a degree a second is motion all the same."""
    assert (
        reconstruct(replace(FLIGHT, q=FLIGHT.q * 1e-3, r=FLIGHT.r * 1e-3)).motion.alpha.size == FLIGHT.samples
    )
