"""The free run from current and temperature to voltage in blocks, in memory that does not grow with the run.

Signals, validity functions, blend and recursion of a block are made and used while they are in the cache, where the
arrays of a regression would take some hundred bytes for each sample. Gaussian kernels factorise over the axes, and
local models share edges, so that fewer exponentials are needed than there are local models. Of hats only two count at
a time.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.network.blocked_signals import make_signals
from models.network.compiled_network import FlatNetwork, flat_network, has_loop_forms
from models.network.hats import blend_block
from models.network.local_model_network import LocalModelNetwork
from models.network.signals import soc_by_counting
from models.network.signals.temperature_scale import inside_trained

_BLOCK = 4096
# Hats blend tap by tap and need no validity functions beside; the signals then stay in the cache.
_HAT_BLOCK = 1024
# OpenBLAS takes one thread for matrix products of up to this many multiplications (interface/gemm.c); a pool of threads
# for small ones can be ten times slower, and to pin it for each call takes as long as simulating 10 000 samples.
_ONE_THREAD = 1 << 18
# Sums of kernels below this have lost digits; the validity functions are then made relative to the nearest box.
_SMALLEST_SUM = 1e-200
# Below this many samples the arrays of a regression are as quick.
_SHORT = 256


class Factors(NamedTuple):
    """Kernels of single axes: each local model's kernel is the product of one of each axis.

    Attributes
    ----------
    axis, centre, inverse_width : (F,) of each factor
    of_model : (M, axes) which factor a local model takes on each axis
    """

    axis: np.ndarray
    centre: np.ndarray
    inverse_width: np.ndarray
    of_model: np.ndarray


def runs_in_blocks(network: LocalModelNetwork, run: GridRun) -> bool:
    """Whether the blocked run covers a network and a run: Gaussian or hats, no missing temperature, not too short."""
    whole = len(run) >= _SHORT and not bool(np.isnan(run.temperature_degC).any())
    return network.partition.kernel in ("gaussian", "hat") and whole and has_loop_forms(network.structure)


def blocked_free_run_V(network: LocalModelNetwork, run: GridRun, initial_soc: float) -> FloatArray:
    """(n,) simulated voltage in V; equal to the free run on the arrays of a regression but for rounding.

    Parameters
    ----------
    network, run : as `runs_in_blocks` asks for
    initial_soc : fraction 0..1
    """
    out = np.empty(len(run))
    if network.partition.kernel == "hat":
        _run_hats(network, run, initial_soc, out)
    else:
        _run_gaussian(network, run, initial_soc, out)
    return network.to_volts(out)


class Block(NamedTuple):
    """A block of the run: where it lies, and the normalised signals, whose own values begin at `depth`."""

    part: slice
    values: FloatArray
    depth: int


def _blocks(
    network: LocalModelNetwork, net: FlatNetwork, run: GridRun, initial_soc: float, most: int
) -> Iterator[Block]:
    """Signals of one block after the other, of up to `most` samples, in the same memory."""
    depth = int(max(net.tap_lag.max(), net.axis_lag.max()))
    filters, held = np.zeros((len(net.form), 3)), np.array([-1.0, run.current_A[0]])
    values = np.empty((len(net.form), depth + most))
    soc = initial_soc
    for begin in range(0, len(run), most):
        part = slice(begin, min(begin + most, len(run)))
        size = part.stop - part.start
        counted, soc = _counted(network, run.charge_Ah, part, initial_soc, soc)
        now = values[:, depth : depth + size]
        make_signals(net, filters, held, run.current_A[part], run.temperature_degC[part], counted, now)
        if begin == 0:
            values[:, :depth] = now[:, :1]
        yield Block(part, values, depth)
        values[:, :depth] = values[:, size : size + depth].copy()


def _run_gaussian(network: LocalModelNetwork, run: GridRun, initial_soc: float, out: FloatArray) -> None:
    net, factors = flat_network(network), _factors(network)
    since, past = _since_start(run, net.order), np.zeros(2)
    # The last row sums the validity functions, which are normalised only then.
    weights = np.vstack([network.theta.T, np.ones(network.n_models)])
    validity = np.empty((network.n_models, _BLOCK))
    for part, values, depth in _blocks(network, net, run, initial_soc, _BLOCK):
        size = part.stop - part.start
        kernels = _exponents(net, factors, values, depth, size)
        np.exp(kernels, out=kernels)
        _products(factors.of_model, kernels, validity[:, :size])
        blended = _blend(weights, validity[:, :size])
        lost = blended[-1] < _SMALLEST_SUM
        if lost.any():
            _repair(network, net, values, depth, np.flatnonzero(lost), weights, blended)
        _recursion(net, values, depth, blended, since[part], run.voltage_V[part], past, out[part])


def _run_hats(network: LocalModelNetwork, run: GridRun, initial_soc: float, out: FloatArray) -> None:
    net, share = flat_network(network), np.empty(_HAT_BLOCK)
    for part, values, depth in _blocks(network, net, run, initial_soc, _HAT_BLOCK):
        begin = depth - net.axis_lag[0]
        axis = values[net.axis_signal[0], begin : begin + part.stop - part.start]
        blend_block(net.theta, net.centres, axis, values, net.tap_signal, net.tap_lag, depth, share, out[part])


def _since_start(run: GridRun, order: int) -> np.ndarray:
    """(n,) samples since a part's start, up to the output order."""
    since = np.full(len(run), order, dtype=np.uint8)
    for start in run.segment_starts:
        for k in range(start, min(start + order, len(run))):
            since[k] = k - start
    return since


def _counted(
    network: LocalModelNetwork, charge_Ah: FloatArray, part: slice, initial_soc: float, last_soc: float
) -> tuple[FloatArray, float]:
    """State of charge of a block, and at its end."""
    cell = network.cell
    if cell.efficiency == 1.0:
        return initial_soc + charge_Ah[part] / cell.capacity_Ah, last_soc
    lead = slice(max(part.start - 1, 0), part.stop)
    soc = soc_by_counting(charge_Ah[lead], last_soc, cell.capacity_Ah, cell.efficiency)
    return soc[part.start - lead.start :], float(soc[-1])


def _factors(network: LocalModelNetwork) -> Factors:
    centres, inverse = network.partition.centres, 1.0 / network.partition.widths
    axis: list[int] = []
    centre: list[float] = []
    inverse_width: list[float] = []
    of_model = np.empty(centres.shape, dtype=np.int64)
    for j in range(centres.shape[1]):
        pairs, member = np.unique(np.column_stack([centres[:, j], inverse[:, j]]), axis=0, return_inverse=True)
        of_model[:, j] = len(axis) + np.asarray(member).ravel()
        axis += [j] * len(pairs)
        centre += pairs[:, 0].tolist()
        inverse_width += pairs[:, 1].tolist()
    return Factors(np.array(axis), np.array(centre), np.array(inverse_width), of_model)


def _blend(weights: FloatArray, validity: FloatArray) -> FloatArray:
    """(p + 1, size) sums over the local models, one thread at a time."""
    out = np.empty((len(weights), validity.shape[1]))
    step = max(_ONE_THREAD // weights.size, 1)
    for first in range(0, out.shape[1], step):
        columns = slice(first, first + step)
        np.matmul(weights, validity[:, columns], out=out[:, columns])
    return out


def _repair(
    network: LocalModelNetwork,
    net: FlatNetwork,
    values: FloatArray,
    depth: int,
    lost: np.ndarray,
    weights: FloatArray,
    blended: FloatArray,
) -> None:
    """Blend again, relative to the nearest box, where all kernels vanish."""
    columns = [values[s, depth - lag + lost] for s, lag in zip(net.axis_signal, net.axis_lag, strict=True)]
    blended[:, lost] = weights @ network.partition.validity(np.column_stack(columns)).T


@njit(cache=True)
def _make_exponents(net: FlatNetwork, factors: Factors, values: np.ndarray, depth: int, size: int) -> np.ndarray:
    """(F, size) exponents of the kernels of single axes."""
    out = np.empty((factors.axis.shape[0], size))
    for f in range(factors.axis.shape[0]):
        j = factors.axis[f]
        row, form = values[net.axis_signal[j]], int(net.form[net.axis_signal[j]])
        begin, centre, inverse = depth - net.axis_lag[j], factors.centre[f], factors.inverse_width[f]
        for k in range(size):
            scaled = (inside_trained(form, float(row[begin + k])) - centre) * inverse
            out[f, k] = -0.5 * scaled * scaled
    return out


@njit(cache=True)
def _multiply(of_model: np.ndarray, kernels: np.ndarray, out: np.ndarray) -> None:
    """Write the (M, size) products of the kernels that each local model takes."""
    for i in range(of_model.shape[0]):
        first, target = kernels[of_model[i, 0]], out[i]
        for k in range(target.shape[0]):
            target[k] = first[k]
        for j in range(1, of_model.shape[1]):
            factor = kernels[of_model[i, j]]
            for k in range(target.shape[0]):
                target[k] *= factor[k]


@njit(cache=True)
def _recur(
    net: FlatNetwork,
    values: np.ndarray,
    depth: int,
    blended: np.ndarray,
    since: np.ndarray,
    measured_V: np.ndarray,
    past: np.ndarray,
    out: np.ndarray,
) -> None:
    """Contributions of the inputs, then the recursion; `past` holds the last two outputs, newest first."""
    order, n_taps, size = net.order, net.tap_signal.shape[0], out.shape[0]
    n_params = order + n_taps + 1
    for k in range(size):
        out[k] = blended[n_params - 1, k]
    for t in range(n_taps):
        row, begin = values[net.tap_signal[t]], depth - net.tap_lag[t]
        for k in range(size):
            out[k] += blended[order + t, k] * row[begin + k]
    one, two = past[0], past[1]
    for k in range(size):
        inverse = 1.0 / blended[n_params, k]
        value = out[k] * inverse
        if since[k] < order:
            measured = (measured_V[k] - net.voltage_low) / net.voltage_span
            if not np.isnan(measured):
                value = measured
            elif since[k] > 0:
                value = one
            else:
                gain = 1.0
                for j in range(order):
                    gain -= blended[j, k] * inverse
                value /= gain
        else:
            if order > 0:
                value += blended[0, k] * inverse * one
            if order > 1:
                value += blended[1, k] * inverse * two
        out[k] = value
        two, one = one, value
    past[0], past[1] = one, two


# Seen through Any: the type checker takes the compiled functions' tuples of arguments for single ones.
_exponents: Any = _make_exponents
_products: Any = _multiply
_recursion: Any = _recur
