"""The local model network: its signals, structure, partition, parameters, and its free run."""

from models.network.cell_model import CellModel
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.network.regression import CellContext
from models.network.structure import Structure

__all__ = ["CellContext", "CellModel", "LocalModelNetwork", "Structure", "free_run_V"]
