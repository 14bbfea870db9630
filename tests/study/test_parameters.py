"""Planted parameters find their estimates, and the effect its size."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.comparison.result import DerivedEstimate, RankedHypothesis, TermEstimate
from brv_hypo.simulation import Truth
from brv_hypo.simulation.config import PlantedConfig
from brv_hypo.study.run import effect_size, estimates
from tests.flights import flown, nominal


def term(name, value, start, *, mechanism="sticking", f_ratio=50.0, delay=0.12):
    return TermEstimate(
        name=name,
        mechanism=mechanism,
        channel="out-of-plane",
        value=value,
        std_error=0.01,
        f_ratio=f_ratio,
        units="1",
        region_s=None if start is None else (start, 6.0),
        delay_s=delay,
    )


def derived(name, value, start=None, units="s"):
    region = None if start is None else (start, 6.0)
    return DerivedEstimate(name=name, value=value, std_error=0.02, units=units, region_s=region)


def hypothesis(terms, items):
    return RankedHypothesis(
        rank=1,
        mechanism="any",
        f_ratio=1.0,
        cp=1.0,
        prediction_error=1.0,
        prediction_ratio=1.0,
        r2=1.0,
        bic=1.0,
        log_likelihood=1.0,
        n_terms=len(terms),
        n_effective=100.0,
        terms=tuple(terms),
        derived=tuple(items),
    )


STICKING = PlantedConfig(mechanism="sticking", theta={"delay": 0.12}, terms={"eps": 0.6}, start=2.0, stop=4.0)


def test_delay_knots_and_fraction_are_those_of_the_leading_term():
    fitted = hypothesis(
        [
            term("jump in eps", 0.1, 2.9, f_ratio=3.0, delay=0.3),
            term("jump in eps", 0.58, 2.02),
            term("jump in eps", -0.61, 4.01),
        ],
        [
            derived("sticking delay", 0.3),
            derived("sticking delay", 0.12),
            *(derived("sticking knot", knot) for knot in (2.9, 2.02, 4.01)),
        ],
    )
    found = {item.name: item for item in estimates([STICKING], fitted)}
    assert {name: item.value for name, item in found.items()} == {
        "delay": 0.12,
        "onset": 2.02,
        "end": 4.01,
        "eps": 0.58,
    }
    assert found["eps"].sigmas == pytest.approx(-2.0)
    assert found["onset"].kind == "knot"


def test_one_knot_does_not_serve_for_onset_and_end():
    found = {item.name: item for item in estimates([STICKING], hypothesis([], [derived("sticking knot", 3.0)]))}
    assert found["onset"].value == 3.0
    assert found["end"].value is None
    assert found["end"].sigmas is None


def test_a_change_far_from_the_onset_is_no_estimate_of_it():
    found = {item.name: item for item in estimates([STICKING], hypothesis([term("jump in eps", 0.6, 3.5)], []))}
    assert found["eps"].value is None


def test_an_angle_is_taken_on_the_branch_next_to_the_truth():
    planted = PlantedConfig(
        mechanism="bodyfixed", terms={"C_b cos(phi_b)": -1.0e-3, "C_b sin(phi_b)": 1.0e-5}, start=2.0, stop=4.0
    )
    fitted = hypothesis([], [derived("phi_b", -3.13, 2.0, "rad"), derived("C_b", 1e-3, 2.0, "1")])
    found = {item.name: item for item in estimates([planted], fitted)}
    assert found["phi_b"].value == pytest.approx(2 * np.pi - 3.13)
    assert abs(found["phi_b"].value - found["phi_b"].truth) < 0.03
    assert found["C_b"].truth == pytest.approx(1e-3, rel=1e-3)


def test_terms_that_were_planted_throughout_are_compared_with_constant_ones():
    planted = PlantedConfig(mechanism="damping", terms={"C_damping": 50.0})
    fitted = hypothesis(
        [
            term("jump in C_damping", 3.0, 2.0, mechanism="damping", delay=None),
            term("C_damping", 49.0, None, mechanism="damping", delay=None),
        ],
        [],
    )
    (found,) = estimates([planted], fitted)
    assert (found.name, found.value) == ("C_damping", 49.0)


def truth_of(in_plane, out_of_plane, whole) -> Truth:
    zeros = np.zeros_like(in_plane)
    return Truth(
        time=np.arange(in_plane.size) * 0.01,
        alpha=zeros,
        windward_meridian=zeros,
        C_m=zeros,
        C_n=zeros,
        C_N=whole,
        C_Z=zeros,
        planted_in_plane=in_plane,
        planted_out_of_plane=out_of_plane,
        planted=("any",),
        parameters={},
    )


def test_the_effect_is_measured_while_it_lasts():
    lasts = np.arange(100) >= 75
    whole = np.where(lasts, 2.0, 50.0)
    assert effect_size(truth_of(0.2 * lasts, 0.1 * lasts, whole)) == pytest.approx((0.1, 0.05))


def test_nothing_planted_is_no_effect():
    assert effect_size(nominal().truth) == (0.0, 0.0)


@pytest.mark.slow
def test_the_effect_of_a_planted_flight_is_the_planted_columns_rms():
    truth = flown("research_cone", "sticking").truth
    lasts = (truth.time >= 2.0) & (truth.time < 4.0)
    whole = np.sqrt(np.mean((truth.C_N**2 + truth.C_Z**2)[lasts]))
    expected = np.sqrt(np.mean(truth.planted_out_of_plane[lasts] ** 2)) / whole
    in_plane, out_of_plane = effect_size(truth)
    assert in_plane < 1e-9
    assert out_of_plane == pytest.approx(expected, rel=0.02)
