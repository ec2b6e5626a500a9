"""A network as plain arrays, and the compiled step that makes its signals and its output, sample by sample."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from models.data.errors import StructureError
from models.network.hats import hat_interval
from models.network.local_model_network import LocalModelNetwork
from models.network.regression import VOLTAGE, axis_lag
from models.network.signals import KELVIN, REFERENCE_K, parse_signal
from models.network.signals.filters import DIFFUSION_GAINS, FURTHEST_BEHIND, slower_at
from models.network.signals.loop_form import (
    AS_IS,
    CASCADE,
    CHARGE,
    DIFFUSION,
    DISCHARGE,
    DRIVEN,
    ENTRY_BITS,
    INVERSE_TEMPERATURE,
    LOOP,
    MAGNITUDE,
    SIGNED_SQUARE,
    SOC,
    SQUARED_BIT,
    TEMPERATURE,
    LoopForm,
)
from models.network.signals.temperature_scale import inside_trained, within_degC
from models.network.structure import KERNELS, Structure

# Compiled without counting references to the network's arrays, which takes longer than the signals of a small network
# where the call is not inlined; nothing inside allocates.
_UNCOUNTED: dict[str, Any] = {"cache": True, "_nrt": False}
_GAUSSIAN, _UNIFORM = KERNELS.index("gaussian"), KERNELS.index("uniform")
HAT = KERNELS.index("hat")


class FlatNetwork(NamedTuple):
    """A network as plain arrays; what is said of each signal is a `LoopForm`, one field of it an array."""

    theta: np.ndarray
    centres: np.ndarray
    widths: np.ndarray
    kernel: int
    order: int
    form: np.ndarray  # (S,) `LoopForm.code`
    pole: np.ndarray  # (S, 3)
    activation_K: np.ndarray  # (S,)
    exchange_A: np.ndarray  # (S,)
    factor: np.ndarray  # (S,)
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


@njit(cache=True, inline="always")
def bent(entry: int, x: float) -> float:
    """Return what enters the low-pass of a driven signal; the ways that are not AS_IS."""
    if entry == CHARGE:
        return max(x, 0.0)
    if entry == DISCHARGE:
        return min(x, 0.0)
    if entry == MAGNITUDE:
        return abs(x)
    return x * abs(x) if entry == SIGNED_SQUARE else x * x


@njit(**_UNCOUNTED)
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
    for s in range(net.form.shape[0]):
        form, pole, state = net.form[s], net.pole[s], filters[s]
        value = direction
        if form >= DRIVEN or form == SOC or form == DIFFUSION:
            if net.activation_K[s] != slowed_for:
                slowed_for = net.activation_K[s]
                slowed = np.exp(slowed_for * (1.0 / (temperature_degC + KELVIN) - 1.0 / REFERENCE_K))
                exchange_for = 0.0
            value = current_A * slowed
            if form < DRIVEN:
                shift, slower = 0.0, slowed
                if net.exchange_A[s] != 0.0:
                    slower *= slower_at(net.exchange_A[s], soc)
                for mode in range(3 if net.factor[s] != 0.0 else 0):
                    keep = np.exp(-pole[mode] / slower)
                    state[mode] = keep * state[mode] + (1.0 - keep) * DIFFUSION_GAINS[mode] * (current_A * slower)
                    shift += state[mode]
                value = net.factor[s] * shift
                value = soc + value if form == SOC else min(max(value, -FURTHEST_BEHIND), FURTHEST_BEHIND)
            else:
                if net.exchange_A[s] != 0.0:
                    if net.exchange_A[s] != exchange_for:
                        exchange_for = net.exchange_A[s]
                        transfer = np.arcsinh(value / exchange_for)
                    value = transfer
                if form & ENTRY_BITS != AS_IS:
                    value = bent(form & ENTRY_BITS, value)
                state[0] = pole[0] * state[0] + (1.0 - pole[0]) * value
                value = state[0] * abs(state[0]) if form & SQUARED_BIT else state[0]
        elif form == CASCADE:
            value = change_A
            for stage in range(3):
                state[stage] = pole[stage] * state[stage] + (1.0 - pole[stage]) * value
                value = state[stage]
            value /= 1.0 - pole[0]
        elif form == LOOP:
            keep = np.exp(-net.factor[s] * abs(current_A))
            state[0] = keep * state[0] + (1.0 - keep) * np.sign(current_A)
            value = state[0]
        elif form == TEMPERATURE:
            value = within_degC(temperature_degC, pole[0], pole[1])
        elif form == INVERSE_TEMPERATURE:
            value = 1.0 / (temperature_degC + KELVIN)
        now[s] = (value - net.low[s]) / net.span[s]


@njit(cache=True)
def step_output(
    net: FlatNetwork, history: np.ndarray, weight: np.ndarray, out: np.ndarray, k: int, initial_y: float
) -> float:
    """Normalised voltage of sample k from the signals in `history` and the past outputs in `out`."""
    if k < net.order and (k > 0 or not np.isnan(initial_y)):
        return float(out[k - 1, 0]) if k > 0 else initial_y
    n_params = net.theta.shape[1]
    first, last = step_validity(net, history, weight)
    y, poles_sum = 0.0, 0.0
    for p in range(n_params):
        blended = 0.0
        for i in range(first, last):
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
def step_validity(net: FlatNetwork, history: np.ndarray, weight: np.ndarray) -> tuple[int, int]:
    """Write the (M,) validity functions, as `Partition.validity` has them.

    Returns
    -------
    first, last : the range of local models, its end excluded, beyond which all of them are 0
    """
    n_models, n_axes = net.centres.shape
    if net.kernel == HAT:
        weight[:] = 0.0
        below, share = hat_interval(net.centres, float(history[net.axis_lag[0], net.axis_signal[0]]))
        weight[below], weight[below + 1] = 1.0 - share, share
        return below, below + 2
    nearest, far = 0, np.inf
    for i in range(n_models):
        squared, kernel = 0.0, 1.0
        for j in range(n_axes):
            s = net.axis_signal[j]
            z = inside_trained(int(net.form[s]), float(history[net.axis_lag[j], s]))
            distance = abs(z - net.centres[i, j]) / net.widths[i, j]
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
    return 0, n_models


def flat_network(network: LocalModelNetwork) -> FlatNetwork:
    """Lay a network out as plain arrays for compiled loops.

    Raises
    ------
    StructureError
        One of its signals has no form for the compiled loops.
    """
    structure, cell = network.structure, network.cell
    names = structure.signals
    rows = [_loop_form(name, structure.dt_s, cell.capacity_Ah) for name in names]
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
        form=np.array([row.code for row in rows]),
        pole=np.array([row.poles for row in rows]),
        activation_K=np.array([row.activation_K for row in rows]),
        exchange_A=np.array([row.exchange_A for row in rows]),
        factor=np.array([row.factor for row in rows]),
        low=np.ascontiguousarray(bounds[:, 0]),
        span=np.ascontiguousarray(bounds[:, 1] - bounds[:, 0]),
        tap_signal=np.array([t[0] for t in taps]),
        tap_lag=np.array([t[1] for t in taps]),
        axis_signal=np.array([a[0] for a in axes]),
        axis_lag=np.array([a[1] for a in axes]),
        rest_A=cell.rest_A,
        soc_per_A=structure.dt_s / (3600.0 * cell.capacity_Ah),
        efficiency=cell.efficiency,
        voltage_low=low,
        voltage_span=network.voltage_span_V,
    )


def has_loop_forms(structure: Structure) -> bool:
    """Whether all signals of a structure can be made sample by sample."""
    return all(parse_signal(name).definition.loop is not None for name in structure.signals)


def _loop_form(name: str, dt_s: float, capacity_Ah: float) -> LoopForm:
    signal = parse_signal(name)
    if signal.definition.loop is None:
        raise StructureError(
            f"signal {name!r} cannot be made sample by sample, which observer, design, recursive update and every "
            f"simulation in closed loop need: use a model without it, or give {signal.kind!r} a loop form"
        )
    return signal.definition.loop(signal, dt_s, capacity_Ah)
