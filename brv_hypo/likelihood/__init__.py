"""Maximum-likelihood estimation of dynamic models by collocation, on bare functions.

    fit                    estimate.py   the entrance: dynamics, outputs, segments, start values -> FitResult
    Segment, History       segment.py    a stretch of record; what was before it, for delays
    Course                 course.py     what varies along a segment with several parameters as weights
    FitResult              result.py     estimate, errors, likelihood, innovations
    Status                 status.py     how the search ended, with cause and remedy
    fit_single_shooting    shooting.py   the reference that `fit` is held against

Data flow through: segment and parameters (checked input), derivatives (complex step or central differences),
interpolation and collocation (Hermite-Simpson defects, as the sparse rows of `blocks`), elimination (the states, by
one `band`, or by condensation of a recursion in time where delays reach far or records are long), step (Gauss-Newton
in theta), merit (how far), start (smoothed states; cutting: long records in pieces), beginnings (the best of several),
noise, filtering and scoring (B, R, Q), search, then uncertainty, initial and assessment (covariance, initial states,
coloured residuals, near-null directions, whiteness).

Commands: `python -m brv_hypo.likelihood.benchmark` (speed) and `.study` (coverage, convergence, delays), both
on the model problems of problems.py.
"""

from brv_hypo.likelihood.course import Course
from brv_hypo.likelihood.derivatives import Delayed
from brv_hypo.likelihood.estimate import fit
from brv_hypo.likelihood.result import FitResult
from brv_hypo.likelihood.segment import History, Segment
from brv_hypo.likelihood.shooting import fit_single_shooting
from brv_hypo.likelihood.status import Status

__all__ = ["Course", "Delayed", "FitResult", "History", "Segment", "Status", "fit", "fit_single_shooting"]
