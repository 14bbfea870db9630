"""A simulated flight: the same seed gives the same one; progress; what is no flight is refused."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.errors import UnanswerableError, UsageError
from brv_hypo.simulation import load_config, simulate
from tests.varied import varied

SHORT = load_config("research_cone", plant=("sticking",)).model_dump(exclude={"plantable"}) | {"duration": 1.0}
CONE = load_config(
    {
        **SHORT,
        "mechanisms": [
            {"mechanism": "sticking", "theta": {"delay": 0.1}, "terms": {"eps": 0.5}, "start": 0.2, "stop": 0.8}
        ],
    }
)


@pytest.mark.slow
def test_same_seed_same_flight() -> None:
    first, second = (simulate(CONE, seed=3).record.channels["q"] for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_what_is_planted_may_be_a_string_with_commas() -> None:
    one, other = (
        simulate("research_cone", seed=3, plant=each, duration=1.0) for each in ("lag,inplane", ["lag", "inplane"])
    )
    assert one.truth.planted == other.truth.planted == ("lag", "inplane")


def test_a_seed_is_not_negative() -> None:
    with pytest.raises(UsageError, match="seed"):
        simulate(CONE, seed=-1)


def test_progress_runs_from_start_to_end() -> None:
    reported: list[float] = []
    simulate(CONE, seed=1, progress=lambda fraction, text: reported.append(fraction))
    assert reported == sorted(reported)
    assert reported[0] < 0.05 < 0.6 < reported[-1] <= 1.0


@pytest.mark.parametrize(
    ("path", "value", "message"), [("start.altitude", 100.0, "expected 0 to"), ("aerodynamics.C_mq", 1e9, "diverges")]
)
def test_what_is_no_flight_is_refused(path: str, value: float, message: str) -> None:
    with pytest.raises(UnanswerableError, match=message):
        simulate(varied(CONE.model_copy(update={"duration": 0.1}), {path: value}), seed=1)
