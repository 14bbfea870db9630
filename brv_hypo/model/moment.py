"""The moment of a model on a motion: the sum of coefficient x time basis x term.

    C_N' = sum_k c_k b_k(t) (in plane)_k        C_Z' = sum_k c_k b_k(t) (out of plane)_k

`evaluated` gives the terms of regressors, `summed` the sum; the simulator plants what the analysis tests by it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.mechanisms.contract import Mechanism, Term
from brv_hypo.model.term import Regressor, Theta
from brv_hypo.motion.motion import Motion

Evaluated = dict[tuple[str, Theta], dict[str, Term]]
"""Terms by name, of mechanisms at their nonlinear parameters, on one motion."""


def evaluated(
    columns: Sequence[Regressor], mechanisms: Mapping[str, Mechanism], motion: Motion, known: Evaluated | None = None
) -> list[Term]:
    """The term of each column; a mechanism is evaluated once at each of its thetas, and then `known`."""
    known = {} if known is None else known
    for column in columns:
        key = (column.mechanism, column.theta)
        if key not in known:
            terms = mechanisms[column.mechanism].terms(motion, dict(column.theta))
            known[key] = {term.name: term for term in terms}
    return [known[column.mechanism, column.theta][column.term] for column in columns]


def summed(shapes: Iterable[FloatArray], weights: Iterable[Any], like: FloatArray) -> Any:
    """Sum of one channel of terms, each times its weight, coefficient x time basis; zeros as `like` where none is."""
    total: Any = np.zeros_like(like)
    for shape, weight in zip(shapes, weights, strict=True):
        total = total + weight * shape
    return total
