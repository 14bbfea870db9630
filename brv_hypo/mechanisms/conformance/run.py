"""Runs the checks that apply to an item."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from brv_hypo.mechanisms.conformance.check import Outcome
from brv_hypo.mechanisms.conformance.effect import EFFECT_CHECKS, changes_the_record, has_sane_components
from brv_hypo.mechanisms.conformance.mechanism import (
    MECHANISM_CHECKS,
    has_a_sane_likelihood,
    has_sane_knots,
    has_sane_parameters,
    has_the_same_terms_for_every_theta,
    is_finite,
    keeps_the_shape,
)
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect
from brv_hypo.mechanisms.isolation import plain

# What an analysis relies on; the other checks are for the author.
_MECHANISM_RELIED_ON = (
    has_sane_parameters,
    keeps_the_shape,
    has_the_same_terms_for_every_theta,
    is_finite,
    has_sane_knots,
    has_a_sane_likelihood,
)
_EFFECT_RELIED_ON = (has_sane_components, changes_the_record)


def relied_on(item: Mechanism | RecordEffect) -> tuple[Callable[[], None], ...]:
    """The checks that an analysis relies on, bound to the item; each raises Nonconformity where it is broken."""
    if isinstance(item, Mechanism):
        return tuple(partial(check, item) for check in _MECHANISM_RELIED_ON)
    return tuple(partial(check, item) for check in _EFFECT_RELIED_ON)


def conformance(item: Mechanism | RecordEffect) -> tuple[Outcome, ...]:
    """The outcome of every check, in order; none stops the others."""
    tested = plain(item)
    if isinstance(tested, Mechanism):
        return tuple(check.outcome(tested) for check in MECHANISM_CHECKS)
    return tuple(check.outcome(tested) for check in EFFECT_CHECKS)
