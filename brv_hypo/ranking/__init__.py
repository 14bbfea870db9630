"""From reconstructed flights to ranked hypotheses with a verdict.

compare.py   entrance: one readable `compare`
config.py    what a comparison may be told; what decides a verdict stands in brv_hypo/constants.py
preparation.py   from reconstructed flights to the problem that all hypotheses share
criteria.py  C_p, PRESS, AIC and BIC; disagreement.py where they put different hypotheses first
adequacy.py  whether only noise is left; alternative.py what may be there instead
stability.py whether a repetition ends the same (repeated.py): other_knots.py, other_methods.py
limits.py    how large each mechanism may be; intervals.py net values between knots
verdict.py   a winner, or all that stand; confidence_set.py those that held-out blocks cannot tell from the best
likelihood.py    those that stand, by maximum likelihood
summary.py   gathers the result; result.py is its shape
"""

from brv_hypo.ranking.compare import compare
from brv_hypo.ranking.config import CompareConfig
from brv_hypo.ranking.result import Comparison

__all__ = ["CompareConfig", "Comparison", "compare"]
