"""From reconstructed flights to ranked hypotheses with a verdict.

compare.py   entrance: one readable `compare`
config.py    what a comparison may be told
noise.py     the noise model and the drift of the baseline
fit.py       best subset of a hypothesis's columns; refine.py moves delays and knots
heldout.py   prediction error on held-out blocks
verdict.py   a winner, or all that stand
summary.py   gathers the result; result.py is its shape
"""

from brv_hypo.ranking.compare import compare
from brv_hypo.ranking.config import CompareConfig
from brv_hypo.ranking.result import Comparison

__all__ = ["CompareConfig", "Comparison", "compare"]
