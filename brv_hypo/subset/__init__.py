"""Exact subset regression: the best models of every size out of a set of columns, with a certificate.

In the order of the data:

    best.py         ``best_subsets``, the entrance, and what it returns; ``best_columns``, the same without the fits
    frame.py        groups and parents of columns; weights, forced columns, scaling, aliases, triangular factor
    search.py       the best subsets so far, good ones to start from, and the include/drop tree in numpy
    compiled.py     the tree compiled, on several threads
    criteria.py     least-squares fits in extended precision and selection criteria
"""

from brv_hypo.subset.best import Certificate, Subset, SubsetResult, best_columns, best_subsets
from brv_hypo.subset.criteria import Criteria
from brv_hypo.subset.frame import Alias, Group, Refusal, at_most_one, together
from brv_hypo.subset.search import Chosen

__all__ = [
    "Alias",
    "Certificate",
    "Chosen",
    "Criteria",
    "Group",
    "Refusal",
    "Subset",
    "SubsetResult",
    "at_most_one",
    "best_columns",
    "best_subsets",
    "together",
]
