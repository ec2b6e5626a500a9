"""Network and memory as three flat arrays, so that a live call hands over little.

Each array that goes into a compiled function costs about half a microsecond to look at; a network is twenty of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from models.electrothermal_loop import FlatNetwork
from models.observer import compiled
from models.observer.places import MOVED_ROWS, N_HELD
from models.timeseries import FloatArray

# Places in the array of whole numbers; the index arrays of the network follow.
HYPOTHESES, STATES, SIGNALS, DEPTH, MODELS, PARAMETERS, ORDER, KERNEL, AXES, TAPS = range(10)
N_SIZES = 10


@dataclass(frozen=True)
class Layout:
    """Where what lies in the memory of an observer.

    Attributes
    ----------
    hypotheses, states, signals, depth : sizes
    """

    hypotheses: int
    states: int
    signals: int
    depth: int

    @property
    def shapes(self) -> tuple[tuple[int, ...], ...]:
        """Shapes of states, covariances, weights, filters, past signals and the rest."""
        j, s, k, d = self.hypotheses, self.states, self.signals, self.depth
        return (j, s), (j, s, s), (j,), (2, k, 3), (2, d, k), (N_HELD,)

    @property
    def size(self) -> int:
        """Number of values."""
        return sum(int(np.prod(shape)) for shape in self.shapes)

    def part(self, memory: FloatArray, number: int) -> FloatArray:
        """View of one part of the memory."""
        start = sum(int(np.prod(shape)) for shape in self.shapes[:number])
        shape = self.shapes[number]
        return memory[start : start + int(np.prod(shape))].reshape(shape)


def pack(
    net: FlatNetwork, level: FloatArray, gains: FloatArray, constants: FloatArray, layout: Layout
) -> tuple[FloatArray, np.ndarray]:
    """Lay a network with the observer's own constants into an array of numbers and one of whole numbers."""
    n_models, n_params = net.theta.shape
    sizes = [layout.hypotheses, layout.states, layout.signals, layout.depth, n_models, n_params, net.order, net.kernel]
    sizes += [len(net.axis_signal), len(net.tap_signal)]
    indices = (net.kind, net.tap_signal, net.tap_lag, net.axis_signal, net.axis_lag)
    whole = np.concatenate([np.array(sizes), *(np.ravel(part) for part in indices)]).astype(np.int64)
    scalars = (net.rest_A, net.soc_per_A, net.efficiency, net.voltage_low, net.voltage_span)
    arrays = (net.theta, net.centres, net.widths, net.pole, net.activation_K, net.exchange_A, net.factor, net.low)
    parts: tuple[Any, ...] = (scalars, *arrays, net.span, level, gains, constants)
    return np.concatenate([np.ravel(np.asarray(part, dtype=np.float64)) for part in parts]), whole


@njit(cache=True)
def unpack_network(numbers: np.ndarray, whole: np.ndarray) -> tuple:
    """Views of network, error levels, gains and constants."""
    m, p, k = whole[MODELS], whole[PARAMETERS], whole[SIGNALS]
    axes, taps, states = whole[AXES], whole[TAPS], whole[STATES]
    at = 5
    theta = numbers[at : at + m * p].reshape(m, p)
    at += m * p
    centres = numbers[at : at + m * axes].reshape(m, axes)
    at += m * axes
    widths = numbers[at : at + m * axes].reshape(m, axes)
    at += m * axes
    pole = numbers[at : at + 3 * k].reshape(k, 3)
    at += 3 * k
    each = numbers[at : at + 5 * k].reshape(5, k)
    at += 5 * k
    level = numbers[at : at + m]
    at += m
    gains = numbers[at : at + m * (states + 1)].reshape(m, states + 1)
    constants = numbers[at + m * (states + 1) :]
    start = N_SIZES + k
    net = FlatNetwork(
        theta,
        centres,
        widths,
        whole[KERNEL],
        whole[ORDER],
        whole[N_SIZES:start],
        pole,
        each[0],
        each[1],
        each[2],
        each[3],
        each[4],
        whole[start : start + taps],
        whole[start + taps : start + 2 * taps],
        whole[start + 2 * taps : start + 2 * taps + axes],
        whole[start + 2 * taps + axes : start + 2 * taps + 2 * axes],
        numbers[0],
        numbers[1],
        numbers[2],
        numbers[3],
        numbers[4],
    )
    return net, level, gains, constants


@njit(cache=True)
def unpack_memory(memory: np.ndarray, whole: np.ndarray) -> tuple:
    """Views of states, covariances, weights, filters, past signals and the rest."""
    j, s, k, d = whole[HYPOTHESES], whole[STATES], whole[SIGNALS], whole[DEPTH]
    at = j * s
    x = memory[:at].reshape(j, s)
    covariance = memory[at : at + j * s * s].reshape(j, s, s)
    at += j * s * s
    weight = memory[at : at + j]
    at += j
    filters = memory[at : at + 6 * k].reshape(2, k, 3)
    at += 6 * k
    history = memory[at : at + 2 * d * k].reshape(2, d, k)
    return x, covariance, weight, filters, history, memory[at + 2 * d * k :]


@njit(cache=True)
def _scratch(whole: np.ndarray) -> np.ndarray:
    width = max(max(whole[MODELS], whole[PARAMETERS]), max(whole[HYPOTHESES], whole[STATES] + 1))
    return np.empty((MOVED_ROWS + whole[STATES], width))


@njit(cache=True)
def replay(
    numbers: np.ndarray,
    whole: np.ndarray,
    memory: np.ndarray,
    current_A: np.ndarray,
    voltage_V: np.ndarray,
    temperature_degC: np.ndarray,
    out: np.ndarray,
) -> None:
    """Run `compiled.step` over whole arrays; `memory` is updated in place, `out` is (N, N_OUT) in physical units."""
    net, level, gains, constants = unpack_network(numbers, whole)
    x, covariance, weight, filters, history, held = unpack_memory(memory, whole)
    scratch = _scratch(whole)
    for k in range(current_A.shape[0]):
        compiled.step(
            net, level, gains, constants, x, covariance, weight, filters, history, held, scratch,
            current_A[k], voltage_V[k], temperature_degC[k], out[k],
        )  # fmt: skip


@njit(cache=True)
def step(
    numbers: np.ndarray,
    whole: np.ndarray,
    memory: np.ndarray,
    current_A: float,
    voltage_V: float,
    temperature_degC: float,
    out: np.ndarray,
) -> None:
    """Run `compiled.step` once; see `replay`."""
    net, level, gains, constants = unpack_network(numbers, whole)
    x, covariance, weight, filters, history, held = unpack_memory(memory, whole)
    scratch = _scratch(whole)
    compiled.step(
        net, level, gains, constants, x, covariance, weight, filters, history, held, scratch,
        current_A, voltage_V, temperature_degC, out,
    )  # fmt: skip
