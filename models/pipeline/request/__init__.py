"""What is asked of a fit, and the runs as they are taken: each once, in step, lost currents told."""

from models.pipeline.request.fit_request import FitOptions, FitRequest
from models.pipeline.request.in_step import in_step
from models.pipeline.request.repeats import without_repeats

__all__ = ["FitOptions", "FitRequest", "in_step", "without_repeats"]
