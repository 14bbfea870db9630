"""What outside the list would explain a flight instead of the leader."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from brv_hypo import compare, simulate
from brv_hypo.comparison.judgement import outside
from brv_hypo.comparison.with_processes import Pair
from brv_hypo.mechanisms import find, use_plugin_files
from tests.comparison.test_judgement import judged_cone


@cache
def found_outside() -> dict[str, tuple[str, Pair]]:
    """Beside a body-fixed moment from 2 to 4 s, by name."""
    return {each[1].fit.name: each for each in outside(judged_cone("bodyfixed"), {"bodyfixed": (find("bodyfixed"),)})}


@pytest.mark.thorough
def test_moments_of_other_shapes_and_one_that_turns_are_tried() -> None:
    found = found_outside()
    assert set(found) == {"unlisted_moment", "turning_moment"}
    terms = {column.term for column in found["unlisted_moment"][1].fit.selected}
    assert not any("body-fixed" in term.replace("body-fixed by alpha", "") for term in terms)
    assert found["unlisted_moment"][0].startswith("a moment that no mechanism on the list has (")
    assert all(term in found["unlisted_moment"][0] for term in terms)
    assert "turning in the body at" in found["turning_moment"][0]


@pytest.mark.thorough
def test_what_is_outside_has_an_evidence_on_the_same_rows() -> None:
    judged = judged_cone("bodyfixed")
    for _, each in found_outside().values():
        assert each.evidence.rows is judged.rows
        assert each.evidence.terms.x.shape[1] == len(each.fit.selected) + len(each.fit.nonlinear)
        assert each.level < judged.leading.level - 100.0


@pytest.mark.thorough
def test_a_leader_of_which_nothing_is_specific_is_no_likelier_than_a_change_that_many_things_bring(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    judged, listed = judged_cone("inplane"), {"inplane": (find("inplane"),)}
    assert not any(words.startswith("a change of") for words, _ in outside(judged, listed))
    monkeypatch.setattr("brv_hypo.comparison.judgement.SPECIFIC", float("inf"))
    (words, pair), *_ = outside(judged, listed)
    assert pair == judged.leading
    assert words == "a change of C_malpha alone, which is not specific to inplane"


ONE_TERM = """
from brv_hypo.mechanisms import Mechanism, Term, hookimpl

class OneTerm(Mechanism):
    name, title, claims, source = "one_term", "an in-plane moment of one term", "that moment", "a test"
    time_variation = ("constant", "jump")

    def terms(self, motion, theta):
        return (Term("k", {law}, 0.0 * motion.alpha, "1"),)

@hookimpl
def brv_hypo_mechanisms():
    return [OneTerm()]
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "planted", "seed", "said"),
    [
        ("motion.alpha * (motion.mach - 5.0)", {"C_malpha": 0.0162}, 3, "a change of C_malpha alone"),
        ("(motion.p * motion.rate_factor) ** 2", {"C_m0": 3.5e-4}, 18, "a constant moment in plane"),
        ("(motion.p * motion.rate_factor) ** 2", {"C_m0": 3.5e-4}, 19, "a constant moment in plane"),
    ],
)
def test_a_mechanism_of_the_same_shape_with_fewer_terms_is_not_named(
    tmp_path: Path, law: str, planted: dict[str, float], seed: int, said: str
) -> None:
    """A change of one coefficient: inplane, with another besides, and a mechanism of one term explain it alike."""
    file = tmp_path / "one_term.py"
    file.write_text(ONE_TERM.format(law=law))
    use_plugin_files([file])
    change = [{"mechanism": "inplane", "terms": planted, "start": 2.0, "stop": 4.0}]
    flight = simulate("research_cone", seed=seed, mechanisms=change)
    verdict = compare(flight, mechanisms=["inplane", "bodyfixed", "one_term"], maximum_likelihood="none").verdict
    assert (verdict.winner, verdict.outcome) == (None, "undecided")
    assert said in verdict.reason


# Spline coefficients of a moment fixed in the body, of 8 to 10 % of the moment's rms in all.
GROWS_AND_FADES = [-12, 2, 10, 0, -6, 3, 8, -9, 2, 6, -4, 0]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [102, pytest.param(100, marks=pytest.mark.slow)])
def test_a_large_process_beside_drawn_errors_is_adequate(seed: int) -> None:
    """The errors that make up for a moment without processes are not those beside it: linear about these, 1.1 to 1.4
    times the noise remained.
    """
    terms = {f"body_change 0 {k}": 8e-5 * value for k, value in enumerate(GROWS_AND_FADES)}
    planted = [{"mechanism": "body_change", "terms": terms}]
    flown = simulate("research_cone", seed=seed, mechanisms=planted, instruments={"draw": 1.0})
    verdict = compare(flown, mechanisms=["lag", "bodyfixed"], maximum_likelihood="none").verdict
    assert verdict.winner == "none"
    assert verdict.adequacy.ratio < 1.05
    assert verdict.processes[0].name == "body_change"


@pytest.mark.slow
def test_a_wrong_ratio_of_inertias_that_processes_take_up_is_warned_of() -> None:
    flight = simulate("blunt_capsule", seed=7, instruments={"draw": 1.0}, plant=["bodyfixed"]).flight
    vehicle = flight.vehicle
    swapped = replace(flight, vehicle=replace(vehicle, ixx=vehicle.iyy, iyy=vehicle.ixx))
    for each, wrong in ((flight, False), (swapped, True)):
        found = compare(each, mechanisms=["bodyfixed"], maximum_likelihood="none")
        said = [text for text in found.warnings if "inertia_ratio" in text]
        assert bool(said) is wrong


@pytest.mark.slow
def test_a_wrong_place_of_the_accelerometers_has_its_size_by_the_data_alone() -> None:
    """Its tolerance draws a fitted error towards nothing: a fifth of it remained."""
    flight = simulate("blunt_capsule", seed=7, instruments={"draw": 1.0}, plant=["bodyfixed"]).flight
    x, y, z = flight.vehicle.accelerometer_position
    misplaced = replace(flight, vehicle=replace(flight.vehicle, accelerometer_position=(x + 0.1, y, z)))
    found = compare(misplaced, mechanisms=["bodyfixed"], maximum_likelihood="none")
    first = found.record_errors[0]
    assert first.name == "accel_position x"
    assert abs(first.value) < 0.05 < abs(first.without_tolerance)
    assert first.without_tolerance == pytest.approx(-0.1, abs=0.02)
    assert f"is {first.without_tolerance:.3g}, " in found.conclusion()


SOME_MOMENT = '''
import numpy as np
from brv_hypo.mechanisms import Mechanism, Term, hookimpl


class SomeMoment(Mechanism):
    """A moment of some shape."""

    name, title, claims, source = "some_moment", "some moment", "a moment of some shape", "this test"

    def terms(self, motion, theta):
        """In plane and across it."""
        moment = SHAPE
        return (Term("k", moment.real.copy(), moment.imag.copy()),)


@hookimpl
def brv_hypo_mechanisms():
    return [SomeMoment()]
'''


TWO_LOBED, SQUARE = "1j * motion.alpha * np.sin(2.0 * motion.windward_meridian)", "1j * motion.alpha**2"
BY_ALPHA = "motion.alpha * np.exp(1j * (motion.windward_meridian + 0.5))"
ASKEW = "(1.0 + 0.5j) * np.ones_like(motion.alpha)"  # a constant moment at an angle to the windward plane


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("shape", "size", "listed", "said"),
    [
        pytest.param(TWO_LOBED, 0.01, ["sticking", "bodyfixed"], "two-lobed side moment", marks=pytest.mark.slow),
        (BY_ALPHA, 0.01, ["lag", "bodyfixed"], "body-fixed by alpha cosine and body-fixed by alpha sine"),
        *(
            pytest.param(
                ASKEW, size, ["inplane", "bodyfixed"], "constant in plane and constant across", marks=pytest.mark.slow
            )
            for size in (5e-4, 4e-5)
        ),
        pytest.param(SQUARE, 0.1, ["lag"], "nonlinear across", marks=pytest.mark.slow),
        pytest.param(SQUARE, 0.1, ["lag", "bodyfixed"], "nonlinear across", marks=pytest.mark.slow),
    ],
)
def test_a_cause_that_is_on_no_list_is_announced_with_its_shape(
    tmp_path: Path, shape: str, size: float, listed: list[str], said: str
) -> None:
    """Mechanisms on the list describe parts of it beside processes; none may lead, or decide whether it is detected."""
    path = tmp_path / "some_moment.py"
    path.write_text(SOME_MOMENT.replace("SHAPE", shape))
    use_plugin_files([path])
    planted = [{"mechanism": "some_moment", "terms": {"k": size}, "start": 1.7, "stop": 4.2}]
    flown = simulate("research_cone", seed=51, mechanisms=planted, instruments={"draw": 1.0})
    use_plugin_files([])
    verdict = compare(flown, mechanisms=listed, maximum_likelihood="none").verdict
    assert verdict.outcome == "none adequate"
    assert verdict.probability["other"] > 0.9
    assert said in verdict.reason
