"""What a network may be off by without lacking an effect: its time constants, and where each log begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from models.data.errors import StructureError
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.effects.view import View
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.network.signals import parse_signal

# A time constant that was given or chosen from a coarse grid is known to this in its logarithm, and how far its
# derivative is taken.
_LOG_TAU, _LOG_STEP = 0.35, 0.1
# A log begins anywhere: polarisations that fade, in s, and a place in the hysteresis loop that charge moves away from,
# in 1/capacity, each about so large.
_FADES_S, _LOOPS, _START_V = (30.0, 150.0, 700.0, 3000.0), (10.0, 40.0, 160.0), 5e-3
# Step of the slope over the state of charge.
_SOC_STEP = 0.005
# Counted charge slips by about so much, slowly.
_SLIP_SOC, _SLIP_S = 0.005, 3000.0


@dataclass(frozen=True)
class Nuisances:
    """What one standard deviation of each unknown makes at n samples of all runs, in V.

    Attributes
    ----------
    time_constants : (n, k) of the network's inputs
    slips : (n, i) of the charge that each run counts; none of them may be there
    starts : (n, j) of where each run begins
    """

    time_constants: FloatArray
    slips: FloatArray
    starts: FloatArray

    def all(self, *, slips: bool) -> FloatArray:
        """(n, m) of everything, slips or no slips, where the runs begin at its end."""
        return np.hstack([self.time_constants, *([self.slips] if slips else []), self.starts])

    def per_run(self, *, slips: bool) -> int:
        """Number of the last ones that stand for one run alone."""
        return self.starts.shape[1] + (self.slips.shape[1] if slips else 0)


def nuisances_of(network: LocalModelNetwork, views: Sequence[View], soc_std: Sequence[float]) -> Nuisances:
    """All that is open of a network beside its parameters.

    Parameters
    ----------
    network : the model
    views : runs on its grid with their samples
    soc_std : standard deviation of the SoC at the start of each
    """
    taus = [time_constants_V(network, view.run, view.initial_soc, view.index) for view in views]
    starts = [
        starts_V(network, view.run, view.initial_soc, view.index, std) for view, std in zip(views, soc_std, strict=True)
    ]
    slips = [slips_V(network, view.run, view.initial_soc, view.index) for view in views]
    return Nuisances(np.vstack(taus), _each_alone(slips), _each_alone(starts))


def _each_alone(parts: list[FloatArray]) -> FloatArray:
    return np.asarray(block_diag(*parts), dtype=np.float64)


def time_constants_V(network: LocalModelNetwork, run: GridRun, initial_soc: float, index: np.ndarray) -> FloatArray:
    """(m, k) change of voltage by time constants that are one standard deviation longer."""
    inputs = network.structure.inputs
    names = dict.fromkeys(each.signal for each in inputs if parse_signal(each.signal).get("time_constant_s"))
    if not names:
        return np.zeros((len(index), 0))
    plain = free_run_V(network, run, initial_soc)[index]
    columns = []
    for name in names:
        longer = _slower(name, float(np.exp(_LOG_STEP)))
        moved = tuple(replace(each, signal=longer) if each.signal == name else each for each in inputs)
        try:
            other = replace(
                network,
                structure=replace(network.structure, inputs=moved),
                scaling=network.scaling | {longer: network.scaling[name]},
            )
            columns.append((free_run_V(other, run, initial_soc)[index] - plain) * (_LOG_TAU / _LOG_STEP))
        except StructureError:
            # Beside an input of just that time constant it cannot stand.
            continue
    return np.column_stack(columns) if columns else np.zeros((len(index), 0))


def starts_V(
    network: LocalModelNetwork, run: GridRun, initial_soc: float, index: np.ndarray, soc_std: float
) -> FloatArray:
    """(m, k) what is open where a run begins, one standard deviation each."""
    time_s, moved_Ah = run.time_s[index], np.abs(np.diff(run.charge_Ah, prepend=run.charge_Ah[0]))
    passed = np.cumsum(moved_Ah)[index] / network.cell.capacity_Ah
    fuller = soc_std * slope_V(network, run, initial_soc, index)
    fading = [_START_V * np.exp(-time_s / tau_s) for tau_s in _FADES_S]
    loops = [_START_V * np.exp(-rate * passed) for rate in _LOOPS]
    return np.column_stack([fuller, *fading, *loops])


def slips_V(network: LocalModelNetwork, run: GridRun, initial_soc: float, index: np.ndarray) -> FloatArray:
    """(m, k) what charge that is counted wrongly for a while does."""
    time_s = run.time_s[index]
    knots = np.linspace(0.0, float(run.time_s[-1]), max(2, round(float(run.time_s[-1]) / _SLIP_S) + 1))
    hats = np.maximum(0.0, 1.0 - np.abs(time_s[:, None] - knots) / (knots[1] - knots[0]))
    return _SLIP_SOC * hats * slope_V(network, run, initial_soc, index)[:, None]


def slope_V(network: LocalModelNetwork, run: GridRun, initial_soc: float, index: np.ndarray) -> FloatArray:
    """(m,) change of the simulated voltage with the state of charge at the start, V."""
    more, less = (free_run_V(network, run, initial_soc + sign * _SOC_STEP)[index] for sign in (1.0, -1.0))
    return (more - less) / (2.0 * _SOC_STEP)


def _slower(name: str, factor: float) -> str:
    signal = parse_signal(name)
    values = {key: value * (factor if key == "time_constant_s" else 1.0) for key, value in signal.parameters.items()}
    return f"{signal.kind}:{'/'.join(f'{value:.9g}' for value in values.values())}"
