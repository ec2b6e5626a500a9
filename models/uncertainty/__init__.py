"""What a fit does not know: covariance of the parameters, correlation of the residuals, bands."""

from models.uncertainty.bands import prediction_band
from models.uncertainty.model_uncertainty import uncertainty_of

__all__ = ["prediction_band", "uncertainty_of"]
