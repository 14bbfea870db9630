"""Runs the checks that apply to an item."""

from __future__ import annotations

from brv_hypo.mechanisms.conformance.check import Outcome
from brv_hypo.mechanisms.conformance.effect import EFFECT_CHECKS
from brv_hypo.mechanisms.conformance.mechanism import MECHANISM_CHECKS
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect


def conformance(item: Mechanism | RecordEffect) -> tuple[Outcome, ...]:
    """The outcome of every check, in order; none stops the others."""
    if isinstance(item, Mechanism):
        return tuple(check.outcome(item) for check in MECHANISM_CHECKS)
    return tuple(check.outcome(item) for check in EFFECT_CHECKS)
