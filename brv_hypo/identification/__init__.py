"""Maximum likelihood for entry vehicles: a regression model refined on the original measurements by `identify`."""

from brv_hypo.identification.identify import Estimate, Identification, identify

__all__ = ["Estimate", "Identification", "identify"]
