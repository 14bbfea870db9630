"""A model that was found on other flights, its coefficients frozen, on another flight."""

from brv_hypo.prediction.predict import predict
from brv_hypo.prediction.result import Prediction

__all__ = ["Prediction", "predict"]
