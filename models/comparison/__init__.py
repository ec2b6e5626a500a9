"""A model beside a measurement: how far off it is, and where."""

from models.comparison.figures import compare
from models.comparison.simulated_runs import simulate_runs
from models.comparison.where import error_map

__all__ = ["compare", "error_map", "simulate_runs"]
