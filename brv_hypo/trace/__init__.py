"""What a model leaves over, traced to the effect that it lacks.

trace, TraceConfig   loop.py, config.py: the entrance, and what it may be told
Trace                result.py: steps, model, what is left; summary.py gathers it
find.py              tests of the residual: whiteness, size, where, at what frequency, along with what
step.py              one look: reconstruction, model, every candidate (candidates.py) on the fitted part
judge.py             errors on the held-out part
task.py              the regression of rates and force together, on channels.py
response.py          what a change of the record does to the residual
"""

from brv_hypo.trace.config import TraceConfig
from brv_hypo.trace.loop import trace
from brv_hypo.trace.result import Trace

__all__ = ["Trace", "TraceConfig", "trace"]
