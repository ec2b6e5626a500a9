"""A model tried as it will be used: compared, read out and observed with, without exceptions, in finite numbers."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from models.comparison.figures import compare
from models.data.errors import ModelError, StructureError
from models.data.resampling import to_grid
from models.network.free_run import free_run_V
from models.observer import FuzzyObserver
from models.pipeline.meaning.physics import trial_runs
from models.readouts.tables import summary

if TYPE_CHECKING:
    from models.data.timeseries import TimeSeries
    from models.network.local_model_network import LocalModelNetwork

# Of the white noise that a trial is given: a sensor's.
_NOISE_V = 1e-3
_SEED = 3
_WHATEVER = (ArithmeticError, AttributeError, IndexError, KeyError, MemoryError, TypeError, ValueError)


def try_model(network: LocalModelNetwork) -> None:
    """Use a model for a moment in all ways.

    Raises
    ------
    ModelError
        A use failed or gave a number that is not finite.
    """
    run, soc = trial_runs(network)[1]
    for name, use in (("compared", _compare), ("read out", _read), ("observed with", _observe)):
        try:
            with np.errstate(all="ignore"), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                found = use(network, run, soc)
        except _WHATEVER as error:
            raise StructureError(f"model document is damaged: it cannot be {name}: {error!s:.150}") from error
        if not _finite(found):
            raise StructureError(f"model document is damaged: it gives numbers that are not finite when {name}")


def _compare(network: LocalModelNetwork, run: TimeSeries, soc: float) -> Any:
    simulated_V = free_run_V(network, to_grid(run, network.dt_s), soc)
    noise_V = _NOISE_V * np.random.default_rng(_SEED).standard_normal(len(simulated_V))
    return compare(network, [replace(run, voltage_V=simulated_V[: len(run)] + noise_V[: len(run)])], [soc])


def _read(network: LocalModelNetwork, run: TimeSeries, soc: float) -> Any:
    return summary(network)


def _observe(network: LocalModelNetwork, run: TimeSeries, soc: float) -> Any:
    if network.structure.soc_axis < 0 and not network.structure.soc_regressors():
        return None
    observer = FuzzyObserver(network)
    state = observer.initial(soc, 0.1, float(run.temperature_degC[0]))
    _, rows = observer.replay(state, run.current_A, run.voltage_V, run.temperature_degC)
    if not (np.abs(rows[:, 0] - 0.5) < 1.0).all():
        raise ModelError(f"the observer's state of charge comes to {rows[-1, 0]:g}")
    return rows[:, :3].tolist()


def _finite(value: Any) -> bool:
    if isinstance(value, dict):
        return all(_finite(part) for part in value.values())
    if isinstance(value, list | tuple):
        return all(_finite(part) for part in value)
    return not isinstance(value, float) or math.isfinite(value)
