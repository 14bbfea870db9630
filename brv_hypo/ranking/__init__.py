"""From reconstructed flights to ranked hypotheses with a verdict.

compare.py   entrance: one readable `compare`; C_p, PRESS, AIC and BIC; the model confidence set of held-out blocks
config.py    what a comparison may be told; what decides a verdict stands in brv_hypo/constants.py
preparation.py   from reconstructed flights to the problem that all hypotheses share
fitting.py   every hypothesis fitted; disagreement.py where the criteria put different hypotheses first
adequacy.py  whether only noise is left; alternative.py what may be there instead
stability.py whether a repetition ends the same: without blocks, within tolerances, other knots, other methods
limits.py    how large each mechanism may be; intervals.py net values between knots
verdict.py   a winner, or the credible set
likelihood.py    these, by maximum likelihood
summary.py   gathers the result; result.py is its shape
"""

from brv_hypo.ranking.compare import compare
from brv_hypo.ranking.config import CompareConfig
from brv_hypo.ranking.result import Comparison

__all__ = ["CompareConfig", "Comparison", "compare"]
