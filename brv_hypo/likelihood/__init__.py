"""Maximum-likelihood estimation of dynamic models by collocation, on bare functions.

    fit            estimate.py     the entrance: dynamics, outputs, segments, start values -> FitResult
    Segment        segment.py      a stretch of record; History: what was before it, for delays
    FitResult      result.py       estimate, errors, likelihood, innovations, status

Inside, in the order in which data flow: segment and parameters (checked input), derivatives (complex step or
central differences), interpolation and collocation (Hermite-Simpson defects and their derivatives), elimination (the
states, by one banded solve), step (Gauss-Newton in theta), start (smoothed states), search (merit function, B by Eq. 3.11),
uncertainty and assessment (covariance, coloured residuals, near-null directions, whiteness).
Commands: `python -m brv_hypo.likelihood.benchmark` (speed), `python -m brv_hypo.likelihood.study` (coverage, convergence).
"""

from brv_hypo.likelihood.derivatives import Delayed
from brv_hypo.likelihood.estimate import fit
from brv_hypo.likelihood.result import FitResult
from brv_hypo.likelihood.segment import History, Segment

__all__ = ["Delayed", "FitResult", "History", "Segment", "fit"]
