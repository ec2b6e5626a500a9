"""Identification runs as if the model had not seen them.

A model errs less on the runs that it was fitted to than on others: what its parameters are wrong by does not show. A
draw from their covariance puts it back, so that noise that is tuned on such runs holds for those to come.

A covariance knows of no bounds. Where runs tell little, as one run at one mean current does, half of the draws are
cells that cannot be, with open-circuit curves that fall; a filter that looks for its place on these goes astray in a
way that no cell would make it. So a draw is moved to the nearest cell that can be.

Nor does it know that all local models share their poles. Each with poles of its own, near the unit circle, two past
outputs grow without end (a network of 30 had free runs of 1e276 V). So a draw is one given the poles.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.network.local_model_network import LocalModelNetwork
from models.readouts.possible_cell import made_possible
from models.uncertainty.model_uncertainty import uncertainty_of

# Each run of a few is seen with several draws: one alone can be lucky.
_LEAST = 8
_SEED = 20


@dataclass(frozen=True)
class Judged:
    """A run to judge by, with its SoC at the start and the model that is held against it."""

    network: LocalModelNetwork
    run: GridRun
    initial_soc: float


def as_they_are(network: LocalModelNetwork, runs: list[GridRun], initial_soc: list[float]) -> list[Judged]:
    """Runs that the model has not seen."""
    return [Judged(network, run, soc) for run, soc in zip(runs, initial_soc, strict=True)]


def as_unseen(network: LocalModelNetwork, runs: list[GridRun], initial_soc: list[float]) -> list[Judged]:
    """Runs that the model was fitted to, each against a model whose parameters are drawn from their covariance.

    Without a covariance in its record the model stays as it is. The same model gives the same draws.
    """
    uncertainty = uncertainty_of(network)
    if uncertainty is None:
        return as_they_are(network, runs, initial_soc)
    factor, rng = _given_poles(network, uncertainty.parameters.theta_factor), np.random.default_rng(_SEED)
    times = -(-_LEAST // len(runs)) if runs else 0
    return [
        Judged(_drawn(network, factor, rng), each.run, each.initial_soc)
        for each in times * as_they_are(network, runs, initial_soc)
    ]


def _given_poles(network: LocalModelNetwork, factor: FloatArray) -> FloatArray:
    """(M p, P) factor of the covariance of the parameters, given those of the past outputs."""
    poles = factor.reshape(*network.theta.shape, -1)[:, : network.structure.output_order].reshape(-1, factor.shape[1])
    return factor - (factor @ np.linalg.pinv(poles)) @ poles if len(poles) else factor


def _drawn(network: LocalModelNetwork, factor: FloatArray, rng: np.random.Generator) -> LocalModelNetwork:
    away = factor @ rng.standard_normal(factor.shape[1])
    return made_possible(replace(network, theta=network.theta + away.reshape(network.theta.shape)), factor)
