"""Where counted charge decides what the voltage is, and no effect.

Near empty and full the open-circuit curve falls by volts in a few hundredths of the charge. There half a point that was
counted wrongly makes more than any effect, and more than its derivative says; a long rest there would decide alone.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.data.resampling import GridRun
from models.diagnosis.structure.nuisances import slope_V
from models.network.local_model_network import LocalModelNetwork

# What a careful statement of the state of charge may be off by, and what that makes of the voltage at most where an
# effect can be told; a usual curve makes a quarter of it.
_CAREFUL_SOC, _MOST_V = 0.005, 0.02
# Share of the samples that has to be left; a record that stays where the curve is steep is judged there.
_FEWEST = 0.25


def without_steep(network: LocalModelNetwork, runs: list[GridRun], soc: list[float]) -> list[GridRun]:
    """Runs without the voltages that a slip of the counted charge decides.

    Parameters
    ----------
    network : that tells how steep the curve is
    runs, soc : on its grid, with their state of charge at the start

    Returns
    -------
    The runs with NaN for such voltages; as they were where too few would be left.
    """
    flat = [_is_flat(network, run, start) for run, start in zip(runs, soc, strict=True)]
    n_left = sum(int(np.count_nonzero(kept & run.measured)) for kept, run in zip(flat, runs, strict=True))
    if n_left < _FEWEST * sum(int(np.count_nonzero(run.measured)) for run in runs):
        return runs
    return [
        replace(run, voltage_V=np.where(kept, run.voltage_V, np.nan), measured=kept & run.measured)
        for kept, run in zip(flat, runs, strict=True)
    ]


def _is_flat(network: LocalModelNetwork, run: GridRun, soc: float) -> np.ndarray:
    slope = slope_V(network, run, soc, np.arange(len(run)))
    return ~(_CAREFUL_SOC * np.abs(slope) >= _MOST_V)
