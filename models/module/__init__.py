"""Cells in series and in parallel: the module models S1 to S4."""

from models.module.models import ModuleModel

__all__ = ["ModuleModel"]
