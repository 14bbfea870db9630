"""Maximum-likelihood estimation of dynamic models by collocation, on bare functions.

    fit                   fit.py       the entrance: dynamics, outputs, segments, start values -> FitResult
    Segment, History      segment.py   a continuous record; what was before it, for delays
    TimeVaryingParameter  segment.py   a parameter that varies along a segment: weights times basis functions of time
    FitResult             result.py    estimate, standard errors, likelihood, innovations; its report
    profile_interval      result.py    intervals where the likelihood is no parabola
    Status                search.py    how the search ended, with cause and remedy

In the order of the data: segment and parameters (checked input), standard_form (constraints among parameters, models
without states), derivatives (complex step, central differences, or analytic), collocation (Hermite-Simpson defects),
kkt and condensing (the states eliminated, by one banded solve or by a recursion in time), gauss_newton (step, line
search, extrapolation), starts (starting points, long gaps, finer meshes), noise and student (measurement noise),
filter_error, scoring and compiled (process noise), search, then uncertainty and assessment (standard errors, and what
cannot be trusted).
"""

from brv_hypo.likelihood.derivatives import Delayed
from brv_hypo.likelihood.fit import fit
from brv_hypo.likelihood.result import FitResult, ProfileInterval, profile_interval
from brv_hypo.likelihood.search import Status
from brv_hypo.likelihood.segment import History, Segment, TimeVaryingParameter

__all__ = [
    "Delayed",
    "FitResult",
    "History",
    "ProfileInterval",
    "Segment",
    "Status",
    "TimeVaryingParameter",
    "fit",
    "profile_interval",
]
