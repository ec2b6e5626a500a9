"""A choice with its parameters, fitted on all samples with the poles shared."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from models.data.timeseries import FloatArray
from models.identification.lolimot import grow_partitions
from models.identification.search.candidate import Choice
from models.identification.shared_poles import (
    Moments,
    SharedPoleFit,
    filtered,
    fit,
    moments,
    output_coefficients,
    penalties,
)
from models.network.partition import Partition
from models.network.regression import VOLTAGE, Dataset, Scaling, SignalBank, build_dataset, find_scaling
from models.network.structure import Structure

# Samples in the sums of the final fit where there are no past outputs; more of them tell nothing new.
_STATIC_SAMPLES = 400_000


@dataclass(frozen=True)
class Fitted:
    """A candidate with its parameters: everything that refinement and document need."""

    structure: Structure
    scaling: Scaling
    data: Dataset
    partition: Partition
    a: FloatArray
    sums: Moments
    fit: SharedPoleFit

    @property
    def theta(self) -> FloatArray:
        """(M, p) parameters with the shared poles in each local model."""
        return full_theta(self.a, self.fit.b, self.partition.n_models)

    @property
    def held_out_rmse_V(self) -> float:
        """Free-run RMSE on held-out samples in V."""
        return float(np.sqrt(self.fit.held_out_mse)) * span_V(self.scaling)


def fitted_choice(choice: Choice, bank: SignalBank, strengths: tuple[float, ...] | None) -> Fitted:
    """Construct and fit a choice with its poles shared, on all samples.

    Parameters
    ----------
    choice : what was chosen
    bank : signals of the runs
    strengths : of the penalties to begin with, where they are known
    """
    runs, soc, cell = bank.runs, bank.initial_soc, bank.cell
    dt_s, n_samples = runs[0].dt_s, sum(len(run) for run in runs)
    structure = choice.structure(dt_s)
    # Without past outputs a sample stands for itself, and those that do not count need not be made.
    keep_every = 1 if choice.poles_s else max(1, n_samples // _STATIC_SAMPLES)
    scaling = find_scaling(structure, runs, soc, cell, bank)
    data = build_dataset(structure, scaling, runs, soc, cell, bank, keep_every)
    a = output_coefficients(choice.poles_s, dt_s)
    with threadpool_limits(1, user_api="blas"):
        inputs, target = filtered(data, a)
        *_, partition = grow_partitions(structure, inputs, target, data.z, choice.n_models, keep_every)
        sums = moments(partition, data, a, data.groups())
        chosen = fit(sums, penalties(structure, partition, data, a), strengths)
    return Fitted(structure, scaling, data, partition, a, sums, chosen)


def full_theta(a: FloatArray, b: FloatArray, n_models: int) -> FloatArray:
    """(M, p) parameters from shared output coefficients and stacked input parameters."""
    return np.hstack([np.tile(a, (n_models, 1)), b.reshape(n_models, -1)])


def span_V(scaling: Scaling) -> float:
    """Volts per unit of normalised output."""
    return scaling[VOLTAGE][1] - scaling[VOLTAGE][0]
