"""Maximum likelihood for entry vehicles: a regression model refined on the original measurements.

    identify(frame, columns, values, options)   -> Identification
    coefficient_histories(identification)       -> values over time with 2-sigma bands

parameters.py     names of all that is estimated; knots between nodes
record_errors.py  errors of record, vehicle and air within their tolerances, linearised
nodes.py          flight records to block means, smooth inputs and start states at nodes
equations.py      equations of motion and of measurement (Section 4.4)
problem.py        options, start values, priors, bounds, and the call of the likelihood
result.py         what comes out, coefficients over time included
identify.py       the entrance: fit, repeated until its own motion lays out the same nodes
"""

from brv_hypo.identification.identify import identify
from brv_hypo.identification.problem import IdentificationConfig
from brv_hypo.identification.result import OUTPUTS, CoefficientHistory, Estimate, Identification, coefficient_histories

__all__ = [
    "OUTPUTS",
    "CoefficientHistory",
    "Estimate",
    "Identification",
    "IdentificationConfig",
    "coefficient_histories",
    "identify",
]
