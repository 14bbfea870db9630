"""The residual of a model, traced to the effect that the model lacks.

trace, TraceConfig   trace_loop.py, config.py: the entrance, and its settings; how often repetitions name an effect
Trace                result.py: steps, findings and hints, model, the residual; summary.py gathers it
predict, Prediction  predict.py, prediction.py: a model found elsewhere, its coefficients frozen, on another flight;
                     prediction_interval.py; local_change.py: where a flight differs
diagnostics.py       tests of the residual: whiteness, size, where, at what frequency, along with what
baseline.py          what a trace starts from: constant slope, its schedule by Mach number, or a table
linearisation.py     flights as a model reads them: reconstruction, parts that are fitted and held out
problem.py           the regression of one step
candidates_at_step.py  the model and every candidate (candidates.py; discover.py, dictionary.py) on the fitted part
choice.py            which candidate is added, by judge.py: errors on the held-out part; step_report.py reports it
fitted_model.py      a model with its coefficients and errors; saved.py, restore.py: as data and back;
                     static_slope.py: its coefficients and slope
"""

from brv_hypo.residuals.config import TraceConfig
from brv_hypo.residuals.predict import predict
from brv_hypo.residuals.prediction import Prediction
from brv_hypo.residuals.result import Trace
from brv_hypo.residuals.trace_loop import trace

__all__ = ["Prediction", "Trace", "TraceConfig", "predict", "trace"]
