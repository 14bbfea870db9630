"""Maximum likelihood for entry vehicles: a regression model refined on the original measurements.

    identify(frame, columns, values)   -> Identification

parameters.py     names of all that is estimated; knots between nodes; errors within tolerances, linearised
nodes.py          flight records to block means, smooth inputs and start states at nodes
equations.py      equations of motion and of measurement (Section 4.4)
identify.py       the entrance: the problem and its fit, until its own motion lays out the same nodes; what comes out
"""

from brv_hypo.identification.identify import Estimate, Identification, identify

__all__ = ["Estimate", "Identification", "identify"]
