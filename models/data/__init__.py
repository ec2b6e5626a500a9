"""Measured arrays, validated once: runs, their even grids, tables, figures of error."""

from models.data.errors import ModelError
from models.data.resampling import GridRun, to_grid
from models.data.timeseries import FloatArray, TimeSeries

__all__ = ["FloatArray", "GridRun", "ModelError", "TimeSeries", "to_grid"]
