"""Models to compare with: equivalent circuits and Plett's ESC model, each fitted by a good method of its own."""

from models.baselines.enhanced_self_correcting import EnhancedSelfCorrecting, fit_enhanced_self_correcting
from models.baselines.equivalent_circuit import EquivalentCircuit, fit_equivalent_circuit
from models.network.cell_model import CellModel

__all__ = [
    "CellModel",
    "EnhancedSelfCorrecting",
    "EquivalentCircuit",
    "fit_enhanced_self_correcting",
    "fit_equivalent_circuit",
]
