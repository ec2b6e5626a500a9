"""A network that learns on from sample to sample."""

from models.recursive.settings import UpdateSettings
from models.recursive.state import UpdateOutput, UpdateState
from models.recursive.update import RecursiveUpdate

__all__ = ["RecursiveUpdate", "UpdateOutput", "UpdateSettings", "UpdateState"]
