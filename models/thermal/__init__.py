"""The heat balance beside a network: identified with it, and simulated together with its voltage."""

from models.thermal.cell_temperature import thermal_of
from models.thermal.closed_loop import simulate_closed
from models.thermal.model import ThermalModel

__all__ = ["ThermalModel", "simulate_closed", "thermal_of"]
