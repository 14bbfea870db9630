"""Maximum likelihood for entry vehicles: a regression model refined on the original measurements.

    identify(frame, columns, values, options)   -> Identification       estimate.py, config.py, result.py
    coefficient_histories(identification)       -> values over time with 2-sigma bands     histories.py
    coefficients_without(identification, rows)  -> held-out prediction                     heldout.py

        inputs.py        measured inputs freed of noise
        nodes.py         flight records to block means, smooth inputs and start states
        structure.py     names: coefficients, delays, knots
        moments.py       the columns at the estimated motion; knots.py: knots between nodes
        shapes.py        states and inputs at some instants, and what the coefficients multiply there
        model.py         equations of motion and of measurement (Section 4.4), and derivatives that they know
        readings.py      what noise-free instruments would read of a fitted motion
        record_errors.py errors of record, vehicle and air within their tolerances, linearised on it
        problem.py       start values, priors, bounds, and the call of the likelihood

Command: `python -m brv_hypo.identification.study` (coverage, comparison with the regression, speed).
"""

from brv_hypo.identification.config import IdentificationConfig
from brv_hypo.identification.estimate import identify
from brv_hypo.identification.heldout import coefficients_without, predicted_moments
from brv_hypo.identification.histories import CoefficientHistory, coefficient_histories
from brv_hypo.identification.result import OUTPUTS, Estimate, Identification

__all__ = [
    "OUTPUTS",
    "CoefficientHistory",
    "Estimate",
    "Identification",
    "IdentificationConfig",
    "coefficient_histories",
    "coefficients_without",
    "identify",
    "predicted_moments",
]
