"""Voltage and temperature of a cell from current and ambient temperature alone.

Network, tables and heat balance in one loop, sample by sample: the losses warm the cell, the temperature moves the
network's validity functions and its resistance. Fed with the temperature that comes out, the network's own free run
gives the same voltage.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from models.data.errors import ModelError
from models.data.timeseries import FloatArray
from models.network.compiled_network import flat_network
from models.network.local_model_network import LocalModelNetwork
from models.network.regression import VOLTAGE, normalise
from models.readouts.ocv import OcvTable
from models.readouts.resistance import ResistanceTable
from models.readouts.steady_state import outside_domain
from models.thermal.closed_loop_kernel import FlatThermal, run
from models.thermal.model import ThermalModel


@dataclass(frozen=True)
class ClosedSimulation:
    """What the models say of a run of which only current and ambient temperature are known.

    Attributes
    ----------
    time_s, current_A, voltage_V, soc : (n,)
    temperature_degC : (n,) at the case, which the network was trained on
    core_degC : (n,) the same where the thermal model has one node
    heat_W : (n,) released up to each sample, reversible part included
    inside : (n,) whether current, temperature and SoC lie in the network's trained domain
    """

    time_s: FloatArray
    current_A: FloatArray
    voltage_V: FloatArray
    temperature_degC: FloatArray
    core_degC: FloatArray
    soc: FloatArray
    heat_W: FloatArray
    inside: np.ndarray


def simulate_closed(
    network: LocalModelNetwork,
    thermal: ThermalModel,
    losses: ResistanceTable | OcvTable,
    current_A: ArrayLike,
    ambient_degC: ArrayLike,
    *,
    initial_soc: float,
    initial_degC: float | None = None,
    initial_voltage_V: float = float("nan"),
) -> ClosedSimulation:
    """Simulate voltage and temperature together.

    Parameters
    ----------
    network : the cell's voltage
    thermal : its heat balance
    losses : a resistance table makes the heat I^2 R, an open-circuit table I (V - U)
    current_A : (n,) at the network's sampling time; current_A[k] flows from sample k-1 to sample k
    ambient_degC : (n,) or one value
    initial_soc : fraction
    initial_degC : of the whole cell; by default the first ambient temperature
    initial_voltage_V : first value of the free run; by default the settled one

    Returns
    -------
    ClosedSimulation

    Raises
    ------
    ModelError
        A value is not finite, or the table has points at which the network does not settle.
    """
    current = np.ascontiguousarray(current_A, dtype=np.float64)
    ambient = np.ascontiguousarray(np.broadcast_to(np.asarray(ambient_degC, np.float64), current.shape))
    start_degC = float(ambient[0]) if initial_degC is None else initial_degC
    if not (np.isfinite(current).all() and np.isfinite(ambient).all() and np.isfinite([initial_soc, start_degC]).all()):
        raise ModelError("closed simulation: current, ambient temperature and initial values must be finite")
    flat, heat = flat_network(network), _heat(thermal, losses, network.structure.dt_s)
    first = float(normalise(np.array([initial_voltage_V]), network.scaling[VOLTAGE])[0])
    # Columns: normalised voltage, SoC, heat, then the nodes.
    out = run(flat, heat, current, ambient, initial_soc, np.full(thermal.n_nodes, start_degC), first)
    inside = ~outside_domain(network, {"soc": out[:, 1], "current_A": current, "temperature_degC": out[:, -1]})
    return ClosedSimulation(
        time_s=network.structure.dt_s * np.arange(len(current)),
        current_A=current,
        voltage_V=network.to_volts(out[:, 0]),
        temperature_degC=out[:, -1],
        core_degC=out[:, 3],
        soc=out[:, 1],
        heat_W=out[:, 2],
        inside=inside,
    )


def _heat(thermal: ThermalModel, losses: ResistanceTable | OcvTable, dt_s: float) -> FlatThermal:
    if isinstance(losses, ResistanceTable):
        layers, values = losses.current_A, losses.resistance_Ohm
    else:
        layers, values = np.zeros(0), losses.mean_V[None]
    if not np.isfinite(values).all():
        raise ModelError(
            f"closed simulation: the table of losses has {int((~np.isfinite(values)).sum())} points at which the "
            "network does not settle; read it out where it does"
        )
    a, b = thermal.discrete(dt_s)
    return FlatThermal(
        a,
        b,
        np.ascontiguousarray(layers),
        np.ascontiguousarray(losses.temperature_degC),
        np.ascontiguousarray(losses.soc),
        np.ascontiguousarray(values),
        np.array(thermal.dU_dT_soc, dtype=np.float64),
        np.array(thermal.dU_dT_V_per_K, dtype=np.float64),
        float(np.exp(-dt_s / thermal.polarisation_s)),
        thermal.polarisation_Ohm,
    )
