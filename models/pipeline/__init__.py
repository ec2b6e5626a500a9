"""The whole way, as the service calls it: fit, refit, add an effect."""

from models.pipeline.addition import add_effect
from models.pipeline.choosing import STRUCTURES
from models.pipeline.fit import FitResult, fit_network
from models.pipeline.refitting import refit

__all__ = ["FitResult", "STRUCTURES", "add_effect", "fit_network", "refit"]
