"""What a model leaves over, traced to the effect that it lacks.

trace, TraceConfig   loop.py, config.py: the entrance, and what it may be told
Trace                result.py: steps, findings and hints, model, what is left; summary.py gathers it
predict, Prediction  predict.py, prediction.py: a model found elsewhere, its coefficients frozen, on another flight;
                     band.py: how far the moments may lie from it
find.py              tests of the residual: whiteness, size, where, at what frequency, along with what
baseline.py          what a trace starts from: constant slope, its schedule by Mach number, or a table
linearisation.py     flights as a model reads them: reconstruction, parts that are fitted and held out
problem.py           the regression of one step; left_out.py: its errors on stretches left out
candidates_at_step.py  one look: the model and every candidate (candidates.py, discover.py) on the fitted part
choice.py            which candidate is added, by judge.py: errors on the held-out part; step_report.py tells it
repetition.py        whether an effect keeps its name
fitted_model.py      a model with its coefficients and errors; saved.py, restore.py: as data and back
"""

from brv_hypo.residuals.config import TraceConfig
from brv_hypo.residuals.loop import trace
from brv_hypo.residuals.predict import predict
from brv_hypo.residuals.prediction import Prediction
from brv_hypo.residuals.result import Trace

__all__ = ["Prediction", "Trace", "TraceConfig", "predict", "trace"]
