"""Sensitivities of a network's free run to its parameters, at chosen samples."""

from __future__ import annotations

import numpy as np

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.network.local_model_network import LocalModelNetwork
from models.network.partition import hat_partition
from models.network.recursion import blend, free_run, initial_samples, sensitivity_block

_BLOCK = 4096
# A network by hats with more parameters than this has knots closer together than its gains are told from one another:
# there each but the offset may err in straight lines between so many knots.
_MANY, _KNOTS = 600, 10


def directions_V(network: LocalModelNetwork, run: GridRun, initial_soc: float, index: np.ndarray) -> FloatArray:
    """(m, k) changes of the simulated voltage by what the network's parameters may be wrong by, in V.

    Parameters as in `sensitivities_V`, whose columns these are but for networks by many hats.
    """
    if network.structure.kernel != "hat" or network.theta.size <= _MANY:
        return sensitivities_V(network, run, initial_soc, index)
    data = network.dataset([run], [initial_soc])
    fine, knots = network.partition.validity(data.z[index]), network.partition.centres
    few = np.unique(np.round(np.linspace(0, len(knots) - 1, _KNOTS)).astype(int))
    coarse = fine @ hat_partition(knots[few, 0]).validity(knots)
    gains = coarse[:, :, None] * data.u[index][:, None, :-1]
    return network.voltage_span_V * np.hstack([gains.reshape(len(index), -1), fine])


def sensitivities_V(network: LocalModelNetwork, run: GridRun, initial_soc: float, index: np.ndarray) -> FloatArray:
    """(m, M p) derivatives of the simulated voltage to the network's parameters, in V per normalised unit.

    Parameters
    ----------
    network : with or without output feedback
    run, initial_soc : one run on the network's grid
    index : (m,) rising
    """
    data = network.dataset([run], [initial_soc])
    order = network.structure.output_order
    validity = network.partition.validity(data.z)
    if order == 0:
        rows = validity[index][:, :, None] * data.u[index][:, None, :]
        return network.voltage_span_V * rows.reshape(len(index), -1)
    a, _ = blend(network.theta, order, validity, data)
    simulated = free_run(network.theta, order, validity, data)
    is_start = initial_samples(len(data), data.starts, order)
    carry, block = np.zeros((order, network.theta.size)), np.empty((_BLOCK, network.theta.size))
    out = np.empty((len(index), network.theta.size))
    for first in range(0, len(data), _BLOCK):
        rows = block[: min(_BLOCK, len(data) - first)]
        sensitivity_block(first, validity, data.u, simulated, a, is_start, carry, rows)
        low, high = np.searchsorted(index, [first, first + len(rows)])
        out[low:high] = rows[index[low:high] - first]
    return network.voltage_span_V * out
