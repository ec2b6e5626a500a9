"""Current profiles that tell about a cell."""

from models.design.profile import Profile, final_rest_s
from models.design.step_profile import StepProfileRequest, step_profile

__all__ = ["Profile", "StepProfileRequest", "final_rest_s", "step_profile"]
