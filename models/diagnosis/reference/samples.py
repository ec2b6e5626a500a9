"""Samples of runs that a diagnosis looks at, with the regressors of the model and of every effect."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.diagnosis.reference.reference import Reference
from models.effects import Effect
from models.effects.view import View

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
    """

    views: tuple[View, ...]
    blocks: np.ndarray

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
        return Samples(views, blocks)

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


def all_samples(reference: Reference, runs: list[GridRun], initial_soc: list[float], limit: int) -> Samples:
    """At most about `limit` samples that have a voltage, evenly spread."""
    stride = max(1, -(-sum(len(run) for run in runs) // limit))
    block_s = max(_BLOCK_S, sum(len(run) * run.dt_s for run in runs) / _MAX_BLOCKS)
    views, blocks, n_blocks = [], [], 0
    for run, soc in zip(runs, initial_soc, strict=True):
        chosen = np.flatnonzero(run.measured)[::stride]
        views.append(View(reference, run, soc, chosen))
        blocks.append(n_blocks + (run.time_s[chosen] / block_s).astype(np.int64))
        n_blocks += int(run.time_s[-1] / block_s) + 1
    return Samples(tuple(views), np.unique(np.concatenate(blocks), return_inverse=True)[1])


def visible(effect: Effect, runs: list[GridRun]) -> bool:
    """Whether the runs can show an effect in their voltage at all."""
    if effect.regressors is None:
        return False
    if not effect.needs_temperature:
        return True
    temperature = np.concatenate([run.temperature_degC for run in runs])
    return not np.isnan(temperature).any() and float(np.ptp(temperature)) >= _TEMPERATURE_RANGE_K
