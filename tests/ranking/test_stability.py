"""Who leads when a block is left out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import pytest

from brv_hypo.arrays import FloatArray
from brv_hypo.mechanisms import Mechanism, Term
from brv_hypo.motion.motion import Motion
from brv_hypo.ranking.stability import stability
from brv_hypo.regression.fit import HypothesisFit
from brv_hypo.regression.held_out import LeavingOut
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
    return stability(fits, [leaving.of(fit.frame, fit.columns) for fit in fits], blocks)


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
