"""The hypotheses that held-out blocks cannot tell from the best: a model confidence set.

It rests on prediction alone, where the probability rests on how likely the whole record is under each hypothesis: on
another ground, and without any prior. A hypothesis outside it predicts worse than another by more than blocks differ
among themselves.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import CONFIDENCE_DRAWS, CONFIDENCE_SEED, CONFIDENCE_SIZE, CONFIDENCE_TIE


def confidence_p_values(losses: FloatArray) -> FloatArray:
    """p-value of each hypothesis (hypotheses,), of `losses` (blocks, hypotheses): the least size of test that drops it.

    Range statistic, blocks drawn with replacement (Hansen, Lunde and Nason, Econometrica 79, 2011, 453-497). Blocks are
    far longer than the noise is correlated, and may come in any order. Hypotheses of equal losses have one p-value.
    """
    apart = np.max(np.abs(losses[:, :, np.newaxis] - losses[:, np.newaxis, :]), axis=0)
    distinct, which = np.unique(np.argmax(apart < CONFIDENCE_TIE, axis=1), return_inverse=True)
    if distinct.size == 1:
        return np.ones(losses.shape[1])
    from arch.bootstrap import MCS  # here: it takes as long to load as a comparison

    test = MCS(
        losses[np.ix_(np.lexsort(losses.T), distinct)],
        size=CONFIDENCE_SIZE,
        reps=CONFIDENCE_DRAWS,
        block_size=1,
        method="R",
        seed=CONFIDENCE_SEED,
    )
    test.compute()
    found = test.pvalues["Pvalue"].sort_index().to_numpy(dtype=float)
    return np.asarray(found[which])


def confidence_set(names: Sequence[str], p_values: FloatArray) -> tuple[str, ...]:
    """Those that are not dropped, likeliest of the best first."""
    order = np.argsort(-p_values, kind="stable")
    return tuple(names[k] for k in order if p_values[k] > CONFIDENCE_SIZE)
