"""Maximum likelihood for entry vehicles: a regression model refined on the original measurements.

    identify(frame, columns, values, options)   -> Identification

parameters.py     names of all that is estimated; knots between nodes; errors within tolerances, linearised
nodes.py          flight records to block means, smooth inputs and start states at nodes
equations.py      equations of motion and of measurement (Section 4.4)
problem.py        options, start values, priors, bounds, and the call of the likelihood
identify.py       the entrance: fit, repeated until its own motion lays out the same nodes; what comes out
"""

from brv_hypo.identification.identify import OUTPUTS, Estimate, Identification, identify
from brv_hypo.identification.problem import IdentificationConfig

__all__ = ["OUTPUTS", "Estimate", "Identification", "IdentificationConfig", "identify"]
