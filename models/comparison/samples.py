"""What a model's error is looked at over: one set of samples out of several compared runs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.comparison.simulated_runs import RunComparison
from models.data.errors import ModelError
from models.data.timeseries import FloatArray
from models.network.cell_model import CellModel
from models.network.signals import held_sign

# A step is a change of the current that a person would call one.
_STEP_C_RATE = 0.1
REST_C_RATE = 0.005


@dataclass(frozen=True)
class ErrorSamples:
    """All samples inside the trained domain that have an error.

    Attributes
    ----------
    error_V : (n,) measured minus model
    soc, c_rate, temperature_degC : (n,)
    direction : (n,) +1 after charge, -1 after discharge, held through rests
    since_step_s : (n,) time since the last step of the current
    throughput_Ah : (n,) charge moved either way since the start of the first run
    progress : (n,) share 0..1 of the time of all runs, one after the other
    capacity_Ah, total_s : of the cell; of all runs
    """

    error_V: FloatArray
    soc: FloatArray
    c_rate: FloatArray
    temperature_degC: FloatArray
    direction: FloatArray
    since_step_s: FloatArray
    throughput_Ah: FloatArray
    progress: FloatArray
    capacity_Ah: float
    total_s: float


def error_samples(network: CellModel, compared: list[RunComparison]) -> tuple[ErrorSamples, float]:
    """Gather the samples, and the share of those with an error that lie outside the trained domain.

    Raises
    ------
    ModelError
        No run, or no measured voltage.
    """
    if not compared:
        raise ModelError("nothing to look at: no run was given")
    capacity_Ah = network.cell.capacity_Ah
    error = np.concatenate([each.residual_V for each in compared])
    inside = np.concatenate([each.inside for each in compared])
    known = ~np.isnan(error)
    # Outside the trained domain a model guesses; where nothing lies inside, a guess is all there is to look at.
    chosen = known & inside if (known & inside).any() else known
    if not chosen.any():
        raise ModelError("nothing to look at: the runs have no measured voltage on the model's grid")
    dt_s = np.concatenate([np.full(len(each.run), each.run.dt_s) for each in compared])
    total_s = float(dt_s.sum())
    c_rates = [each.run.current_A / capacity_Ah for each in compared]
    since = [since_step_s(rate, each.run.dt_s) for rate, each in zip(c_rates, compared, strict=True)]
    samples = ErrorSamples(
        error_V=error[chosen],
        soc=np.concatenate([each.soc for each in compared])[chosen],
        c_rate=np.concatenate(c_rates)[chosen],
        temperature_degC=np.concatenate([each.run.temperature_degC for each in compared])[chosen],
        direction=np.concatenate([held_sign(rate, REST_C_RATE) for rate in c_rates])[chosen],
        since_step_s=np.concatenate(since)[chosen],
        throughput_Ah=_throughput_Ah(compared, dt_s)[chosen],
        progress=(np.cumsum(dt_s) - dt_s)[chosen] / total_s,
        capacity_Ah=capacity_Ah,
        total_s=total_s,
    )
    return samples, float(1.0 - inside[known].mean())


def _throughput_Ah(compared: list[RunComparison], dt_s: FloatArray) -> FloatArray:
    moved_A = np.abs(np.nan_to_num(np.concatenate([each.run.current_A for each in compared])))
    return np.cumsum(moved_A * dt_s) / 3600.0


def since_step_s(c_rate: FloatArray, dt_s: float) -> FloatArray:
    """Time in s since the last step of the current, from the start of the run where there was none."""
    index = np.arange(len(c_rate))
    stepped = np.concatenate([[True], np.abs(np.diff(np.nan_to_num(c_rate))) > _STEP_C_RATE])
    return (index - np.maximum.accumulate(np.where(stepped, index, 0))) * dt_s


def spread(values: FloatArray) -> float:
    """Range of the values; 0 where there is none."""
    return 0.0 if np.isnan(values).all() else float(np.nanmax(values) - np.nanmin(values))
