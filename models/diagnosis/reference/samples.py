"""Samples of runs that a diagnosis looks at, with the regressors of the model and of every effect."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.diagnosis.reference.reference import Reference
from models.effects import Effect
from models.effects.view import View

# After an excursion out of the trained domain its traces last: relaxation, heat.
_AFTERMATH_S = 600.0
_SLACK = 0.005
_SOC_SLACK = 0.01
_TEMPERATURE_SLACK_K = 0.8
# A block in time is long enough to be nearly independent of the next.
_BLOCK_S = 900.0
_MAX_BLOCKS = 60
# A temperature that moves less shows nothing of what temperature does.
_TEMPERATURE_RANGE_K = 1.5


@dataclass(frozen=True)
class Samples:
    """Samples of several runs, one after the other.

    Attributes
    ----------
    views : one for each run
    blocks : (n,) block in time of each sample
    share_inside : share of the runs' samples that lies in the trained domain
    """

    views: tuple[View, ...]
    blocks: np.ndarray
    share_inside: float

    @property
    def error_V(self) -> FloatArray:
        """(n,) measured minus simulated."""
        return np.concatenate([view.residual_V for view in self.views])

    def kept(self, chosen: np.ndarray) -> Samples:
        """The samples for which (n,) `chosen` holds."""
        bounds = np.cumsum([0, *(len(view.index) for view in self.views)])
        views = tuple(
            View(view.model, view.run, view.initial_soc, view.index[chosen[first:last]])
            for view, first, last in zip(self.views, bounds[:-1], bounds[1:], strict=True)
        )
        blocks = np.unique(self.blocks[chosen], return_inverse=True)[1]
        return Samples(views, blocks, self.share_inside * float(np.mean(chosen)))

    def own_regressors(self, reference: Reference) -> FloatArray:
        """(n, p) of the reference model."""
        return np.vstack([reference.layout.regressors(view.inputs, view.soc[view.index]) for view in self.views])

    def regressors(self, effect: Effect) -> FloatArray:
        """(n, k) of an effect."""
        if effect.regressors is None:
            raise ValueError(f"{effect.name} does not show in the voltage")
        return np.vstack([effect.regressors(view) for view in self.views])

    def shifted(self, effect: Effect, value: float) -> FloatArray:
        """(n,) change of voltage by an effect with one parameter."""
        if effect.shift is None:
            raise ValueError(f"{effect.name} is not simulated again")
        return np.concatenate([effect.shift.voltage(view, value) for view in self.views])

    def beyond(self, effect: Effect, value: float) -> FloatArray:
        """(n, k) how far an effect moves the SoC out of the range that the model knows, linear and squared.

        Beyond its range the open-circuit curve is a guess: the effect is not to be judged by it.
        """
        if effect.shift is None or effect.shift.soc is None:
            return np.zeros((len(self.blocks), 0))
        low, high = self.views[0].model.soc_range
        soc = np.concatenate([effect.shift.soc(view, value)[view.index] for view in self.views])
        columns = []
        for outside in (np.maximum(low - soc, 0.0), np.maximum(soc - high, 0.0)):
            if np.count_nonzero(outside) > 0:
                columns += [outside, outside**2]
        return np.column_stack(columns) if columns else np.zeros((len(soc), 0))


def choose_samples(reference: Reference, runs: list[GridRun], initial_soc: list[float], limit: int) -> Samples:
    """Samples inside the trained domain, at most about `limit` of them."""
    return _samples(reference, runs, initial_soc, limit, inside_only=True)


def all_samples(reference: Reference, runs: list[GridRun], initial_soc: list[float], limit: int) -> Samples:
    """Samples wherever they lie, at most about `limit` of them."""
    return _samples(reference, runs, initial_soc, limit, inside_only=False)


def _samples(
    reference: Reference, runs: list[GridRun], initial_soc: list[float], limit: int, inside_only: bool
) -> Samples:
    stride = max(1, -(-sum(len(run) for run in runs) // limit))
    block_s = max(_BLOCK_S, sum(len(run) * run.dt_s for run in runs) / _MAX_BLOCKS)
    views, blocks, n_blocks, total = [], [], 0, 0
    for run, soc in zip(runs, initial_soc, strict=True):
        every = np.flatnonzero(run.measured)[::stride]
        chosen = every[trained(reference, run, soc)[every]] if inside_only else every
        views.append(View(reference, run, soc, chosen))
        blocks.append(n_blocks + (run.time_s[chosen] / block_s).astype(np.int64))
        n_blocks += int(run.time_s[-1] / block_s) + 1
        total += len(every)
    found = np.unique(np.concatenate(blocks), return_inverse=True)[1]
    return Samples(tuple(views), found, len(found) / max(total, 1))


def trained(reference: Reference, run: GridRun, initial_soc: float) -> np.ndarray:
    """(n,) whether a sample lies in the trained domain, and has for some time."""
    soc = initial_soc + run.charge_Ah / reference.capacity_Ah
    inside = np.ones(len(run), dtype=bool)
    low, high = reference.domain["current_A"]
    slack = _SLACK * (high - low)
    inside &= (run.current_A >= low - slack) & (run.current_A <= high + slack)
    if "temperature_degC" in reference.domain and not np.isnan(run.temperature_degC).any():
        low, high = reference.domain["temperature_degC"]
        slack = _TEMPERATURE_SLACK_K + 2 * _SLACK * (high - low)
        inside &= (run.temperature_degC >= low - slack) & (run.temperature_degC <= high + slack)
    index = np.arange(len(run))
    last_outside = np.maximum.accumulate(np.where(inside, -(10**9), index))
    recovered = (index - last_outside) * run.dt_s > _AFTERMATH_S
    low, high = reference.domain["soc"]
    return recovered & (soc >= low - _SOC_SLACK) & (soc <= high + _SOC_SLACK)


def visible(effect: Effect, runs: list[GridRun]) -> bool:
    """Whether the runs can show an effect in their voltage at all."""
    if effect.regressors is None:
        return False
    if not effect.needs_temperature:
        return True
    temperature = np.concatenate([run.temperature_degC for run in runs])
    return not np.isnan(temperature).any() and float(np.ptp(temperature)) >= _TEMPERATURE_RANGE_K
