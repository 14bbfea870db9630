"""A model that was found on other flights, its coefficients frozen, on another flight.

result    the result, and its outcome in words
changes   where this flight contradicts the model: one coefficient, or slope or damping between two times
interval  how far the measured moments may lie from the model's
predict   the entrance
"""

from brv_hypo.prediction.predict import predict
from brv_hypo.prediction.result import Prediction

__all__ = ["Prediction", "predict"]
