"""Maximum-likelihood estimation of dynamic models by collocation, on bare functions.

fit                   fit.py          the entrance: dynamics, outputs, segments, start values -> FitResult
Segment               segment.py      a continuous record
TimeVaryingParameter  segment.py      a parameter that varies along a segment: weights times basis functions of time
Differenced           collocation.py  a function that is differentiated by differences
FitResult             result.py       estimate, standard errors, likelihood, innovations; its report
Status                search.py       how the search ended, with cause and remedy
"""

from brv_hypo.likelihood.collocation import Delayed, Differenced
from brv_hypo.likelihood.fit import fit
from brv_hypo.likelihood.result import FitResult
from brv_hypo.likelihood.search import Status
from brv_hypo.likelihood.segment import Segment, TimeVaryingParameter

__all__ = ["Delayed", "Differenced", "FitResult", "Segment", "Status", "TimeVaryingParameter", "fit"]
