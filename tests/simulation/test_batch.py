"""A batch of flights is one more array axis: the same flights, faster."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.errors import UnanswerableError, UsageError
from brv_hypo.simulation import load_config, simulate, simulate_batch

SHORT = load_config("research_cone", plant=("sticking",)).model_dump(exclude={"plantable"}) | {"duration": 1.0}
CONE = load_config(
    {
        **SHORT,
        "mechanisms": [
            {"mechanism": "sticking", "theta": {"delay": 0.1}, "terms": {"eps": 0.5}, "start": 0.2, "stop": 0.8}
        ],
    }
)


def test_a_flight_of_a_batch_is_that_flight_alone() -> None:
    """Coefficients, delays, regions, vehicle, start and instruments may all differ from flight to flight."""
    variations = {
        "start.alpha": [0.03, 0.05],
        "mechanisms.0.terms.eps": [0.2, 0.6],
        "mechanisms.0.theta.delay": [0.05, 0.13],
        "mechanisms.0.start": [0.2, 0.305],
        "vehicle.ixy": [0.5, -0.5],
        "instruments.errors.gyro_bias.q": [0.0, 0.2],
    }
    together = simulate_batch(CONE, seeds=(5, 6), variations=variations)
    for i, flight in enumerate(together):
        alone = simulate_batch(CONE, seeds=(5 + i,), variations={k: v[i] for k, v in variations.items()})[0]
        assert flight.seed == alone.seed == 5 + i
        assert flight.truth.parameters == alone.truth.parameters
        for name in ("q", "az", "velocity"):
            # Nodes are set by all flights' regions, so that the truncation error differs a little.
            np.testing.assert_allclose(flight.record.channels[name], alone.record.channels[name], rtol=1e-6, atol=1e-6)
        assert flight.truth.planted_share == pytest.approx(alone.truth.planted_share, rel=1e-4)


@pytest.mark.slow
def test_same_seed_same_flight() -> None:
    first, second = (simulate(CONE, seed=3).record.channels["q"] for _ in range(2))
    np.testing.assert_array_equal(first, second)
    for flight in simulate_batch(CONE, seeds=(3, 3)):
        np.testing.assert_allclose(flight.record.channels["q"], first, atol=1e-12)


@pytest.mark.parametrize(
    ("variations", "message"),
    [
        ({"start.alfa": [1.0, 2.0]}, "does not lead to a number"),
        ({"start": [1.0, 2.0]}, "does not lead to a number"),
        ({"mechanisms.3.terms.eps": [1.0, 2.0]}, "does not lead to a number"),
        ({"start.alpha": [1.0, 2.0, 3.0]}, r"expected one value or \(2,\)"),
        ({"vehicle.mass": [1.0, -2.0]}, "flight 1 of the batch.*vehicle.mass"),
        ({"duration": [1.0, 2.0]}, "share one time grid"),
    ],
)
def test_bad_variations_are_refused(variations: dict[str, list[float]], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        simulate_batch(CONE, seeds=(1, 2), variations=variations)


@pytest.mark.parametrize("seeds", [(), (-1,)])
def test_seeds_are_needed_and_not_negative(seeds: tuple[int, ...]) -> None:
    with pytest.raises(UsageError, match="seeds"):
        simulate_batch(CONE, seeds=seeds)


def test_progress_runs_from_start_to_end() -> None:
    seen: list[float] = []
    simulate(CONE, seed=1, progress=seen.append)
    assert seen == sorted(seen)
    assert seen[0] < 0.05 < 0.6 < seen[-1] <= 1.0


@pytest.mark.parametrize(
    ("path", "value", "message"), [("start.altitude", 100.0, "expected 0 to"), ("aerodynamics.C_mq", 1e9, "diverges")]
)
def test_what_is_no_flight_is_refused(path: str, value: float, message: str) -> None:
    with pytest.raises(UnanswerableError, match=message):
        simulate_batch(CONE.model_copy(update={"duration": 0.1}), seeds=(1,), variations={path: value})
