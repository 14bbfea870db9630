"""From reconstructed flights to ranked hypotheses with a verdict.

compare.py   entrance: one readable `compare`; C_p, PRESS, AIC and BIC; the likelihood of the credible hypotheses
config.py    settings of a comparison; what decides a verdict stands in brv_hypo/constants.py
preparation.py   from reconstructed flights to the problem that all hypotheses share
judgement.py every hypothesis searched, then its evidence beside processes; what the leader explains, and what outside
             the list may be there instead
with_processes.py    a hypothesis beside processes: its times, delays and unwanted changes
limits.py    how large each mechanism may be; intervals.py net values between knots
verdict.py   probabilities, and the winner or the credible set
summary.py   gathers the result, and says where criteria disagree; result.py its shape
diagnostics.py   errors of the record, collinearity, whiteness, models by size, the moment as functions
"""

from brv_hypo.comparison.compare import compare
from brv_hypo.comparison.config import CompareConfig
from brv_hypo.comparison.result import Comparison

__all__ = ["CompareConfig", "Comparison", "compare"]
