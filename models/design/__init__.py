"""Current profiles that tell about a cell."""

from models.design.sequence.profile import Profile, final_rest_s
from models.design.sequence.step_profile import StepProfileRequest, step_profile

__all__ = ["Profile", "StepProfileRequest", "final_rest_s", "step_profile"]
