"""From reconstructed flights to ranked hypotheses with a verdict: how a name comes about.

    compare.py         entrance. The record is tried and its motion reconstructed
    preparation.py     the flights become one least-squares problem, linear about the baseline's fit
    judgement.py       every hypothesis is searched in it (`inference.fit`); about the leader the problem is linearised
                       once more, and each has its evidence there beside processes (`inference.evidence`)
    with_processes.py  for that, a hypothesis is placed beside processes: its times, delays and unwanted changes
    verdict.py         from evidences to probabilities, and the winner or the credible set

config.py has the settings; what decides a verdict is in brv_hypo/thresholds.py. Beside the name:
limits.py (how large each mechanism may be), intervals.py (net values between knots), diagnostics.py (errors of the
record, collinearity, whiteness, the moment as functions), summary.py and result.py (the result and its shape).
"""

from brv_hypo.comparison.compare import compare
from brv_hypo.comparison.config import CompareConfig
from brv_hypo.comparison.result import Comparison

__all__ = ["CompareConfig", "Comparison", "compare"]
