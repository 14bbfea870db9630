"""`best_subsets` by a kernel of one's choice, which a user leaves to the search."""

from __future__ import annotations

from functools import partial
from typing import Any
from unittest.mock import patch

from brv_hypo.subset import SubsetResult, best, best_subsets
from brv_hypo.subset.best import Effort


def best_subsets_by(kernel: str, *arguments: Any, **options: Any) -> SubsetResult:
    """The same search, all in numpy, or compiled from the first node."""
    with patch.object(best, "Effort", partial(Effort, kernel=kernel)):
        return best_subsets(*arguments, **options)
