"""A coarse copy of a network by hats: what an experiment is to tell, in as few parameters as the network really has.

A bounded network gives each gain at a few knots only and the curve between them at many more, all written at the
curve's knots: 1500 parameters stand for 150. What a current tells of them does not depend on their values, as there is
no output feedback, so a copy with the knots of the gains, and without the terms that do next to nothing, asks for the
same experiment. Voltages are not predicted with it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.data.timeseries import FloatArray
from models.network.local_model_network import LocalModelNetwork
from models.network.partition import hat_partition
from models.uncertainty.expansion import Expansion
from models.uncertainty.model_uncertainty import Uncertainty, uncertainty_of

# Networks with fewer parameters than this are taken as they are.
_FEW = 200
# A term that never makes more than this, nor this share of what the largest does, is left out.
_NEGLIGIBLE_V, _NEGLIGIBLE = 1e-3, 0.02
# Every n-th knot, where nothing says at which ones the gains are free.
_EVERY = 4


def coarse_copy(network: LocalModelNetwork) -> tuple[LocalModelNetwork, FloatArray | None]:
    """Coarse copy, and what is known of its parameters; the network itself where it is no large one by hats.

    Parameters
    ----------
    network : with its record

    Returns
    -------
    The copy, and the (P, P) covariance of its parameters, `theta.ravel()`, normalised units; None where the record does
    not say.
    """
    uncertainty = uncertainty_of(network)
    structure = network.structure
    if structure.kernel != "hat" or structure.output_order or network.theta.size <= _FEW:
        return network, None if uncertainty is None else uncertainty.parameters.covariance
    knots = _knots(network.n_models, None if uncertainty is None else uncertainty.parameters.expansion)
    inputs = _telling(network)
    columns = np.append(np.flatnonzero(np.isin(_input_of(network), inputs)), network.theta.shape[1] - 1)
    coarse = LocalModelNetwork(
        replace(structure, inputs=tuple(structure.inputs[i] for i in inputs), name=f"{structure.name}, coarse"),
        hat_partition(network.partition.centres[knots, 0]),
        np.ascontiguousarray(network.theta[np.ix_(knots, columns)]),
        network.scaling,
        network.cell,
    )
    return coarse, None if uncertainty is None else _covariance(network, uncertainty, knots, columns)


def _knots(n_models: int, expansion: Expansion | None) -> np.ndarray:
    """Those that most of the gains have, and the outermost two."""
    gains = () if expansion is None else expansion.places[:-1]
    if gains:
        inner = max(gains, key=lambda each: (gains.count(each), len(each)))
    else:
        inner = tuple(range(1, n_models - 1, _EVERY)) + (n_models - 2,)
    return np.unique([0, *inner, n_models - 1])


def _input_of(network: LocalModelNetwork) -> np.ndarray:
    """(taps,) number of the input channel that each tap belongs to."""
    return np.concatenate([np.full(channel.taps, i) for i, channel in enumerate(network.structure.inputs)])


def _telling(network: LocalModelNetwork) -> np.ndarray:
    """Numbers of the inputs that do more than next to nothing anywhere, at the largest signal of the training runs."""
    largest_V = network.voltage_span_V * np.abs(network.theta[:, :-1]).max(axis=0)
    least_V = max(_NEGLIGIBLE_V, _NEGLIGIBLE * float(largest_V.max()))
    return np.unique(_input_of(network)[largest_V >= min(least_V, float(largest_V.max()))])


def _covariance(
    network: LocalModelNetwork, uncertainty: Uncertainty, knots: np.ndarray, columns: np.ndarray
) -> FloatArray:
    """Of the parameters at some knots and columns, whatever the others are."""
    places = (knots[:, None] * network.theta.shape[1] + columns).ravel()
    factor = uncertainty.parameters.theta_factor[places]
    return factor @ factor.T
