"""Voltage and temperature of a cell from current and ambient temperature alone.

Network, tables and heat balance in one loop, sample by sample: the losses warm the cell, the temperature moves the
network's validity functions and its resistance. Fed with the temperature that comes out, the network's own free run
gives the same voltage.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from models.electrothermal_loop import CODES, FlatNetwork, FlatThermal, run
from models.errors import ModelError, StructureError
from models.local_model_network import LocalModelNetwork
from models.ocv import OcvTable
from models.regression import VOLTAGE, axis_lag, normalise
from models.resistance import ResistanceTable
from models.signals import diffusion_rates, parse_signal, relaxation_poles
from models.steady_state import outside_domain
from models.structure import KERNELS
from models.thermal import ThermalModel
from models.timeseries import FloatArray


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


def flat_network(network: LocalModelNetwork) -> FlatNetwork:
    """Lay a network out as plain arrays for compiled loops."""
    structure, cell = network.structure, network.cell
    names = structure.signals
    parsed = [parse_signal(name) for name in names]
    unknown = [name for name, signal in zip(names, parsed, strict=True) if signal.kind not in CODES]
    if unknown:
        raise StructureError(f"signal {unknown[0]!r} cannot be simulated together with the temperature")
    pole, soc_per_A = np.zeros((len(names), 3)), structure.dt_s / (3600.0 * cell.capacity_Ah)
    for s, signal in enumerate(parsed):
        time_constant_s = signal.get("time_constant_s")
        if signal.kind == "relaxation":
            pole[s] = relaxation_poles(time_constant_s, structure.dt_s)
        elif signal.kind == "surface_soc":
            pole[s] = diffusion_rates(time_constant_s, structure.dt_s)
        elif time_constant_s:
            pole[s, 0] = np.exp(-structure.dt_s / time_constant_s)
    bounds = np.array([network.scaling[name] for name in names])
    taps = [(names.index(signal), lag) for signal, lag in structure.taps()]
    axes = [(names.index(axis.signal), axis_lag(axis.signal)) for axis in structure.axes]
    low, _ = network.scaling[VOLTAGE]
    return FlatNetwork(
        theta=np.ascontiguousarray(network.theta),
        centres=np.ascontiguousarray(network.partition.centres),
        widths=np.ascontiguousarray(network.partition.widths),
        kernel=KERNELS.index(network.partition.kernel),
        order=structure.output_order,
        kind=np.array([CODES[signal.kind] for signal in parsed]),
        pole=pole,
        activation_K=np.array([signal.get("activation_K") for signal in parsed]),
        exchange_A=np.array([signal.get("exchange_current_A") for signal in parsed]),
        factor=np.array([signal.get("depth") / cell.capacity_Ah + signal.get("rate") * soc_per_A for signal in parsed]),
        low=np.ascontiguousarray(bounds[:, 0]),
        span=np.ascontiguousarray(bounds[:, 1] - bounds[:, 0]),
        tap_signal=np.array([t[0] for t in taps]),
        tap_lag=np.array([t[1] for t in taps]),
        axis_signal=np.array([a[0] for a in axes]),
        axis_lag=np.array([a[1] for a in axes]),
        rest_A=cell.rest_A,
        soc_per_A=soc_per_A,
        efficiency=cell.efficiency,
        voltage_low=low,
        voltage_span=network.voltage_span_V,
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
