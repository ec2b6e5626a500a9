"""What a person wants to see of a design: what it tells over time, where it goes, and what other signals would tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.data.errors import ModelError
from models.data.timeseries import FloatArray
from models.design.design import design
from models.design.information.coloured import told_over_time
from models.design.information.experiment import Experiment
from models.design.information.parameters import parameter_std
from models.design.optimise.block_design import DesignRequest
from models.design.test_signals import find_families

# With many parameters, as networks by hats have them, each point takes half a second.
_POINTS, _FEW_POINTS, _MANY = 60, 20, 1000
_SOC_BINS, _CURRENT_BINS = 20, 15


def mean_std_over_time(experiment: Experiment, current_A: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Geometric mean of the parameters' standard deviations as a test goes on.

    Returns
    -------
    time_s, mean_std : (n,) normalised units; from the start, where the prior alone tells
    """
    points = _POINTS if experiment.network.theta.size <= _MANY else _FEW_POINTS
    ends = np.unique(np.linspace(0, len(current_A), points + 1).astype(int))
    std = [mean_std(information) for information in told_over_time(experiment, current_A, ends)]
    return ends * experiment.network.structure.dt_s, np.array(std)


def mean_std(information: FloatArray) -> float:
    """Geometric mean of the parameters' standard deviations."""
    return float(np.exp(np.log(parameter_std(information)).mean()))


def family_std(experiment: Experiment, request: DesignRequest) -> dict[str, float | None]:
    """Geometric mean that each family of signals would leave in the same time and limits; None where it cannot."""
    found: dict[str, float | None] = {}
    for name in find_families():
        try:
            found[name] = mean_std(design(experiment, replace(request, signal=name)).information)
        except ModelError:
            found[name] = None
    return found


def coverage(
    soc: FloatArray, current_A: FloatArray, soc_window: tuple[float, float], current_window_A: tuple[float, float]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """How much of the time is spent where: shares by SoC and current, rests included.

    Returns
    -------
    share : (n, m), edges of the n intervals of SoC, edges of the m intervals of current in A
    """
    soc_edges = np.linspace(*soc_window, _SOC_BINS + 1)
    current_edges = np.linspace(*current_window_A, _CURRENT_BINS + 1)
    count, _, _ = np.histogram2d(
        np.clip(soc, *soc_window), np.clip(current_A, *current_window_A), (soc_edges, current_edges)
    )
    return count / max(len(soc), 1), soc_edges, current_edges
