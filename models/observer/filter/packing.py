"""Network and memory as three flat arrays, so that a live call hands over little.

Each array that goes into a compiled function costs about half a microsecond to look at; a network is thirty of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from models.data.timeseries import FloatArray
from models.network.compiled_network import FlatNetwork
from models.observer.filter import compiled
from models.observer.filter.blending import GROUP, Prepared, prepare
from models.observer.filter.places import AXIS_ROWS, N_ERRORS, N_HELD

# Places in the array of whole numbers; the index arrays of the network follow.
HYPOTHESES, STATES, SIGNALS, DEPTH, MODELS, PARAMETERS, ORDER, KERNEL, AXES, TAPS, INTERVALS = range(11)
N_SIZES = 11


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
    net: FlatNetwork, errors: FloatArray, gains: FloatArray, constants: FloatArray, layout: Layout
) -> tuple[FloatArray, np.ndarray]:
    """Lay a network with the observer's own constants into an array of numbers and one of whole numbers."""
    n_models, n_params = net.theta.shape
    sizes = [layout.hypotheses, layout.states, layout.signals, layout.depth, n_models, n_params, net.order, net.kernel]
    prepared = prepare(net)
    sizes += [len(net.axis_signal), len(net.tap_signal), prepared.centre.shape[1]]
    indices = (net.form, net.tap_signal, net.tap_lag, net.axis_signal, net.axis_lag, prepared.counts, prepared.member)
    whole = np.concatenate([np.array(sizes), *(np.ravel(part) for part in indices)]).astype(np.int64)
    scalars = (net.rest_A, net.soc_per_A, net.efficiency, net.voltage_low, net.voltage_span)
    arrays = (net.theta, net.centres, net.widths, net.pole, net.activation_K, net.exchange_A, net.factor, net.low)
    parts: tuple[Any, ...] = (
        scalars,
        *arrays,
        net.span,
        prepared.centre,
        prepared.per_width,
        prepared.theta,
        prepared.per_span,
        errors,
        gains,
        constants,
    )
    return np.concatenate([np.ravel(np.asarray(part, dtype=np.float64)) for part in parts]), whole


@njit(cache=True, error_model="numpy")
def unpack_network(numbers: np.ndarray, whole: np.ndarray) -> tuple:
    """Views of network, its partition, error sizes, gains and constants."""
    m, p, k = whole[MODELS], whole[PARAMETERS], whole[SIGNALS]
    axes, taps, states, most = whole[AXES], whole[TAPS], whole[STATES], whole[INTERVALS]
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
    interval = numbers[at : at + 2 * axes * most].reshape(2, axes, most)
    at += 2 * axes * most
    groups = (p + GROUP - 1) // GROUP
    in_groups = numbers[at : at + groups * m * GROUP].reshape(groups, m, GROUP)
    at += groups * m * GROUP
    per_span = numbers[at : at + k]
    at += k
    errors = numbers[at : at + N_ERRORS * m].reshape(N_ERRORS, m)
    at += N_ERRORS * m
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
    start += 2 * taps + 2 * axes
    member = whole[start + axes : start + axes + axes * m].reshape(axes, m)
    prepared = Prepared(interval[0], interval[1], whole[start : start + axes], member, in_groups, per_span)
    return net, prepared, errors, gains, constants


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
def _scratch(whole: np.ndarray) -> np.ndarray:
    width = max(max(whole[MODELS], whole[PARAMETERS] + GROUP), max(whole[HYPOTHESES], whole[STATES] + 1))
    return np.empty((AXIS_ROWS + 2 * whole[AXES], width))


@njit(cache=True, error_model="numpy")
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
    net, prepared, errors, gains, constants = unpack_network(numbers, whole)
    x, covariance, weight, filters, history, held = unpack_memory(memory, whole)
    scratch = _scratch(whole)
    for k in range(current_A.shape[0]):
        compiled.step(
            net, prepared, errors, gains, constants, x, covariance, weight, filters, history, held, scratch,
            current_A[k], voltage_V[k], temperature_degC[k], out[k],
        )  # fmt: skip


@njit(cache=True, error_model="numpy")
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
    net, prepared, errors, gains, constants = unpack_network(numbers, whole)
    x, covariance, weight, filters, history, held = unpack_memory(memory, whole)
    scratch = _scratch(whole)
    compiled.step(
        net, prepared, errors, gains, constants, x, covariance, weight, filters, history, held, scratch,
        current_A, voltage_V, temperature_degC, out,
    )  # fmt: skip
