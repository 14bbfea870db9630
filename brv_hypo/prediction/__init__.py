"""A model that was found on other flights, its coefficients frozen, on another flight.

result    the result, and its outcome in words
changes   where this flight contradicts the model: one coefficient, or slope or damping between two times
predict   the entrance, the frozen model, and how far the measured moments may lie from it
"""

from brv_hypo.prediction.predict import predict
from brv_hypo.prediction.result import Prediction

__all__ = ["Prediction", "predict"]
