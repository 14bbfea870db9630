"""What outside the list would explain a flight instead of the leader, rather than beside it. Entrance: `outside`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from brv_hypo.comparison.judgement import Judged
from brv_hypo.comparison.with_processes import acting
from brv_hypo.constants import OUTSIDE
from brv_hypo.inference.evidence import Evidence
from brv_hypo.inference.fit import HypothesisFit
from brv_hypo.inference.unmodelled import RATE, plain_columns, turning_moments, unmodelled_moments
from brv_hypo.linearisation.frame import RateFrame
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.model.common_time import at
from brv_hypo.thresholds import SPECIFIC


class Alternative(NamedTuple):
    """Something outside the list, fitted as a hypothesis of its own, its evidence, and what it is in words."""

    words: str
    fit: HypothesisFit
    evidence: Evidence


def outside(judged: Judged, hypotheses: Mapping[str, Sequence[Mechanism]]) -> list[Alternative]:
    """What may be there instead of the leader: a change that many things bring, the best moment of a shape that nothing
    on the list has, and the best that turns in the body while the leader acts, each between two times.

    A leader whose characteristic terms are not wanted is such a change, and no likelier than that.
    """
    problem, leader, null = judged.problem, judged.fits[judged.leader], judged.evidences[judged.null]
    listed = tuple({each.name: each for group in hypotheses.values() for each in group}.values())
    frame = null.rows.frame_of(leader)
    like = replace(leader, frame=frame)
    # Gradual changes of such moments are described by processes.
    found = acting(problem, like, unmodelled_moments(problem, listed, OUTSIDE), [null], onsets=(0.0,))
    if (stretch := _stretch(leader, frame)) is not None:
        turning = turning_moments(problem, listed, OUTSIDE, *stretch)
        found += acting(problem, like, turning, [null], np.array(stretch))
    moments = [Alternative(_described(pair[0]), *pair) for pair in found]
    if is_specific(leader, judged.evidences[judged.leader]):
        return moments
    terms = ", ".join(dict.fromkeys(column.term for column in plain_columns(leader)))
    words = f"a change of {terms} alone, which is not specific to {leader.name}"
    return [Alternative(words, leader, judged.evidences[judged.leader]), *moments]


def is_specific(fit: HypothesisFit, own: Evidence) -> bool:
    """Whether the evidence wants what is characteristic of a fit's mechanisms; of one that names none, all is."""
    plain = plain_columns(fit)
    specific = [k for k, column in enumerate(fit.selected) if column not in plain]
    if not plain or not any(mechanism.characteristic for mechanism in fit.mechanisms):
        return True
    return bool(specific) and own.level - own.level_without(specific) > SPECIFIC


def _stretch(leader: HypothesisFit, frame: RateFrame) -> tuple[float, float] | None:
    """From where to where the leader acts, s; None where it changes at no time."""
    bases = [column.time_basis for column in leader.selected if column.time_basis.kind != "constant"]
    starts = sorted({basis.start for basis in bases})
    return (starts[0], starts[-1] if len(starts) > 1 else float(frame.coefficient_time.max())) if starts else None


def _described(fit: HypothesisFit) -> str:
    rates = {
        f"turning in the body at {value:.3g} rad/s" for c in fit.selected for name, value in c.theta if name == RATE
    }
    shapes = " and ".join(rates or dict.fromkeys(column.term for column in fit.selected))
    starts = [column.time_basis.start for column in fit.selected if column.time_basis.kind != "constant"]
    since = f" from {at(fit.frame.common, min(starts))}" if starts else ""
    return f"a moment that no mechanism on the list has ({shapes}{since})"
