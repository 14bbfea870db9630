"""Who leads, and what is said, when a comparison is repeated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import KNOT_SHIFTS, REPEATED_ERRORS
from brv_hypo.mechanisms import Mechanism, Term
from brv_hypo.motion import ReconstructionConfig, reconstruct
from brv_hypo.motion.config import Method
from brv_hypo.motion.motion import Motion
from brv_hypo.ranking.adequacy import Misfit
from brv_hypo.ranking.stability import (
    OPEN_LOOP,
    Repeated,
    agrees,
    on_other_knots,
    on_other_motions,
    repetitions,
    stability,
    within_tolerances,
    without_blocks,
)
from brv_hypo.ranking.verdict import Contest, Score, Stability
from brv_hypo.regression.fit import HypothesisFit
from brv_hypo.regression.held_out import LeavingOut
from brv_hypo.regression.problem import Problem
from tests.ranking.pulse import fitted, problem

BLOCKS = 6
"""Of one second each: two of them hold the pulse."""


class Favoured(Mechanism):
    """Nothing of its own, but likelier than the Gaussian by `head_start`."""

    name = "favoured"
    title = claims = source = "a hypothesis for this test"

    head_start: float

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        return ()

    def log_likelihood(self, innovations: FloatArray, std_error: float) -> float:
        return super().log_likelihood(innovations, std_error) + self.head_start


def null_ahead_by(information: float) -> HypothesisFit:
    """The null hypothesis with its criterion lowered."""
    null = fitted("none")
    favour = Favoured(head_start=0.5 * information / null.efficiency)
    return replace(null, name=favour.name, mechanisms=(favour,))


def contest(fits: Sequence[HypothesisFit]) -> Contest:
    """The fits, of which the leader leaves nothing but noise and predicts best."""
    leader = min(fits, key=lambda fit: fit.information)
    scores = [Score(fit.name, fit.information, 1.0, (1.0 if fit is leader else 2.0,)) for fit in fits]
    return Contest(scores, Misfit(ratio=1.0, p_value=0.5, gain=-1e4))


def blocks_left_out(fits: Sequence[HypothesisFit], blocks: tuple[int, ...]) -> Repeated:
    leaving = LeavingOut(problem())
    return without_blocks(fits, [leaving.of(fit.frame, fit.columns) for fit in fits], blocks)


def shares(fits: Sequence[HypothesisFit], *kinds: Repeated) -> Stability:
    return stability(contest(fits), kinds)


def test_a_strong_effect_is_stable_in_every_kind_of_repetition() -> None:
    fits = [fitted("none"), fitted("bodyfixed")]
    leaving = LeavingOut(problem())
    kinds = repetitions(problem(), fits, [leaving.of(fit.frame, fit.columns) for fit in fits], (BLOCKS,))
    errors = sum(item.name in REPEATED_ERRORS for item in problem().rows.nuisances.items)
    assert [len(kind.each) for kind in kinds] == [BLOCKS, 2 * errors, len(KNOT_SHIFTS), len(OPEN_LOOP)]
    assert errors > 0
    assert shares(fits, *kinds) == Stability(1.0, 1.0)


def test_the_order_of_the_fits_does_not_matter() -> None:
    fits = [null_ahead_by(0.0), fitted("bodyfixed")]
    found = shares(fits, blocks_left_out(fits, (BLOCKS,)))
    assert shares(fits[::-1], blocks_left_out(fits[::-1], (BLOCKS,))) == found


@pytest.mark.parametrize("repeated", [(BLOCKS,), (BLOCKS, BLOCKS)])
def test_a_leader_that_few_blocks_support_is_not(repeated: tuple[int, ...]) -> None:
    """With nearly the lead of the pulse made up, the null leads wherever a block of the pulse is missing."""
    lead = fitted("none").information - fitted("bodyfixed").information
    fits = [null_ahead_by(0.95 * lead), fitted("bodyfixed")]
    found = shares(fits, blocks_left_out(fits, repeated))
    assert 1.0 / BLOCKS <= found.leader < 1.0
    assert found.outcome < 1.0


def test_a_name_near_the_border_keeps_its_leader_and_not_its_outcome() -> None:
    """Led by a little more than a name needs: with less of the record it still leads, and is undecided."""
    fits = [null_ahead_by(0.0), fitted("bodyfixed")]
    whole = {"favoured": 0.0, "bodyfixed": -12.0}
    each = [{"favoured": 0.0, "bodyfixed": ahead} for ahead in (-13.0, -4.0, -2.0, -11.0)]
    assert shares(fits, Repeated(whole, each)) == Stability(0.5, 1.0)


def test_two_that_take_turns_in_the_lead_are_undecided_all_the_same() -> None:
    fits = [null_ahead_by(0.0), fitted("bodyfixed")]
    each = [{"favoured": 0.0, "bodyfixed": ahead} for ahead in (-1.0, 1.0)]
    assert shares(fits, Repeated({"favoured": 0.0, "bodyfixed": -0.5}, each)) == Stability(1.0, 0.5)


def test_alone_a_hypothesis_always_leads() -> None:
    fits = [fitted("none")]
    assert shares(fits, blocks_left_out(fits, (3,))) == Stability(1.0, 1.0)


def test_from_knots_half_a_spacing_off_the_same_are_found() -> None:
    found = on_other_knots(problem(), [fitted("none"), fitted("bodyfixed")])
    leads = [found.whole["bodyfixed"], *(each["bodyfixed"] for each in found.each)]
    assert len(found.each) == len(KNOT_SHIFTS)
    assert max(leads) - min(leads) < 1.0


def test_a_lead_that_other_knots_do_not_find_is_not_stable() -> None:
    """The leader's residual is less than what any knots about its own leave."""
    pulse = fitted("bodyfixed")
    lucky = replace(pulse, residual=0.95 * pulse.residual)
    ahead = fitted("none").information - lucky.information - 30.0
    fits = [null_ahead_by(ahead), lucky]
    assert contest(fits).leader.name == "bodyfixed"
    assert lucky.information + 30.0 < pulse.information
    assert shares(fits, on_other_knots(problem(), fits)) == Stability(0.0, 0.0)


def test_without_knots_there_is_no_other_choice_of_them() -> None:
    assert on_other_knots(problem(), [fitted("none")]).each == []


def test_hypotheses_far_behind_keep_their_knots() -> None:
    fits = [null_ahead_by(1e5), fitted("bodyfixed")]
    assert on_other_knots(problem(), fits).each == []


def test_other_methods_lead_to_a_strong_effect_too() -> None:
    fits = [fitted("none"), fitted("bodyfixed")]
    repeated = on_other_motions(problem(), fits)
    assert len(repeated.each) == len(OPEN_LOOP)
    assert shares(fits, repeated) == Stability(1.0, 1.0)


def test_what_leads_on_the_joint_motion_alone_is_not_stable() -> None:
    """The motion of other methods leaves more, and the pulse leads by half as much there."""
    lead = fitted("none").information - fitted("bodyfixed").information
    fits = [null_ahead_by(0.7 * lead), fitted("bodyfixed")]
    assert shares(fits, on_other_motions(problem(), fits)) == Stability(0.0, 0.0)


def test_what_would_drown_in_a_methods_error_is_not_asked_of_it() -> None:
    """The nearest rival is as likely as the leader: no other motion could tell."""
    pulse = fitted("bodyfixed")
    twin = replace(pulse, name="twin", residual=1.001 * pulse.residual)
    assert on_other_motions(problem(), [fitted("none"), pulse, twin]).each == []


@pytest.mark.parametrize("method", OPEN_LOOP)
def test_a_method_that_the_accelerometers_contradict_has_failed(method: Method) -> None:
    """As it stands it errs by what it says; a quarter turn off, the force does not follow it."""
    own = problem().frame.reconstructions[0]
    other = reconstruct(own.flight, ReconstructionConfig(method=method))
    turned = replace(other.motion, windward_meridian=other.motion.windward_meridian + 0.5 * np.pi)
    assert agrees(problem().records[0], own, other)
    assert not agrees(problem().records[0], own, replace(other, motion=turned))


def expected_elsewhere() -> list[Problem]:
    """The problem with each error of `REPEATED_ERRORS` expected a tolerance higher, then lower."""
    rows = problem().rows
    found = []
    for number, item in enumerate(rows.nuisances.items):
        for change in (1.0, -1.0) if item.name in REPEATED_ERRORS else ():
            items = list(rows.nuisances.items)
            items[number] = replace(item, present=item.present + change)
            changed = replace(rows, nuisances=replace(rows.nuisances, items=tuple(items)))
            found.append(replace(problem(), rows=changed))
    return found


def refitted(where: Problem, fit: HypothesisFit) -> float:
    """The criterion of a fit's columns in another problem, fitted from the beginning."""
    design = where.design(where.frame if not fit.selected else fit.frame, fit.columns)
    residual = where.response - design @ np.linalg.lstsq(design, where.response, rcond=None)[0]
    return replace(fit, residual=residual).information


@pytest.mark.parametrize("between", [0.25, 0.5, 0.75])
def test_other_inertia_and_pressure_within_tolerances_are_repetitions(between: float) -> None:
    """Of two nearly equal ones, the leader is that which a fit from the beginning finds in each."""
    fits = [fitted("none"), fitted("bodyfixed")]
    leads = [refitted(each, fits[0]) - refitted(each, fits[1]) for each in expected_elsewhere()]
    assert max(leads) > min(leads)
    ahead = min(leads) + between * (max(leads) - min(leads))
    null_leads = fits[0].information - ahead < fits[1].information
    agree = np.mean([(lead < ahead) == null_leads for lead in leads])
    near = [null_ahead_by(ahead), fits[1]]
    assert shares(near, within_tolerances(problem(), near)).leader == pytest.approx(agree)
