"""The compiled loop of the closed simulation: network, losses and heat balance, sample by sample."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from models.lookup import line, surface, volume
from models.resistance import in_own_direction
from models.signals import DIFFUSION_GAINS, KELVIN, REFERENCE_K
from models.structure import KERNELS

# What the compiled loop does with a signal.
FILTERED, SOC, RELAXATION, DIRECTION, HYSTERESIS, TEMPERATURE, INVERSE_TEMPERATURE, SQUARED = range(8)
CODES = {
    "current": FILTERED,
    "scaled_current": FILTERED,
    "low_pass": FILTERED,
    "charge_transfer": FILTERED,
    "squared_current": SQUARED,
    "soc": SOC,
    "surface_soc": SOC,
    "relaxation": RELAXATION,
    "hysteresis": DIRECTION,
    "hysteresis_state": HYSTERESIS,
    "temperature": TEMPERATURE,
    "inverse_temperature": INVERSE_TEMPERATURE,
}
_GAUSSIAN, _UNIFORM = KERNELS.index("gaussian"), KERNELS.index("uniform")


class FlatNetwork(NamedTuple):
    """A network as plain arrays."""

    theta: np.ndarray
    centres: np.ndarray
    widths: np.ndarray
    kernel: int
    order: int
    kind: np.ndarray  # (S,) code of each signal
    pole: np.ndarray  # (S, 3) poles of the filter stages, 0 where there is none; of a SoC: rates of its diffusion
    activation_K: np.ndarray  # (S,) 0: the current is not scaled by temperature
    exchange_A: np.ndarray  # (S,) 0: no asinh
    factor: np.ndarray  # (S,) of SoC per ampere, or of hysteresis per ampere and sample
    low: np.ndarray  # (S,) normalisation
    span: np.ndarray
    tap_signal: np.ndarray
    tap_lag: np.ndarray
    axis_signal: np.ndarray
    axis_lag: np.ndarray
    rest_A: float
    soc_per_A: float
    efficiency: float
    voltage_low: float
    voltage_span: float


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
    n_signals, depth = net.kind.shape[0], 1 + max(net.tap_lag.max(), net.axis_lag.max())
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
def step_signals(
    net: FlatNetwork,
    filters: np.ndarray,
    now: np.ndarray,
    current_A: float,
    change_A: float,
    soc: float,
    direction: float,
    temperature_degC: float,
) -> None:
    """Write the normalised signals of this sample into `now` and move the filters on."""
    # Signals that follow each other often share their scaling by temperature and their exchange current.
    slowed, slowed_for, exchange_for, transfer = 1.0, 0.0, 0.0, 0.0
    for s in range(net.kind.shape[0]):
        kind, pole, state = net.kind[s], net.pole[s], filters[s]
        value = direction
        if kind == FILTERED or kind == SOC or kind == SQUARED:
            if net.activation_K[s] != slowed_for:
                slowed_for = net.activation_K[s]
                slowed = np.exp(slowed_for * (1.0 / (temperature_degC + KELVIN) - 1.0 / REFERENCE_K))
                exchange_for = 0.0
            value = current_A * slowed
            if kind == SOC:
                shift = 0.0
                for mode in range(3 if net.factor[s] != 0.0 else 0):
                    keep = np.exp(-pole[mode] / slowed)
                    state[mode] = keep * state[mode] + (1.0 - keep) * DIFFUSION_GAINS[mode] * value
                    shift += state[mode]
                value = soc + net.factor[s] * shift
            else:
                if net.exchange_A[s] != 0.0:
                    if net.exchange_A[s] != exchange_for:
                        exchange_for = net.exchange_A[s]
                        transfer = np.arcsinh(value / exchange_for)
                    value = transfer
                state[0] = pole[0] * state[0] + (1.0 - pole[0]) * value
                value = state[0] * abs(state[0]) if kind == SQUARED else state[0]
        elif kind == RELAXATION:
            value = change_A
            for stage in range(3):
                state[stage] = pole[stage] * state[stage] + (1.0 - pole[stage]) * value
                value = state[stage]
            value /= 1.0 - pole[0]
        elif kind == HYSTERESIS:
            keep = np.exp(-net.factor[s] * abs(current_A))
            state[0] = keep * state[0] + (1.0 - keep) * np.sign(current_A)
            value = state[0]
        elif kind == TEMPERATURE:
            value = temperature_degC
        elif kind == INVERSE_TEMPERATURE:
            value = 1.0 / (temperature_degC + KELVIN)
        now[s] = (value - net.low[s]) / net.span[s]


@njit(cache=True)
def step_output(
    net: FlatNetwork, history: np.ndarray, weight: np.ndarray, out: np.ndarray, k: int, initial_y: float
) -> float:
    """Normalised voltage of sample k from the signals in `history` and the past outputs in `out`."""
    if k < net.order and (k > 0 or not np.isnan(initial_y)):
        return float(out[k - 1, 0]) if k > 0 else initial_y
    n_models, n_params = net.theta.shape
    step_validity(net, history, weight)
    y, poles_sum = 0.0, 0.0
    for p in range(n_params):
        blended = 0.0
        for i in range(n_models):
            blended += weight[i] * net.theta[i, p]
        if p < net.order:
            if k == 0:
                poles_sum += blended
            else:
                y += blended * out[k - 1 - p, 0]
        elif p < n_params - 1:
            tap = p - net.order
            y += blended * history[net.tap_lag[tap], net.tap_signal[tap]]
        else:
            y += blended
    return float(y / (1.0 - poles_sum))


@njit(cache=True)
def step_validity(net: FlatNetwork, history: np.ndarray, weight: np.ndarray) -> None:
    """Write the (M,) validity functions, as `Partition.validity` has them."""
    n_models, n_axes = net.centres.shape
    nearest, far = 0, np.inf
    for i in range(n_models):
        squared, kernel = 0.0, 1.0
        for j in range(n_axes):
            distance = abs(history[net.axis_lag[j], net.axis_signal[j]] - net.centres[i, j]) / net.widths[i, j]
            squared += distance * distance
            if net.kernel == _UNIFORM:
                kernel *= 1.0 if distance <= 1.0 else 0.0
            else:
                kernel *= max(1.0 - 0.5 * distance, 0.0)
        weight[i] = squared if net.kernel == _GAUSSIAN else kernel
        if squared < far:
            far, nearest = squared, i
    total = 0.0
    for i in range(n_models):
        if net.kernel == _GAUSSIAN:
            # Relative to the nearest, so that far outside all boxes the sum does not underflow to 0.
            weight[i] = np.exp(-0.5 * (weight[i] - far))
        total += weight[i]
    if total <= 0.0:
        weight[nearest] = total = 1.0
    for i in range(n_models):
        weight[i] /= total


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
