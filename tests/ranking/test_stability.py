"""Who leads when a block is left out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from brv_hypo.arrays import FloatArray
from brv_hypo.mechanisms import Mechanism, Term
from brv_hypo.motion.motion import Motion
from brv_hypo.ranking.constants import REPEATED_ERRORS
from brv_hypo.ranking.stability import stability
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


def share_of(fits: list[HypothesisFit], blocks: tuple[int, ...]) -> float:
    leaving = LeavingOut(problem())
    return stability(problem(), fits, [leaving.of(fit.frame, fit.columns) for fit in fits], blocks)


def test_a_leader_that_every_block_supports_is_stable() -> None:
    assert share_of([fitted("none"), fitted("bodyfixed")], (BLOCKS,)) == 1.0


def test_the_order_of_the_fits_does_not_matter() -> None:
    fits = [null_ahead_by(0.0), fitted("bodyfixed")]
    assert share_of(fits, (BLOCKS,)) == share_of(fits[::-1], (BLOCKS,))


@pytest.mark.parametrize("repeated", [(BLOCKS,), (BLOCKS, BLOCKS)])
def test_a_leader_that_few_blocks_support_is_not(repeated: tuple[int, ...]) -> None:
    """With nearly the lead of the pulse made up, the null leads wherever a block of the pulse is missing."""
    lead = fitted("none").information - fitted("bodyfixed").information
    share = share_of([null_ahead_by(0.95 * lead), fitted("bodyfixed")], repeated)
    assert 1.0 / BLOCKS <= share < 1.0


def test_alone_a_hypothesis_always_leads() -> None:
    assert share_of([fitted("none")], (3,)) == 1.0


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
    assert share_of([null_ahead_by(ahead), fits[1]], ()) == pytest.approx(agree)
