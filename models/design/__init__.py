"""Current profiles that tell about a cell."""

from models.design.profile import Profile
from models.design.step_profile import StepProfileRequest, step_profile

__all__ = ["Profile", "StepProfileRequest", "step_profile"]
