"""What a model leaves over, traced to the effect that it lacks.

trace, TraceConfig   loop.py, config.py: the entrance, and what it may be told
Trace                result.py: steps, model, what is left; summary.py gathers it
find.py              tests of the residual: whiteness, size, where, at what frequency, along with what
seen.py              a flight as a model reads it: reconstruction, parts that are fitted and held out
step.py              one look: the model and every candidate (candidates.py, discover.py) on the fitted part
choice.py            which candidate is added, by judge.py: errors on the held-out part; told.py puts it in words
state.py             a model with its coefficients and errors; saved.py, restore.py: as data and back
likelihood.py        the final model refined by maximum likelihood
task.py              the regression of rates and force together, on channels.py
response.py          what a change of the record does to the residual

Command: `python -m brv_hypo.residuals.study` (how often planted effects are found; planting.py).
"""

from brv_hypo.residuals.config import TraceConfig
from brv_hypo.residuals.loop import trace
from brv_hypo.residuals.result import Trace

__all__ = ["Trace", "TraceConfig", "trace"]
