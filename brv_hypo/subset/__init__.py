"""Exact subset regression: the best models of every size out of a set of columns, with a certificate."""

from brv_hypo.subset.best import Certificate as Certificate
from brv_hypo.subset.best import Subset as Subset
from brv_hypo.subset.best import SubsetResult as SubsetResult
from brv_hypo.subset.best import best_columns as best_columns
from brv_hypo.subset.best import best_subsets as best_subsets
from brv_hypo.subset.criteria import Criteria as Criteria
from brv_hypo.subset.frame import Alias as Alias
from brv_hypo.subset.frame import Group as Group
from brv_hypo.subset.frame import Refusal as Refusal
from brv_hypo.subset.frame import at_most_one as at_most_one
from brv_hypo.subset.frame import together as together
from brv_hypo.subset.search import Chosen as Chosen
