"""Imperfections of the independent simulation: each changes the record, none is there unless it is requested."""

from __future__ import annotations

import numpy as np
import pytest

from tests.studies.independent.flights import make_flight
from tests.studies.independent.imperfect_study import Outcome, count, report
from tests.studies.independent.imperfections import KINDS, lines, none, ordinary
from tests.studies.independent.mechanisms import Planted
from tests.studies.independent.vehicles import BICONIC, CONE

CHANNELS = ("p", "q", "r", "ax", "ay", "az", "velocity", "dynamic_pressure")
PLAIN = make_flight("cone", "none", seed=5, duration=1.0)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "gradual_onset"])
def test_each_kind_changes_the_record(kind: str) -> None:
    made = make_flight("cone", "none", seed=5, duration=1.0, imperfect=(kind,))
    assert any(np.any(getattr(made.flight, name) != getattr(PLAIN.flight, name)) for name in CHANNELS)
    assert all(np.all(np.isfinite(getattr(made.flight, name))) for name in CHANNELS)


def test_nothing_is_the_default() -> None:
    assert ordinary(CONE, (), np.random.default_rng(1)) == none(CONE)
    made = make_flight("cone", "none", seed=5, duration=1.0, imperfect=("turbulence",), imperfect_size=0.0)
    for name in CHANNELS:
        np.testing.assert_allclose(getattr(made.flight, name), getattr(PLAIN.flight, name), rtol=1e-7, atol=1e-7)


def test_a_kind_is_drawn_the_same_beside_others() -> None:
    alone, beside = (ordinary(BICONIC, kinds, np.random.default_rng(3)) for kinds in (("cg_drift",), KINDS))
    assert alone.cg_drift == beside.cg_drift


def test_a_random_history_has_the_requested_size() -> None:
    history = lines(np.random.default_rng(2), 2.0, 1.0, 50.0)
    values = np.array([history.at(place)[0] for place in np.linspace(0.0, 400.0, 40_000)])
    assert np.sqrt(np.mean(values**2)) == pytest.approx(2.0, rel=0.1)
    ahead, behind, rate = history.at(3.0 + 1e-6)[0], history.at(3.0 - 1e-6)[0], history.at(3.0)[1]
    assert (ahead - behind) / 2e-6 == pytest.approx(rate, rel=1e-5)


@pytest.mark.parametrize("onset", [0.0, 0.4])
def test_an_onset_has_a_width(onset: float) -> None:
    planted = Planted("damping", 1.0, 2.0, 3.0, onset=onset)
    assert planted.weight(1.7) == planted.weight(3.0) == 0.0
    assert planted.weight(2.3) == 1.0
    assert planted.weight(2.0) == (0.5 if onset else 1.0)


def test_the_report_counts_with_exact_intervals() -> None:
    assert count("x", [True] * 9 + [False]) == "x: 9 of 10 (90 %, 55 % to 100 %)".replace(" %", "%")
    right = Outcome(1, "slosh", "cone", "lag", 0.1, "named", "lag", "lag", 0.97, 0.5, 3.0, 0.2, {"lag delay": 2.5})
    lines = list(report([right]))
    assert "planted: named right: 1 of 1" in lines[0]
    assert any("lag delay: 0 of 1" in each for each in lines)
