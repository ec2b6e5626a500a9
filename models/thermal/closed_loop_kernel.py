"""The compiled loop of the closed simulation: network, losses and heat balance, sample by sample."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from models.data.lookup import line, surface, volume
from models.network.compiled_network import FlatNetwork, step_output, step_signals
from models.network.signals import KELVIN
from models.readouts.resistance import in_own_direction


class FlatThermal(NamedTuple):
    """Heat balance and the source of the heat as plain arrays; layers without entries: heat from the overpotential."""

    a: np.ndarray
    b: np.ndarray
    layers: np.ndarray
    rows: np.ndarray
    columns: np.ndarray
    values: np.ndarray
    entropic_soc: np.ndarray
    entropic: np.ndarray
    polarisation_pole: float
    polarisation_Ohm: float


@njit(cache=True)
def run(
    net: FlatNetwork,
    thermal: FlatThermal,
    current_A: np.ndarray,
    ambient_degC: np.ndarray,
    initial_soc: float,
    initial_degC: np.ndarray,
    initial_y: float,
) -> np.ndarray:
    """(N, 3 + nodes): normalised voltage, SoC, heat, node temperatures."""
    n_samples, n_nodes = current_A.shape[0], initial_degC.shape[0]
    n_signals, depth = net.form.shape[0], 1 + max(net.tap_lag.max(), net.axis_lag.max())
    out = np.empty((n_samples, 3 + n_nodes))
    filters, history = np.zeros((n_signals, 3)), np.zeros((depth, n_signals))
    through_A = (1.0 - thermal.polarisation_pole) * current_A[0]
    trial, weight = np.zeros((n_signals, 3)), np.zeros(net.theta.shape[0])
    direction, last_A, soc = -1.0, float(current_A[0]), initial_soc
    nodes = initial_degC.copy()
    for k in range(n_samples):
        current, case_degC = float(current_A[k]), float(nodes[n_nodes - 1])
        if current > net.rest_A:
            direction = 1.0
        elif current < -net.rest_A:
            direction = -1.0
        heat = 0.0
        if k > 0:
            # One sample back each; row 0 is the present one.
            for lag in range(depth - 1, 0, -1):
                history[lag] = history[lag - 1]
            soc += (net.efficiency if current > 0.0 else 1.0) * current * net.soc_per_A
            y = 0.0
            if thermal.layers.shape[0] == 0:
                # The overpotential is taken as it is before the cell has warmed; a resistance needs no voltage.
                trial[:, :] = filters
                step_signals(net, trial, history[0], current, current - last_A, soc, direction, case_degC)
                y = step_output(net, history, weight, out, k, initial_y)
            through_A = thermal.polarisation_pole * through_A + (1.0 - thermal.polarisation_pole) * current
            heat = _losses(net, thermal, current, through_A, soc, case_degC, y)
            heat += current * line(thermal.entropic_soc, thermal.entropic, soc, False) * (nodes[0] + KELVIN)
            _warm(thermal, nodes, heat, ambient_degC[k])
        step_signals(net, filters, history[0], current, current - last_A, soc, direction, float(nodes[n_nodes - 1]))
        last_A = current
        if k == 0:
            for lag in range(1, depth):
                history[lag] = history[0]
        out[k, 0] = step_output(net, history, weight, out, k, initial_y)
        out[k, 1] = soc
        out[k, 2] = heat
        for i in range(n_nodes):
            out[k, 3 + i] = nodes[i]
    return out


@njit(cache=True)
def _losses(
    net: FlatNetwork,
    thermal: FlatThermal,
    current_A: float,
    through_A: float,
    soc: float,
    temperature_degC: float,
    y: float,
) -> float:
    """Irreversible heat in W; `through_A` flows through the polarisation, whose heat comes later."""
    if thermal.layers.shape[0] == 0:
        ocv = surface(thermal.rows, thermal.columns, thermal.values[0], temperature_degC, soc, True)
        late = through_A * (through_A - current_A)
        return current_A * (net.voltage_low + net.voltage_span * y - ocv) + thermal.polarisation_Ohm * late
    layer = in_own_direction(thermal.layers, current_A)
    resistance = volume(thermal.layers, thermal.rows, thermal.columns, thermal.values, layer, temperature_degC, soc)
    late = through_A * through_A - current_A * current_A
    return current_A * current_A * resistance + thermal.polarisation_Ohm * late


@njit(cache=True)
def _warm(thermal: FlatThermal, nodes: np.ndarray, heat_W: float, ambient_degC: float) -> None:
    """Move the temperatures on by one sample."""
    n = nodes.shape[0]
    before = nodes.copy()
    for i in range(n):
        total = thermal.b[i, 0] * heat_W + thermal.b[i, 1] * ambient_degC
        for j in range(n):
            total += thermal.a[i, j] * before[j]
        nodes[i] = total
