"""Exact subset regression: the best models of every size out of a set of columns, with a certificate.

A map, in the order in which data flow:

    best.py         ``best_subsets``, the entrance; ``best_columns``, the same without the fits
    frame.py        weights, forced columns, scaling, aliases, triangular factor
    constraints.py  groups and parents
    board.py        the best subsets so far and the thresholds that they set
    heuristics.py   good subsets to start from
    pieces.py       the tree cut into pieces of independent columns
    search.py       choice of kernel, time limit, certificate
    kernel_cache.py whether a compiled kernel is on disk
    nodes.py, tree_numpy.py                  the tree in numpy
    workers.py, compiled.py, kernel*.py, steps_*.py   the tree compiled, on several threads
    enumeration.py  near-ties, certified PRESS
    fit.py, criteria.py, finish.py   final fits in extended precision and their criteria
    result.py       what is returned
    stepwise.py     Efroymson's stepwise regression, for comparison
    problems.py, benchmark.py   seeded problems; ``python -m brv_hypo.subset.benchmark``
"""

from brv_hypo.subset.best import best_columns, best_subsets
from brv_hypo.subset.board import Chosen
from brv_hypo.subset.constraints import Group, at_most_one, together
from brv_hypo.subset.criteria import Criteria
from brv_hypo.subset.frame import Alias, Refusal
from brv_hypo.subset.result import Certificate, NearTies, PressBest, Subset, SubsetResult
from brv_hypo.subset.stepwise import differences, stepwise, stepwise_columns

__all__ = [
    "Alias",
    "Certificate",
    "Chosen",
    "Criteria",
    "Group",
    "NearTies",
    "PressBest",
    "Refusal",
    "Subset",
    "SubsetResult",
    "at_most_one",
    "best_columns",
    "best_subsets",
    "differences",
    "stepwise",
    "stepwise_columns",
    "together",
]
