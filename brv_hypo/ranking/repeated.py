"""A comparison repeated: the criterion of every candidate in each repetition."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.regression.fit import HypothesisFit

Criteria = Mapping[str, float]
"""The criterion of each candidate, by name."""


@dataclass(frozen=True)
class Repeated:
    """Criteria on the record as it is, and in each repetition of one kind, under the same likelihood."""

    whole: Criteria
    each: Sequence[Criteria]


def criteria(fits: Sequence[HypothesisFit]) -> Criteria:
    """Those of fits as they are."""
    return {fit.name: fit.information for fit in fits}


def criteria_at(fits: Sequence[HypothesisFit], rss: Mapping[str, float]) -> Criteria:
    """Those of fits with these residual sums of squares."""
    return {fit.name: replace(fit, residual=np.array([np.sqrt(rss[fit.name])])).information for fit in fits}
