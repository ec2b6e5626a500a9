"""Physics of a network inside the ranges of its own training data: resistances positive, volts where they were seen."""

from __future__ import annotations

import numpy as np

from models.data.errors import ModelError, StructureError
from models.data.resampling import to_grid
from models.data.timeseries import FloatArray, TimeSeries
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.readouts.ocv import OcvTable
from models.readouts.resistance import ResistanceTable
from models.readouts.steady_state import OperatingPoints, settled_voltage

_SAMPLES, _PULSE = 240, 40
# How far beyond the trained voltages the output may go inside the trained range, in spans of these voltages: where it
# settles, and in trial pulses, whose current was seen in the warm and is asked for in the cold. A fit to drive cycles
# down to -10 degC goes 3.6 spans beyond with the 18 A of one at 25 degC.
_MOST_SPANS, _MOST_SPANS_OF_PULSES = 2.0, 6.0
# Of the trained states of charge, that a trial pulse may move.
_MOVED_SHARE = 0.2
_HIGHEST_V = 2000.0


def check_voltages(network: LocalModelNetwork) -> None:
    """Refuse trained voltages that no cell or module has; raises `StructureError`."""
    low_V, high_V = network.scaling["voltage"]
    if not (low_V > -0.5 and high_V < _HIGHEST_V and high_V > 0.1):
        raise StructureError(
            f"model document is damaged: its voltages reach from {low_V:g} to {high_V:g} V; no cell or module has these"
        )


def check_tables(network: LocalModelNetwork, ocv: OcvTable, resistance: ResistanceTable, stated: bool) -> None:
    """Refuse impossible read-outs that the document does not itself warn of.

    Parameters
    ----------
    ocv, resistance : read out of the network now
    stated : whether the document's own tables carry a reservation about what its resistances are
    """
    low_V, high_V = network.scaling["voltage"]
    reach_V = _MOST_SPANS * (high_V - low_V)
    known_V = ocv.voltage_V[~np.isnan(ocv.voltage_V)]
    if len(known_V) == 0 or len(resistance.resistance_Ohm) == 0:
        raise StructureError("model document is damaged: the model settles nowhere in its trained range")
    if not (known_V > max(low_V - reach_V, 0.0)).all() or not (known_V < high_V + reach_V).all():
        raise StructureError(
            f"model document is damaged: its open-circuit voltage reaches from {known_V.min():g} to {known_V.max():g} "
            f"V; it was trained on {low_V:g}..{high_V:g} V"
        )
    known_Ohm = resistance.resistance_Ohm[~np.isnan(resistance.resistance_Ohm)]
    if not stated and (len(known_Ohm) == 0 or known_Ohm.min() <= 0.0):
        least = "nowhere" if len(known_Ohm) == 0 else f"{1e3 * known_Ohm.min():.3g} mOhm"
        raise StructureError(
            f"model document is damaged: its static resistance is {least} in the trained range; it must be positive"
        )


def check_runs(network: LocalModelNetwork) -> None:
    """Let the network run through pulses at the edges of its trained range; its volts must stay where cells are.

    Raises
    ------
    StructureError
        A voltage is not finite or far from the trained ones.
    """
    low_V, high_V = network.scaling["voltage"]
    reach_V = _MOST_SPANS_OF_PULSES * (high_V - low_V)
    for run, soc in trial_runs(network):
        with np.errstate(all="ignore"):
            voltage_V = free_run_V(network, to_grid(run, network.dt_s), soc)
        if not ((voltage_V > low_V - reach_V) & (voltage_V < high_V + reach_V)).all():
            raise StructureError(
                f"model document is damaged: from SoC {soc:.2f} with {np.abs(run.current_A).max():g} A its voltage "
                f"reaches {_worst(voltage_V):g} V; it was trained on {low_V:g}..{high_V:g} V"
            )


def trial_runs(network: LocalModelNetwork) -> list[tuple[TimeSeries, float]]:
    """Short pulses with the trained currents, at the ends of the trained states of charge and temperatures.

    Raises
    ------
    ModelError
        There is no trained range to run in.
    """
    domain, capacity_Ah = network.record.domain, network.cell.capacity_Ah
    low, high = domain.get("soc") or network.scaled_over("soc") or (0.2, 0.8)
    least_A, most_A = domain.get("current_A") or network.scaled_over("current") or (-capacity_Ah, capacity_Ah)
    degC = domain.get("temperature_degC") or network.scaled_over("temperature") or (25.0, 25.0)
    most_A = max(abs(least_A), abs(most_A))
    if not (low < high and most_A > 0.0):
        raise ModelError(f"model document is damaged: it was trained from SoC {low:g} to {high:g} with {most_A:g} A")
    moved = most_A * network.dt_s / (3600.0 * capacity_Ah)
    pulse = int(np.clip(_MOVED_SHARE * (high - low) / moved, 1, _PULSE))
    at = np.arange(_SAMPLES) // pulse % 4
    shape = np.select([at == 0, at == 2], [-1.0, 1.0], 0.0)
    runs = []
    for share, warm in ((0.25, degC[0]), (0.5, degC[1]), (0.8, degC[0]), (0.8, degC[1])):
        soc = low + share * (high - low)
        start_V = _rest_V(network, soc, warm)
        current_A = np.where(shape < 0.0, -min(most_A, abs(least_A) or most_A), most_A * shape)
        n = np.full(_SAMPLES, 1.0)
        time_s = network.dt_s * np.arange(_SAMPLES)
        runs.append((TimeSeries(time_s, current_A * n, start_V * n, warm * n, warm * n, name="trial"), float(soc)))
    return runs


def _rest_V(network: LocalModelNetwork, soc: float, degC: float) -> float:
    rest_V = float(settled_voltage(network, OperatingPoints.grid(soc, 0.0, -1.0, degC)).voltage_V[0])
    return rest_V if np.isfinite(rest_V) else float(np.mean(network.scaling["voltage"]))


def _worst(voltage_V: FloatArray) -> float:
    return float(voltage_V[np.argmax(np.nan_to_num(np.abs(voltage_V), nan=np.inf))])
