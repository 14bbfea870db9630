"""`best_subsets` by a kernel of one's choice, which for users the search chooses."""

from __future__ import annotations

from typing import Any
from unittest.mock import patch

import numpy as np

from brv_hypo.subset import SubsetResult, best, best_subsets

BUDGETS = {"numpy": np.inf, "numba-schur": 0.0}
"""Nodes that numpy is given where it could leave the search to the compiled kernel."""


def best_subsets_by(kernel: str, *arguments: Any, **options: Any) -> SubsetResult:
    """The same search in numpy, compiled from the first node where that is possible; or as it chooses ("auto")."""
    if kernel == "auto":
        return best_subsets(*arguments, **options)
    with patch.object(best, "_numpy_budget", lambda _: BUDGETS[kernel]):
        return best_subsets(*arguments, **options)
