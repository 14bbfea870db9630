"""The residual of a model, traced to the effect that the model lacks. From first to last:

result         settings, and the result: steps, findings and hints, the model, its residual
fit            flights read as a model reads them; the model fitted to them; held-out errors
baseline       what a trace starts from: constant slope, its schedule by Mach number, or a table
families       the model beside all processes: which family holds the residual, which effects are wanted
acceptance     a candidate's F-ratio and p-value, the test on the blocks held out, and which is added
description    the dictionary of generic terms, and the entry that describes a residual best
additions      every candidate beside a model
final_model    coefficients on the whole record, and the result as it is gathered
trace          the loop, and what each of its steps says
"""

from brv_hypo.tracing.result import Trace, TraceConfig
from brv_hypo.tracing.trace import trace

__all__ = ["Trace", "TraceConfig", "trace"]
