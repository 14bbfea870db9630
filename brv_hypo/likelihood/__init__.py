"""Maximum-likelihood estimation of dynamic models by collocation, on bare functions.

    fit                    estimate.py   the entrance: dynamics, outputs, segments, start values -> FitResult
    Segment, History       segment.py    a stretch of record; what was before it, for delays
    Course                 course.py     what varies along a segment with several parameters as weights
    FitResult              result.py     estimate, errors, likelihood, innovations
    Status                 status.py     how the search ended, with cause and remedy
    profile_interval       profile.py    intervals where the likelihood is no parabola
    fit_single_shooting    shooting.py   the reference that `fit` is held against

Data flow through: segment and parameters (checked input), tied (constraints among parameters), algebraic (models
without states), derivatives (complex step, central differences, or given), interpolation and collocation
(Hermite-Simpson defects, as the sparse rows of `blocks`), elimination (the states, by one `band`, or by condensation
of a recursion in time where delays reach far or records are long), step (Gauss-Newton in theta), merit (how far),
start (smoothed states; cutting: long records in pieces), beginnings (the best of several), bridging (long gaps),
noise, student (noise with tails), filtering and scoring (B, R, Q; marginal: the states integrated out, by the loops
of compiled and compiled_band), search, then uncertainty, initial, assessment, noise_errors, joint_errors (covariance,
initial states, coloured residuals, near-null directions, whiteness, errors of the variances) and discretisation (what
the mesh does to the estimate), by which mesh asks for finer steps.

Commands: `python -m brv_hypo.likelihood.benchmark` (speed) and `.study` (coverage, convergence, delays), both
on the model problems of problems.py.
"""

from brv_hypo.likelihood.course import Course
from brv_hypo.likelihood.derivatives import Delayed
from brv_hypo.likelihood.estimate import fit
from brv_hypo.likelihood.profile import ProfileInterval, profile_interval
from brv_hypo.likelihood.result import FitResult
from brv_hypo.likelihood.segment import History, Segment
from brv_hypo.likelihood.shooting import fit_single_shooting
from brv_hypo.likelihood.status import Status

__all__ = [
    "Course",
    "Delayed",
    "FitResult",
    "History",
    "ProfileInterval",
    "Segment",
    "Status",
    "fit",
    "fit_single_shooting",
    "profile_interval",
]
